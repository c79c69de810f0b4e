// SPDX-License-Identifier: Apache-2.0
#include "job/phases/measured_surface.h"

#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"
#include "base/core/sets.h"
#include "geometry/mesh/mesh_euler.h"
#include "geometry/mesh/mesh_weld.h"
#include "surface/field/patches.h"

static const char what[] = "the measures of the surface";

/* Numbers connected components: patches that meet in a curve belong to the same one. */
static bool find_patch_pieces(const field_patches *p, uint32_t **out, error *e)
{
    uint32_t *parent = mem_array(p->count, sizeof *parent, what, e),
             *piece = mem_array(p->count, sizeof *piece, what, e);
    uint32_t pieces = 0;
    *out = piece;
    if (parent && piece) {
        sets_reset(parent, p->count);
        for (size_t c = 0; c < p->curve_count; c++)
            for (size_t k = 1; k < p->curve[c].patch_count; k++)
                sets_join(parent, p->curve_patch[p->curve[c].patch_first],
                          p->curve_patch[p->curve[c].patch_first + k]);
        for (uint32_t k = 0; k < p->count; k++) {
            const uint32_t root = sets_root(parent, k);
            piece[k] = root == k ? pieces++ : piece[root];
        }
    }
    free(parent);
    return parent && piece;
}

static bool use_patches(const mesh_patches *p, const field_patches *of, measured_surface *out, error *e)
{
    out->facets = (facets_input){.triangle_count = p->m.triangle_count,
                                 .vertex = p->m.vertex,
                                 .triangle = (const uint32_t(*)[3])p->m.triangle,
                                 .patch_first = p->first,
                                 .patch_count = p->count};
    out->patches = of;
    out->patch_euler = p->euler;
    if (!find_patch_pieces(of, &out->patch_piece, e)) return false;
    out->facets.patch_piece = out->patch_piece;
    return true;
}

static bool use_labels(const label_surface *labels, measured_surface *out, error *e)
{
    const mesh_patches *p = label_surface_patches(labels);
    if (!use_patches(p, label_surface_field(labels)->patches, out, e)) return false;
    return (out->patch_labels = label_surface_materials(labels, what, e)) != NULL;
}

static const mesh_faces *faces_of(const source *s)
{
    const volume *v = s->whole.volume;
    if (!v || s->creased || s->region || s->inside.field || s->whole.part_count > 0) return NULL;
    const mesh_faces *faces = volume_faces(v);
    return faces && !mesh_faces_has_hidden(faces) ? faces : NULL;
}

/* Uses the mesh of a level set, in world units. Not if there are several components: those inside or close
 * below the walls of others are not sampled. */
static bool use_faces(const mesh_faces *faces, measured_surface *out, error *e)
{
    const mesh *m = mesh_faces_mesh(faces);
    static const uint32_t one_piece[1] = {0};
    facets_input in = {
        .triangle_count = m->triangle_count, .triangle = (const uint32_t(*)[3])m->triangle, .patch_count = 1};
    size_t pieces = 0;
    if (!facets_count_pieces(&in, &pieces, e)) return false;
    if (pieces > 1) return true;
    in.vertex = out->vertex = mem_array(m->vertex_count, sizeof *out->vertex, what, e);
    if (!out->vertex) return false;
    for (size_t k = 0; k < m->vertex_count; k++) out->vertex[k] = mesh_faces_to_world(faces, m->vertex[k]);
    in.patch_piece = one_piece;
    out->facets = in;
    out->mesh = m;
    out->own_normals = true;
    out->lost_places = 0;
    return true;
}

bool measured_surface_open(const source *s, const surface *scan, measured_surface *out, error *e)
{
    const field *f = s->field;
    *out = (measured_surface){.facets = {.scan = scan, .patch_count = 1}};
    if (s->whole.mesh && f == mesh_surface_field(s->whole.mesh))
        return use_patches(mesh_surface_patches(s->whole.mesh), f->patches, out, e);
    if (s->whole.labels && f == label_surface_field(s->whole.labels))
        return use_labels(s->whole.labels, out, e);
    const mesh_faces *faces = faces_of(s);
    out->lost_places = source_thin_places(s, &out->lost_place);
    if (faces) return use_faces(faces, out, e);
    if (!f->patches) return true;
    out->patches = f->patches;
    out->facets.patch_count = f->patches->count;
    if (!find_patch_pieces(f->patches, &out->patch_piece, e)) return false;
    out->facets.patch_piece = out->patch_piece;
    return true;
}

