// SPDX-License-Identifier: Apache-2.0
#include "job/phases/patch_meshes.h"

#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"
#include "job/phases/mesh_faults.h"
#include "surface/remesh/surface_mesh.h"

static const char what[] = "the meshes of patches";

/* Minimum number of points of a surface. */
enum { FEWEST_POINTS = 3 };

/* The items of patch p are item[first[p]] .. item[first[p + 1] - 1]. */
typedef struct by_patch {
    size_t *first;
    uint32_t *item;
} by_patch;

/* A patch with its own numbering of points. */
typedef struct piece {
    size_t points, sides, triangles;
    uint32_t *input_index; /* index in the input of each point */
    vec3 *position, *normal;
    double *spacing;
    uint32_t *name; /* identity: the index of each point */
    uint32_t (*side)[2];
    uint32_t (*corner)[3];
} piece;

typedef struct repair {
    const triangulation_input *in;
    const mesh_patches *on;
    const triangulation *made;
    threads *pool;
    by_patch points, sides, triangles;
    uint32_t *own;    /* for each point of the input: its index in the current patch */
    uint32_t *vertex; /* for each vertex of the patches: its index in the current mesh */
    uint32_t (*corner)[3];
    uint32_t *label;
    size_t count, corner_capacity, label_capacity; /* of the result */
    size_t repaired;
} repair;

/* ---- items of each patch ---- */

typedef uint32_t patch_of(const repair *m, size_t k);

static uint32_t patch_of_point(const repair *m, size_t k)
{
    return m->in->label[k];
}

static uint32_t patch_of_side(const repair *m, size_t k)
{
    return m->in->label[m->in->side[k][0]];
}

static uint32_t patch_of_triangle(const repair *m, size_t k)
{
    return m->made->label[k];
}

static bool sort_by_patch(const repair *m, size_t count, patch_of *patch, by_patch *out, error *e)
{
    out->first = mem_array(m->on->count + 2, sizeof *out->first, what, e);
    out->item = mem_array(count, sizeof *out->item, what, e);
    if (!out->first || !out->item) return false;
    for (size_t k = 0; k < count; k++) out->first[patch(m, k) + 2]++;
    for (size_t p = 2; p < m->on->count + 2; p++) out->first[p] += out->first[p - 1];
    for (size_t k = 0; k < count; k++) out->item[out->first[patch(m, k) + 1]++] = (uint32_t)k;
    return true;
}

static size_t count_of(const by_patch *b, size_t patch)
{
    return b->first[patch + 1] - b->first[patch];
}

/* ---- one patch ---- */

static void piece_free(piece *p)
{
    free(p->position);
    free(p->normal);
    free(p->spacing);
    free(p->name);
    free(p->side);
    free(p->corner);
}

static bool take_piece(repair *m, size_t patch, piece *out, error *e)
{
    const triangulation_input *in = m->in;
    const uint32_t *side = m->sides.item + m->sides.first[patch],
                   *triangle = m->triangles.item + m->triangles.first[patch];
    *out = (piece){.points = count_of(&m->points, patch),
                   .sides = count_of(&m->sides, patch),
                   .triangles = count_of(&m->triangles, patch),
                   .input_index = m->points.item + m->points.first[patch]};
    out->position = mem_array(out->points, sizeof *out->position, what, e);
    out->normal = mem_array(out->points, sizeof *out->normal, what, e);
    out->spacing = mem_array(out->points, sizeof *out->spacing, what, e);
    out->name = mem_array(out->points, sizeof *out->name, what, e);
    out->side = mem_array(out->sides + 1, sizeof *out->side, what, e);
    out->corner = mem_array(out->triangles, sizeof *out->corner, what, e);
    if (!out->position || !out->normal || !out->spacing || !out->name || !out->side || !out->corner)
        return false;
    for (uint32_t i = 0; i < out->points; i++) {
        const uint32_t input_index = out->input_index[i];
        out->position[i] = in->position[input_index];
        out->normal[i] = in->normal[input_index];
        out->spacing[i] = in->spacing[input_index];
        out->name[i] = m->own[in->point[input_index]] = i;
    }
    for (size_t k = 0; k < out->sides; k++)
        for (int i = 0; i < 2; i++) out->side[k][i] = m->own[in->point[in->side[side[k]][i]]];
    for (size_t k = 0; k < out->triangles; k++)
        for (int c = 0; c < 3; c++) out->corner[k][c] = m->own[m->made->corner[triangle[k]][c]];
    return true;
}

