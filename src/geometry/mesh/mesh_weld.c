// SPDX-License-Identifier: Apache-2.0
#include "geometry/mesh/mesh_weld.h"

#include <assert.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"
#include "geometry/mesh/contacts.h"
#include "geometry/mesh/mesh_edges.h"

#define FREE UINT32_MAX

static const char what[] = "the triangles of the mesh";

static uint64_t hash_bytes(const void *bytes, size_t count)
{
    const unsigned char *p = bytes;
    uint64_t h = 0xCBF29CE484222325u;
    for (size_t i = 0; i < count; i += 4) {
        uint32_t word;
        memcpy(&word, p + i, sizeof word);
        h = (h ^ word) * 0x9E3779B97F4A7C15u;
        h ^= h >> 29;
    }
    return h;
}

/* Hash table that finds the first of equal items. Items have `size` bytes, a multiple of 4. */
typedef struct table {
    const char *items;
    size_t size, mask;
    uint32_t *slots;
} table;

static bool table_init(table *t, const void *items, size_t size, size_t count, error *e)
{
    size_t room = 16;
    while (room < 2 * count) room *= 2;
    *t = (table){items, size, room - 1, mem_array(room, sizeof(uint32_t), what, e)};
    if (!t->slots) return false;
    memset(t->slots, 0xFF, room * sizeof(uint32_t));
    return true;
}

static uint32_t table_first(table *t, uint32_t n)
{
    const char *item = t->items + n * t->size;
    size_t k = hash_bytes(item, t->size) & t->mask;
    while (t->slots[k] != FREE && memcmp(t->items + t->slots[k] * t->size, item, t->size) != 0)
        k = (k + 1) & t->mask;
    if (t->slots[k] == FREE) t->slots[k] = n;
    return t->slots[k];
}

enum { CHUNK = 4096 }; /* vertices or triangles in a chunk of work */

/* Joins vertices of equal coordinates: the one with the lowest corner number remains. */
typedef struct weld_job {
    mesh *m;
    table table;
    uint32_t
        *place; /* per vertex: its first corner, later the vertex that replaces it; FREE: no triangle has the
                 * vertex */
    atomic_bool found; /* two vertices are equal */
} weld_job;

static void begin_chunk(void *context, int worker, size_t begin, size_t end)
{
    weld_job *j = context;
    (void)worker;
    for (size_t n = begin; n < end; n++) { /* -0 and 0 are equal but have different bytes */
        j->m->vertex[n] = vec3_add(j->m->vertex[n], (vec3){0.0, 0.0, 0.0});
        j->place[n] = FREE;
    }
}

static void lower(uint32_t *most, uint32_t value)
{
    uint32_t old = __atomic_load_n(most, __ATOMIC_RELAXED);
    while (value < old &&
           !__atomic_compare_exchange_n(most, &old, value, true, __ATOMIC_RELAXED, __ATOMIC_RELAXED)) {
    }
}

static void see_chunk(void *context, int worker, size_t begin, size_t end)
{
    weld_job *j = context;
    (void)worker;
    for (size_t n = begin; n < end; n++)
        for (int k = 0; k < 3; k++) lower(&j->place[j->m->triangle[n][k]], (uint32_t)(3 * n) + (uint32_t)k);
}

/* The slot of vertex n, or the first one to search. */
static uint32_t *first_slot(const weld_job *j, size_t n)
{
    return &j->table.slots[hash_bytes(&j->m->vertex[n], sizeof(vec3)) & j->table.mask];
}

static uint32_t *next_slot(const weld_job *j, uint32_t *slot)
{
    return j->table.slots + ((size_t)(slot + 1 - j->table.slots) & j->table.mask);
}

static bool are_one(const weld_job *j, uint32_t a, uint32_t b)
{
    return memcmp(&j->m->vertex[a], &j->m->vertex[b], sizeof(vec3)) == 0;
}

/* Enters vertex n in the table. Among equal vertices the one with the lowest corner number gets the slot, in
 * any order of the threads. */
static void claim_slot(weld_job *j, uint32_t *slot, uint32_t n)
{
    uint32_t there = __atomic_load_n(slot, __ATOMIC_RELAXED);
    for (;;) {
        if (there != FREE && !are_one(j, there, n)) {
            slot = next_slot(j, slot);
            there = __atomic_load_n(slot, __ATOMIC_RELAXED);
            continue;
        }
        if (there != FREE) atomic_store_explicit(&j->found, true, memory_order_relaxed);
        if (there != FREE && j->place[there] < j->place[n]) return;
        if (__atomic_compare_exchange_n(slot, &there, n, false, __ATOMIC_RELAXED, __ATOMIC_RELAXED)) return;
    }
}