/* ---- the Euler characteristic of each piece */

static size_t count_pieces(const measured_surface *m)
{
    size_t count = m->mesh || m->patches ? 1 : m->facets.scan->parts.count;
    for (size_t p = 0; m->patches && p < m->patches->count; p++)
        count = m->patch_piece[p] + 1 > count ? m->patch_piece[p] + 1 : count;
    return count;
}

/* Adds the triangles of the scan's cells of patch p. */
static bool add_patch(const measured_surface *m, size_t p, threads *pool, double *euler, error *e)
{
    const surface *scan = m->facets.scan;
    const size_t begin = scan->parts.begin[p], end = scan->parts.begin[p + 1],
                 room = FIELD_CELL_TRIANGLES * (end - begin);
    vec3 t[FIELD_CELL_TRIANGLES][3];
    mesh of = {.vertex = mem_array(3 * room, sizeof *of.vertex, what, e)};
    of.triangle = of.vertex ? mem_array(room, sizeof *of.triangle, what, e) : NULL;
    for (size_t k = begin; of.triangle && k < end; k++) {
        const int count = surface_cell_triangles(scan, k, t);
        for (int i = 0; i < count; i++, of.triangle_count++)
            for (int c = 0; c < 3; c++) {
                of.triangle[of.triangle_count][c] = (uint32_t)of.vertex_count;
                of.vertex[of.vertex_count++] = t[i][c];
            }
    }
    const bool ok = of.triangle && mesh_weld_vertices(&of, pool, e) &&
                    mesh_euler_add(&of, false, pool, &euler[m->patch_piece[p]], e);
    mesh_free(&of);
    return ok;
}

/* An end of a curve, and the piece on which it lies. */
typedef struct curve_end {
    vec3 at;
    uint32_t piece;
} curve_end;

static int compare_ends(const void *a, const void *b)
{
    const curve_end *p = a, *q = b;
    return p->piece != q->piece ? (p->piece > q->piece) - (p->piece < q->piece)
                                : memcmp(&p->at, &q->at, sizeof p->at);
}

/* Adds the curves: a closed one has no part in the characteristic, others have a corner at each end, which they share. */
static bool add_curves(const measured_surface *m, double *euler, error *e)
{
    const field_patches *p = m->patches;
    curve_end *end = mem_array(2 * p->curve_count + 1, sizeof *end, what, e);
    size_t ends = 0;
    for (size_t k = 0; end && k < p->curve_count; k++) {
        const field_curve *c = &p->curve[k];
        const uint32_t piece = m->patch_piece[p->curve_patch[c->patch_first]];
        if (c->closed) continue;
        euler[piece]--;
        end[ends++] = (curve_end){p->vertex[c->first], piece};
        end[ends++] = (curve_end){p->vertex[c->first + c->count - 1], piece};
    }
    if (ends > 0) qsort(end, ends, sizeof *end, compare_ends);
    for (size_t k = 0; k < ends; k++)
        if (k == 0 || compare_ends(&end[k - 1], &end[k]) != 0) euler[end[k].piece]++;
    free(end);
    return end != NULL;
}

bool measured_surface_find_euler(measured_surface *m, threads *pool, error *e)
{
    const size_t pieces = count_pieces(m);
    double *euler = m->euler = mem_array(pieces, sizeof *euler, what, e);
    bool ok = euler != NULL;
    if (!ok) return false;
    if (!m->mesh && !m->patches) {
        memcpy(euler, m->facets.scan->euler, pieces * sizeof *euler);
        return true;
    }
    if (!m->patches) return mesh_euler_add(m->mesh, true, pool, euler, e);
    for (size_t p = 0; ok && p < m->patches->count; p++)
        if (m->patch_euler)
            euler[m->patch_piece[p]] += (double)m->patch_euler[p];
        else
            ok = add_patch(m, p, pool, euler, e);
    return ok && add_curves(m, euler, e);
}

void measured_surface_close(measured_surface *m)
{
    free(m->euler);
    free(m->patch_piece);
    free(m->patch_labels);
    free(m->vertex);
    *m = (measured_surface){0};
}
