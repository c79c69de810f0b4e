// SPDX-License-Identifier: Apache-2.0
#include "geometry/mesh/mesh_edges.h"

#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"

static const char what[] = "the edges of the mesh";

void mesh_edges_free(mesh_edges *edges)
{
    free(edges->sides);
    free(edges->first);
    *edges = (mesh_edges){0};
}

static int by_other(const void *left, const void *right)
{
    const mesh_side *a = left, *b = right;
    if (a->other != b->other) return a->other < b->other ? -1 : 1;
    if (a->triangle != b->triangle) return a->triangle < b->triangle ? -1 : 1;
    return (int)b->upwards - (int)a->upwards;
}

/* A vertex with at most FEW sides is sorted without allocation. */
enum { FEW = 16, CHUNK = 4096 }; /* CHUNK: vertices or triangles in a chunk of work */

static void sort_sides(mesh_side *sides, size_t count)
{
    if (count > FEW) {
        qsort(sides, count, sizeof *sides, by_other);
        return;
    }
    for (size_t k = 1; k < count; k++) {
        const mesh_side s = sides[k];
        size_t at = k;
        for (; at > 0 && by_other(&sides[at - 1], &s) > 0; at--) sides[at] = sides[at - 1];
        sides[at] = s;
    }
}

static void add(size_t *all, size_t more)
{
    if (more > 0) __atomic_fetch_add(all, more, __ATOMIC_RELAXED);
}

static void sort_chunk(void *context, int worker, size_t begin, size_t end)
{
    mesh_edges *edges = context;
    mesh_edges counts = {0};
    (void)worker;
    for (size_t v = begin; v < end; v++) {
        sort_sides(edges->sides + edges->first[v], edges->first[v + 1] - edges->first[v]);
        for (size_t k = edges->first[v], n; k < edges->first[v + 1]; k += n) {
            const mesh_side *s = edges->sides + k;
            n = mesh_edges_width(edges, v, k);
            counts.open += n == 1;
            counts.odd += n > 1 && n % 2;
            counts.branching += n > 2;
            counts.against += n == 2 && s[0].upwards == s[1].upwards;
        }
    }
    add(&edges->open, counts.open);
    add(&edges->odd, counts.odd);
    add(&edges->branching, counts.branching);
    add(&edges->against, counts.against);
}

typedef struct list_job {
    const mesh *m;
    mesh_edges *edges;
} list_job;

/* Counting sort. The count of vertex v is in first[v + 2]. After the prefix sums, the start of v's range is
 * in first[v + 1]. Filling advances it to the end of the range, which is the start of the range of v + 1. */
static void count_chunk(void *context, int worker, size_t begin, size_t end)
{
    const list_job *job = context;
    (void)worker;
    for (size_t n = begin; n < end; n++)
        for (int k = 0; k < 3; k++) {
            uint32_t a = job->m->triangle[n][k], b = job->m->triangle[n][(k + 1) % 3];
            __atomic_fetch_add(&job->edges->first[(a < b ? a : b) + 2], 1, __ATOMIC_RELAXED);
        }
}

static void fill_chunk(void *context, int worker, size_t begin, size_t end)
{
    const list_job *job = context;
    (void)worker;
    for (size_t n = begin; n < end; n++)
        for (int k = 0; k < 3; k++) {
            uint32_t a = job->m->triangle[n][k], b = job->m->triangle[n][(k + 1) % 3], low = a < b ? a : b;
            const size_t at = __atomic_fetch_add(&job->edges->first[low + 1], 1, __ATOMIC_RELAXED);
            job->edges->sides[at] = (mesh_side){a < b ? b : a, (uint32_t)n, a < b};
        }
}

bool mesh_edges_list(const mesh *m, threads *pool, mesh_edges *out, error *e)
{
    list_job job = {m, out};
    mesh_edges_free(out);
    out->vertex_count = m->vertex_count;
    out->sides = mem_array(3 * m->triangle_count, sizeof *out->sides, what, e);
    out->first = mem_array(m->vertex_count + 2, sizeof *out->first, what, e);
    if (!out->sides || !out->first) return false;
    threads_run(pool, m->triangle_count, CHUNK, count_chunk, &job);
    for (size_t v = 2; v < m->vertex_count + 2; v++) out->first[v] += out->first[v - 1];
    threads_run(pool, m->triangle_count, CHUNK, fill_chunk, &job);
    /* the order of the sides depends on the threads */
    threads_run(pool, m->vertex_count, CHUNK, sort_chunk, out);
    return threads_may_go_on(pool, e);
}

size_t mesh_edges_width(const mesh_edges *edges, size_t v, size_t k)
{
    size_t n = 1;
    while (k + n < edges->first[v + 1] && edges->sides[k + n].other == edges->sides[k].other) n++;
    return n;
}

bool mesh_edges_open(const mesh_edges *edges, seam_edge **out, size_t *count, error *e)
{
    seam_edge *list = mem_array(edges->open, sizeof *list, what, e);
    size_t found = 0;
    if (!list) return false;
    for (uint32_t v = 0; found < edges->open; v++)
        for (size_t k = edges->first[v], n; k < edges->first[v + 1]; k += n) {
            const mesh_side *s = edges->sides + k;
            n = mesh_edges_width(edges, v, k);
            if (n == 1)
                list[found++] =
                    (seam_edge){s->upwards ? v : s->other, s->upwards ? s->other : v, s->triangle};
        }
    *out = list;
    *count = found;
    return true;
}

/* The first round joins vertices with vertices. Each later round splits a triangle at one of its open
 * edges. */
const mesh_edges *mesh_edges_close_seams(mesh *m, const mesh_edges *known, double tolerance, threads *pool,
                                         mesh_edges *own, mesh_notes *notes, error *e)
{
    enum { MOST_ROUNDS = 9 };
    size_t joined = 0, split = 0, changed = 1;
    const mesh_edges *edges = known ? known : own;
    if (!known && !mesh_edges_list(m, pool, own, e)) return NULL;
    for (int round = 0; changed && round < MOST_ROUNDS; round++) {
        const size_t before = split;
        seam_edge *open;
        size_t count;
        if (!mesh_edges_open(edges, &open, &count, e)) return NULL;
        bool ok = round == 0 ? seams_join(m, open, count, tolerance, &joined, e)
                             : seams_split(m, open, count, tolerance, &split, e);
        free(open);
        changed = count > 0 && (round == 0 || split > before);
        if (!ok || (changed && !mesh_edges_list(m, pool, own, e))) return NULL;
        if (changed) edges = own;
    }
    if (joined)
        mesh_note(notes, "%zu vertices of open edges coincide with others within rounding: they are joined",
                  joined);
    if (split)
        mesh_note(notes,
                  "%zu triangles have vertices of other triangles on their open edges: they are split "
                  "there",
                  split);
    return edges;
}
