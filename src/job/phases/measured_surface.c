// SPDX-License-Identifier: Apache-2.0
#include "job/phases/measured_surface.h"

#include <stdlib.h>

#include "base/core/memory.h"
#include "base/core/sets.h"
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
    out->facets.patch_count = f->patches->count;
    if (!find_patch_pieces(f->patches, &out->patch_piece, e)) return false;
    out->facets.patch_piece = out->patch_piece;
    return true;
}

void measured_surface_close(measured_surface *m)
{
    free(m->patch_piece);
    free(m->patch_labels);
    free(m->vertex);
    *m = (measured_surface){0};
}