/* A large table is not in the cache: slots are prefetched. */
static void claim_chunk(void *context, int worker, size_t begin, size_t end)
{
    enum { AHEAD = 32 };
    weld_job *j = context;
    uint32_t *slot[AHEAD];
    (void)worker;
    for (size_t from = begin; from < end; from += AHEAD) {
        const size_t to = end - from < AHEAD ? end : from + AHEAD;
        for (size_t n = from; n < to; n++) __builtin_prefetch(slot[n - from] = first_slot(j, n), 1);
        for (size_t n = from; n < to; n++)
            if (j->place[n] != FREE) claim_slot(j, slot[n - from], (uint32_t)n);
    }
}

static void find_chunk(void *context, int worker, size_t begin, size_t end)
{
    weld_job *j = context;
    (void)worker;
    for (size_t n = begin; n < end; n++) {
        if (j->place[n] == FREE) continue;
        uint32_t *slot = first_slot(j, n);
        while (!are_one(j, *slot, (uint32_t)n)) slot = next_slot(j, slot);
        j->place[n] = *slot;
    }
}

/* Replaces the vertex of every corner. */
static void replace_chunk(void *context, int worker, size_t begin, size_t end)
{
    weld_job *j = context;
    (void)worker;
    for (size_t n = begin; n < end; n++)
        for (int k = 0; k < 3; k++) j->m->triangle[n][k] = j->place[j->m->triangle[n][k]];
}

/* `place`: capacity of one entry per vertex. */
static bool join_vertices(mesh *m, threads *pool, uint32_t *place, error *e)
{
    weld_job j = {.m = m, .place = place};
    assert(m->triangle_count < UINT32_MAX / 3);
    if (!table_init(&j.table, m->vertex, sizeof(vec3), m->vertex_count, e)) return false;
    threads_run(pool, m->vertex_count, CHUNK, begin_chunk, &j);
    threads_run(pool, m->triangle_count, CHUNK, see_chunk, &j);
    threads_run(pool, m->vertex_count, CHUNK, claim_chunk, &j);
    if (j.found && !threads_stopped(pool)) {
        threads_run(pool, m->vertex_count, CHUNK, find_chunk, &j);
        threads_run(pool, m->triangle_count, CHUNK, replace_chunk, &j);
    }
    free(j.table.slots);
    return threads_may_go_on(pool, e);
}

bool mesh_weld_vertices(mesh *m, threads *pool, error *e)
{
    uint32_t *place = mem_array(m->vertex_count, sizeof *place, what, e);
    const bool ok = place && join_vertices(m, pool, place, e);
    free(place);
    return ok;
}

static void use_chunk(void *context, int worker, size_t begin, size_t end)
{
    weld_job *j = context;
    (void)worker;
    for (size_t n = begin; n < end; n++)
        for (int k = 0; k < 3; k++) __atomic_store_n(&j->place[j->m->triangle[n][k]], 0, __ATOMIC_RELAXED);
}

static bool drop_unused(mesh *m, threads *pool, uint32_t *place, error *e)
{
    weld_job j = {.m = m, .place = place};
    uint32_t count = 0;
    memset(place, 0xFF, m->vertex_count * sizeof *place);
    threads_run(pool, m->triangle_count, CHUNK, use_chunk, &j);
    for (size_t n = 0; !threads_stopped(pool) && n < m->vertex_count; n++) {
        if (place[n] == FREE) continue;
        if (count < n) m->vertex[count] = m->vertex[n];
        place[n] = count++;
    }
    if (count < m->vertex_count) threads_run(pool, m->triangle_count, CHUNK, replace_chunk, &j);
    m->vertex_count = count;
    return threads_may_go_on(pool, e);
}

/* The corners in ascending order; returns +1 for an even permutation, -1 for an odd one. */
static int sort_corners(const uint32_t t[3], uint32_t out[3])
{
    int sign = 1;
    memcpy(out, t, 3 * sizeof *out);
    for (int k = 0; k < 3; k++) { /* bubble sort: three exchanges of adjacent items sort three items */
        int i = k & 1;
        if (out[i] <= out[i + 1]) continue;
        uint32_t swap = out[i];
        out[i] = out[i + 1];
        out[i + 1] = swap;
        sign = -sign;
    }
    return sign;
}

/* Keeps one triangle of each set of equal triangles. `balance`, at the index of the first of them: the
 * number of triangles with its orientation, minus those with the opposite one. */