/* A pair of points, the lower index first, joined by a side of a triangle or by a step along a curve. */
typedef struct tie {
    uint32_t low, high;
    bool is_step;
} tie;

static int compare_ties(const void *left, const void *right)
{
    const tie *a = left, *b = right;
    if (a->low != b->low) return a->low < b->low ? -1 : 1;
    return (a->high > b->high) - (a->high < b->high);
}

static tie tie_of(uint32_t a, uint32_t b, bool is_step)
{
    return (tie){a < b ? a : b, a < b ? b : a, is_step};
}

/* A patch must have one triangle at each step along its curves. *out: the number of missing and excess
 * triangles. */
static bool count_off_curves(const piece *p, const triangulation *made, size_t *out, error *e)
{
    const size_t count = 3 * made->facts.triangles + p->sides;
    tie *all = mem_array(count, sizeof *all, what, e);
    *out = 0;
    if (!all) return false;
    for (size_t k = 0; k < 3 * made->facts.triangles; k++) {
        const uint32_t *corner = made->corner[k / 3];
        all[k] = tie_of(corner[k % 3], corner[(k + 1) % 3], false);
    }
    for (size_t k = 0; k < p->sides; k++)
        all[3 * made->facts.triangles + k] = tie_of(p->side[k][0], p->side[k][1], true);
    qsort(all, count, sizeof *all, compare_ties);
    for (size_t k = 0, n; k < count; k = n) {
        size_t steps = 0;
        for (n = k; n < count && compare_ties(&all[n], &all[k]) == 0; n++) steps += all[n].is_step;
        const size_t sides = n - k - steps;
        if (steps > 0) *out += sides > steps ? sides - steps : steps - sides;
    }
    free(all);
    return true;
}

/* *faults: the number of faults of the triangles of a patch. */
static bool survey_piece(const repair *m, const piece *p, triangulation *made, size_t *faults, error *e)
{
    const triangulation_input in = {.count = p->points,
                                    .position = p->position,
                                    .normal = p->normal,
                                    .spacing = p->spacing,
                                    .open = m->in->open,
                                    .domain = m->in->domain,
                                    .side = (const uint32_t(*)[2])p->side,
                                    .side_count = p->sides};
    if (!triangulation_survey(&in, m->pool, made, e) || !count_off_curves(p, made, faults, e)) return false;
    *faults += mesh_faults_count(&made->facts);
    return true;
}

/* The triangles of a patch as a mesh with its own vertices. */
static bool mesh_of_patch(repair *m, size_t patch, mesh *out, error *e)
{
    const size_t begin = m->on->first[patch];
    *out = (mesh){.triangle_count = m->on->first[patch + 1] - begin};
    out->triangle = mem_array(out->triangle_count, sizeof *out->triangle, what, e);
    out->vertex = mem_array(3 * out->triangle_count, sizeof *out->vertex, what, e);
    if (!out->triangle || !out->vertex) return false;
    for (size_t c = 0; c < 3 * out->triangle_count; c++) {
        const uint32_t v = m->on->m.triangle[begin + c / 3][c % 3];
        if (m->vertex[v] == UINT32_MAX) {
            m->vertex[v] = (uint32_t)out->vertex_count;
            out->vertex[out->vertex_count++] = m->on->m.vertex[v];
        }
        out->triangle[c / 3][c % 3] = m->vertex[v];
    }
    return true;
}

/* Triangulates the points along the triangles of the patch, and replaces the triangles of *p if the result
 * has fewer faults. */
