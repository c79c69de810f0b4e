// SPDX-License-Identifier: Apache-2.0
#include "surface/remesh/left_out.h"

#include <math.h>
#include <stdlib.h>

#include "base/core/memory.h"
#include "surface/triangles/triangle_tree.h"
#include "surface/remesh/fine_mesh.h"

static const char what[] = "places that triangles leave out";

/* Maximum side, in spacings, of the pieces of the mesh whose corners are tested. */
static const double PIECES = 0.4;
/* Number of tested places of a triangle: the midpoints of its sides, and its centroid. */
enum { OF_TRIANGLE = 4 };

typedef struct far_place {
    vec3 at;
    double share, spacing; /* share: distance from the other mesh, in spacings */
} far_place;

typedef struct search {
    const left_out_input *in;
    double share;
    const mesh *pieces, *made;
    const triangle_tree *of_mesh, *of_made;
    far_place *found; /* per tested place; share 0: it is not far */
} search;

static vec3 corner_of(const mesh *m, size_t n, int k)
{
    return m->vertex[m->triangle[n][k]];
}

static vec3 weighted(const mesh *m, size_t n, const double weight[3])
{
    vec3 x = {0, 0, 0};
    for (int k = 0; k < 3; k++) x = vec3_axpy(weight[k], corner_of(m, n, k), x);
    return x;
}

static double spacing_at(const search *s, size_t n, const double weight[3])
{
    double spacing = 0;
    for (int k = 0; k < 3; k++) spacing += weight[k] * s->in->spacing[s->in->triangle[n][k]];
    return spacing;
}

static void look_from_mesh(void *context, int worker, size_t begin, size_t end)
{
    const search *s = context;
    (void)worker;
    for (size_t k = begin; k < end; k++) {
        const vec3 x = s->pieces->vertex[k];
        double weight[3];
        const size_t n = triangle_tree_find(s->of_made, x, weight);
        const double spacing = spacing_at(s, n, weight),
                     share = vec3_norm(vec3_sub(weighted(s->made, n, weight), x)) / spacing;
        s->found[k] = (far_place){x, share > s->share ? share : 0, spacing};
    }
}

static void look_from_triangles(void *context, int worker, size_t begin, size_t end)
{
    static const double weight[OF_TRIANGLE][3] = {
        {0.5, 0.5, 0}, {0, 0.5, 0.5}, {0.5, 0, 0.5}, {1.0 / 3, 1.0 / 3, 1.0 / 3}};
    const search *s = context;
    (void)worker;
    for (size_t k = begin; k < end; k++) {
        const double *w = weight[k % OF_TRIANGLE];
        const vec3 x = weighted(s->made, k / OF_TRIANGLE, w);
        double there[3];
        const size_t n = triangle_tree_find(s->of_mesh, x, there);
        const vec3 at = weighted(s->in->on, n, there);
        const double spacing = spacing_at(s, k / OF_TRIANGLE, w),
                     share = vec3_norm(vec3_sub(at, x)) / spacing;
        s->found[s->pieces->vertex_count + k] = (far_place){at, share > s->share ? share : 0, spacing};
    }
}

static int by_share(const void *left, const void *right)
{
    const far_place *a = left, *b = right;
    if (a->share != b->share) return a->share > b->share ? -1 : 1;
    return vec3_compare(a->at, b->at);
}

/* Keeps the farthest place of each neighbourhood. Returns the number of kept places. */
static size_t choose(far_place *found, size_t count, size_t most, vec3 *out)
{
    size_t far = 0, kept = 0;
    for (size_t k = 0; k < count; k++)
        if (found[k].share > 0) found[far++] = found[k];
    if (far > 0) qsort(found, far, sizeof *found, by_share);
    for (size_t k = 0; k < far && kept < most; k++) {
        bool alone = true;
        for (size_t i = 0; i < kept && alone; i++)
            alone = vec3_norm(vec3_sub(out[i], found[k].at)) > found[k].spacing;
        if (alone) out[kept++] = found[k].at;
    }
    return kept;
}

static bool look(search *s, size_t most, threads *pool, vec3 **place, size_t *count, error *e)
{
    const size_t corners = s->pieces->vertex_count, others = OF_TRIANGLE * s->made->triangle_count;
    s->found = mem_array(corners + others, sizeof *s->found, what, e);
    *place = mem_array(most, sizeof **place, what, e);
    const bool ok = s->found && *place;
    if (ok) {
        threads_run(pool, corners, 256, look_from_mesh, s);
        threads_run(pool, others, 256, look_from_triangles, s);
        *count = threads_stopped(pool) ? 0 : choose(s->found, corners + others, most, *place);
    }
    free(s->found);
    return ok;
}

bool left_out_find(const left_out_input *in, double share, size_t most, threads *pool, vec3 **place,
                   size_t *count, error *e)
{
    const mesh made = {in->count, in->triangles, (vec3 *)in->position, (uint32_t(*)[3])in->triangle, false};
    fine_mesh fine = {0};
    triangle_tree *of_mesh = NULL, *of_made = NULL;
    *place = NULL;
    *count = 0;
    bool ok = fine_mesh_make(in->on, NULL, in->count, in->position, in->spacing, PIECES, &fine, e) &&
              (of_mesh = triangle_tree_new(in->on, pool, e)) && (of_made = triangle_tree_new(&made, pool, e));
    search s = {in, share, &fine.m, &made, of_mesh, of_made, NULL};
    ok = ok && look(&s, most, pool, place, count, e);
    triangle_tree_free(of_mesh);
    triangle_tree_free(of_made);
    fine_mesh_free(&fine);
    return ok;
}