static size_t keep_distinct(mesh *m, const uint32_t *first, const int32_t *balance, bool cancelled_too)
{
    size_t kept = 0;
    for (uint32_t n = 0; n < m->triangle_count; n++) {
        if (first[n] != n || (balance[n] == 0 && !cancelled_too)) continue;
        uint32_t t[3] = {m->triangle[n][0], m->triangle[n][1], m->triangle[n][2]};
        bool turned = balance[n] < 0;
        uint32_t *to = m->triangle[kept++];
        to[0] = t[0];
        to[1] = t[turned ? 2 : 1];
        to[2] = t[turned ? 1 : 2];
    }
    return kept;
}

/* What drop_repeated removes: the number of triangles of which one copy is kept, and the area of those of
 * which none is kept. */
typedef struct repeated {
    size_t triangles;
    double cancelled;
} repeated;

/* Keeps one of the equal triangles that cancel where they are no contact, or in components of the mesh that are open if
 * only closed ones have contacts: its balance becomes 1. */
static bool keep_needed(const mesh *m, const uint32_t *first, int32_t *balance, bool if_closed, error *e)
{
    size_t cancelled = 0;
    for (uint32_t n = 0; n < m->triangle_count; n++) cancelled += first[n] == n && balance[n] == 0;
    if (cancelled == 0) return true;
    unsigned char *face = mem_array(m->triangle_count, sizeof *face, what, e);
    bool *closed = face && if_closed ? mem_array(m->triangle_count, sizeof *closed, what, e) : NULL;
    mesh_edges edges = {0};
    bool ok = face && (!if_closed || (closed && mesh_edges_list(m, NULL, &edges, e) &&
                                      contacts_find_closed(m, &edges, closed, e)));
    mesh_edges_free(&edges);
    for (uint32_t n = 0; ok && n < m->triangle_count; n++) {
        if (first[n] == n && balance[n] == 0 && closed && !closed[n]) balance[n] = 1;
        face[n] = first[n] != n ? CONTACTS_REMOVED : balance[n] ? CONTACTS_REMAINS : CONTACTS_CANCELS;
    }
    ok = ok && contacts_find_needed(m, face, e);
    for (uint32_t n = 0; ok && n < m->triangle_count; n++)
        if (face[n] == CONTACTS_NEEDED) balance[n] = 1;
    free(face);
    free(closed);
    return ok;
}

static bool drop_repeated(mesh *m, mesh_cancelled cancelled, repeated *out, error *e)
{
    size_t all = m->triangle_count;
    uint32_t(*sorted)[3] = mem_array(all, sizeof *sorted, what, e),
    *first = mem_array(all, sizeof *first, what, e);
    int32_t *balance = mem_array(all, sizeof *balance, what, e);
    table t = {0};
    bool ok = sorted && first && balance && table_init(&t, sorted, sizeof *sorted, all, e);
    if (ok) {
        int sign_of_first;
        uint32_t unused[3];
        for (uint32_t n = 0; n < all; n++) {
            int sign = sort_corners(m->triangle[n], sorted[n]);
            first[n] = table_first(&t, n);
            sign_of_first = sort_corners(m->triangle[first[n]], unused);
            balance[first[n]] += sign == sign_of_first ? 1 : -1;
        }
        const bool keeps = cancelled == MESH_KEEP_CANCELLED;
        size_t gone = 0;
        ok = keeps || keep_needed(m, first, balance, cancelled == MESH_DROP_IF_CLOSED, e);
        for (uint32_t n = 0; ok && !keeps && n < all; n++) {
            gone += balance[first[n]] == 0;
            if (first[n] == n && balance[n] == 0) out->cancelled += 0.5 * vec3_norm(mesh_across(m, n));
        }
        if (ok) m->triangle_count = keep_distinct(m, first, balance, keeps);
        out->triangles = all - m->triangle_count - gone;
    }
    free(sorted);
    free(first);
    free(balance);
    free(t.slots);
    return ok;
}

/* Unsorted lists of the triangles whose lowest corner is v: list[first[v]] .. list[first[v + 1] - 1]. */
typedef struct by_corner {
    const mesh *m;
    uint32_t *first, *list;
    atomic_bool unclean; /* there may be duplicates, or triangles with two equal corners */
} by_corner;

/* Counting sort. The count of vertex v is in first[v + 2]. After the prefix sums, the start of v's range is
 * in first[v + 1]. Filling advances it to the end of the range, which is the start of the range of v + 1. */