static bool make_along(repair *m, size_t patch, size_t faults, piece *p, error *e)
{
    mesh along;
    triangulation other = {0};
    size_t others;
    bool ok = mesh_of_patch(m, patch, &along, e);
    const surface_mesh_input in = {
        &along,   p->points, p->position, p->spacing, p->name, p->points, (const uint32_t(*)[2])p->side,
        p->sides, NULL};
    ok = ok && surface_mesh_make(&in, &other.corner, &other.facts.triangles, e) &&
         survey_piece(m, p, &other, &others, e);
    mesh_free(&along);
    if (ok && others < faults) {
        uint32_t(*kept)[3] = p->corner;
        p->corner = other.corner;
        p->triangles = other.facts.triangles;
        other.corner = kept;
        m->repaired++;
    }
    triangulation_free(&other);
    return ok;
}

/* ---- all patches ---- */

/* Rotates the corners so that the lowest index comes first. */
static void put_triangle(const uint32_t vertex[3], uint32_t out[3])
{
    const int least = vertex[0] < vertex[1] ? (vertex[0] < vertex[2] ? 0 : 2) : vertex[1] < vertex[2] ? 1 : 2;
    for (int c = 0; c < 3; c++) out[c] = vertex[(least + c) % 3];
}

static bool keep_piece(repair *m, uint32_t patch, const piece *p, error *e)
{
    for (size_t k = 0; k < p->triangles; k++) {
        if (!MEM_GROW(m->corner, m->count, &m->corner_capacity, what, e)) return false;
        if (!MEM_GROW(m->label, m->count, &m->label_capacity, what, e)) return false;
        uint32_t vertex[3];
        for (int c = 0; c < 3; c++) vertex[c] = m->in->point[p->input_index[p->corner[k][c]]];
        put_triangle(vertex, m->corner[m->count]);
        m->label[m->count++] = patch;
    }
    return true;
}

static bool repair_patch(repair *m, uint32_t patch, error *e)
{
    piece p;
    bool ok = take_piece(m, patch, &p, e);
    triangulation as_is = {.corner = p.corner, .facts.triangles = p.triangles};
    size_t faults;
    ok = ok && survey_piece(m, &p, &as_is, &faults, e);
    if (ok && faults > 0 && p.points >= FEWEST_POINTS) ok = make_along(m, patch, faults, &p, e);
    ok = ok && keep_piece(m, patch, &p, e);
    piece_free(&p);
    return ok;
}

static bool repair_all(repair *m, error *e)
{
    m->own = mem_array(m->in->points, sizeof *m->own, what, e);
    m->vertex = mem_array(m->on->m.vertex_count, sizeof *m->vertex, what, e);
    if (!m->own || !m->vertex) return false;
    memset(m->vertex, 0xff, m->on->m.vertex_count * sizeof *m->vertex);
    bool ok = sort_by_patch(m, m->in->count, patch_of_point, &m->points, e) &&
              sort_by_patch(m, m->in->side_count, patch_of_side, &m->sides, e) &&
              sort_by_patch(m, m->made->facts.triangles, patch_of_triangle, &m->triangles, e);
    for (uint32_t p = 0; ok && p < m->on->count; p++)
        ok = threads_stopped(m->pool) ? error_set(e, ERROR_CANCELLED, "stopped") : repair_patch(m, p, e);
    return ok;
}

static void by_patch_free(by_patch *b)
{
    free(b->first);
    free(b->item);
}

bool patch_meshes_repair(const triangulation_input *in, const mesh_patches *on, threads *pool,
                         triangulation *made, error *e)
{
    repair m = {.in = in, .on = on, .made = made, .pool = pool};
    bool ok = repair_all(&m, e);
    triangulation repaired = {.corner = m.corner,
                              .label = m.label,
                              .facts = {.triangles = m.count}}; /* which of them closed holes is unknown */
    ok = ok && (m.repaired == 0 || triangulation_survey(in, pool, &repaired, e));
    by_patch_free(&m.points);
    by_patch_free(&m.sides);
    by_patch_free(&m.triangles);
    free(m.own);
    free(m.vertex);
    if (!ok || m.repaired == 0 || mesh_faults_count(&repaired.facts) > mesh_faults_count(&made->facts)) {
        triangulation_free(&repaired);
        return ok;
    }
    triangulation_free(made);
    *made = repaired;
    return true;
}