static void count_chunk(void *context, int worker, size_t begin, size_t end)
{
    by_corner *by = context;
    uint32_t sorted[3];
    (void)worker;
    for (size_t n = begin; n < end; n++) {
        sort_corners(by->m->triangle[n], sorted);
        __atomic_fetch_add(&by->first[(size_t)sorted[0] + 2], 1, __ATOMIC_RELAXED);
        if (mesh_is_degenerate(sorted)) atomic_store(&by->unclean, true);
    }
}

static void fill_chunk(void *context, int worker, size_t begin, size_t end)
{
    by_corner *by = context;
    uint32_t sorted[3];
    (void)worker;
    for (size_t n = begin; n < end; n++) {
        sort_corners(by->m->triangle[n], sorted);
        by->list[__atomic_fetch_add(&by->first[(size_t)sorted[0] + 1], 1, __ATOMIC_RELAXED)] = (uint32_t)n;
    }
}

static bool is_repeated(const mesh *m, uint32_t a, uint32_t b)
{
    uint32_t of_a[3], of_b[3];
    sort_corners(m->triangle[a], of_a);
    sort_corners(m->triangle[b], of_b);
    return memcmp(of_a, of_b, sizeof of_a) == 0;
}

/* Compares the triangles of each vertex in pairs. More than FEW triangles are not compared, and are reported
 * as unclean. */
static void compare_chunk(void *context, int worker, size_t begin, size_t end)
{
    enum { FEW = 64 };
    by_corner *by = context;
    bool may = false;
    (void)worker;
    for (size_t v = begin; !may && v < end; v++) {
        const uint32_t *list = by->list + by->first[v], count = by->first[v + 1] - by->first[v];
        may = count > FEW;
        for (uint32_t k = 1; !may && k < count; k++)
            for (uint32_t i = 0; i < k; i++) may |= is_repeated(by->m, list[k], list[i]);
    }
    if (may) atomic_store(&by->unclean, true);
}

/* Sets *may: the mesh may have duplicates, or triangles with two equal corners. */
static bool find_unclean(const mesh *m, threads *pool, bool *may, error *e)
{
    by_corner by = {.m = m, .first = mem_array(m->vertex_count + 2, sizeof *by.first, what, e)};
    by.list = by.first ? mem_array(m->triangle_count, sizeof *by.list, what, e) : NULL;
    const bool ok = by.list != NULL;
    if (ok) {
        threads_run(pool, m->triangle_count, CHUNK, count_chunk, &by);
        for (size_t v = 2; v < m->vertex_count + 2; v++) by.first[v] += by.first[v - 1];
        threads_run(pool, m->triangle_count, CHUNK, fill_chunk, &by);
        threads_run(pool, m->vertex_count, CHUNK, compare_chunk, &by);
    }
    *may = atomic_load(&by.unclean);
    free(by.first);
    free(by.list);
    if (ok && !threads_may_go_on(pool, e)) return false;
    return ok;
}

bool mesh_weld_clean(mesh *m, threads *pool, error *e)
{
    uint32_t *place = mem_array(m->vertex_count, sizeof *place, what, e);
    bool unclean = false, ok = place && join_vertices(m, pool, place, e) &&
                               find_unclean(m, pool, &unclean, e) &&
                               (unclean || drop_unused(m, pool, place, e));
    m->welded = ok && !unclean;
    free(place);
    return ok;
}

bool mesh_weld(mesh *m, mesh_cancelled cancelled, mesh_notes *notes, error *e)
{
    if (m->welded) return true;
    size_t all = m->triangle_count;
    repeated again = {0};
    uint32_t *place = mem_array(m->vertex_count, sizeof *place, what, e);
    bool ok = place && join_vertices(m, NULL, place, e);
    if (ok) {
        size_t degenerate = mesh_drop_degenerate(m);
        ok = drop_repeated(m, cancelled, &again, e) && drop_unused(m, NULL, place, e);
        m->welded = ok;
        if (degenerate)
            mesh_note(notes, "%zu of %zu triangles have two equal corners: they are skipped", degenerate,
                      all);
        if (ok && again.cancelled > 0)
            mesh_note(notes,
                      "faces of closed shells touch: an area of %.4g belongs to two faces with opposite "
                      "normals and is not sampled; move the shells apart to sample both.",
                      again.cancelled);
        if (again.triangles)
            mesh_note(notes,
                      "%zu of %zu triangles are duplicates (coinciding shells or faces); duplicates are "
                      "ignored",
                      again.triangles, all);
    }
    free(place);
    return ok;
}
