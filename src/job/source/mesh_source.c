// SPDX-License-Identifier: Apache-2.0
#include "job/source/mesh_source.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "geometry/mesh/mesh_weld.h"
#include "base/core/memory.h"
#include "base/core/sets.h"
#include "job/source/mesh_clip.h"
#include "job/source/plan.h"
#include "surface/levelset/fidelity.h"
#include "surface/triangles/mesh_orientation.h"
#include "surface/volume/voxel_size.h"
#include "geometry/mesh/flat_triangles.h"
#include "geometry/mesh/mesh_edges.h"
#include "io/meshes/mesh_file.h"
#include "geometry/space/packing.h"

/* Maximum edge of a cell: the spacing, but at most the longest side of the mesh over least_cells, so that
 * normals and sizes are known accurately with few points, too. */
static const double least_cells = 32;
/* Cells of a mesh that is to be resolved. If the spec gives no spacing, the edge is the smaller of two
 * values: own_floor times the longest side of the mesh, and triangle_floor times the root of the mean area
 * of its triangles, a quarter of their side. It is limited from below, so that there are at most about
 * most_cells cells. (With a third of the side, the ends of the horns of a scanned dragon are missed by half
 * the spacing.) */
static const double most_cells = 6.25e5, own_floor = 1.0 / 256, triangle_floor = 0.4;
/* In longest sides of the mesh: if its distance from the origin exceeds this, the mesh is moved to the
 * origin. Doubles lose 3 of 16 digits at this distance. */
static const double FAR_AWAY = 1000;
/* Maximum fraction of the area that may be missing: with more, the outcome is `unresolved`. */
static const double most_missing = 0.01;
/* Feature angle, in radians, of a mesh that is to be resolved and has no other sharp edges. A side of length
 * h that cuts off an edge with this angle deviates from it by at least h / 4, and by at most h / 3. */
static const double cut_angle = 1.1;
/* Fractions of the area of a closed mesh that are inside its solids. Above most_hidden the mesh is converted
 * to a level set, unless the spec requires otherwise; above shown_hidden there is a warning. */
static const double most_hidden = 0.01, shown_hidden = 0.001;

/* The spacing of the requested points; 0: unknown before features are computed. */
static double spacing_of(const mesh_source_request *r, double area)
{
    const voxel_size_request *q = &r->as_volume.resolution;
    return q->spacing > 0 ? q->spacing : q->count > 0 ? packing_spacing(area, q->count) : 0;
}

static double longest_cell(const mesh_source_request *r, const mesh_patches *p)
{
    const double longest = bbox_longest(mesh_box(&p->m, r->as_volume.pool)), most = longest / least_cells,
                 asked = spacing_of(r, mesh_area(&p->m)),
                 by_mesh =
                     fmin(own_floor * longest,
                          triangle_floor * sqrt(mesh_area(&p->m) / fmax((double)p->m.triangle_count, 1))),
                 spacing = r->resolve && !(asked > 0) ? by_mesh : asked;
    const double shortest = r->resolve ? sqrt(mesh_area(&p->m) / most_cells) : 0;
    return spacing > 0 ? fmax(fmin(spacing, most), shortest) : most;
}

/* Whether the spec has members that require a level set. */
static bool asks_for_volume(const mesh_source_request *r)
{
    const spec_mesh *s = r->spec;
    return r->as_level_set || !s->on_mesh || s->voxel_size > 0 || s->resolution > 0;
}

/* Whether level sets cannot represent a closed mesh with hidden parts: even with the smallest voxels, more
 * than the permitted area is missing. Meshes with displaced vertices also take the most time as level
 * sets. */
static bool is_tangled(const mesh_source_request *r, const mesh *m, bool *out, mesh_notes *notes, error *e)
{
    static const double surely = 5; /* safety factor: the fraction is estimated from a thousand places */
    double thin;
    if (!fidelity_thin(m, voxel_size_begin(m, &r->as_volume.resolution).finest, &thin, e)) return false;
    *out = thin > surely * most_missing;
    if (*out) mesh_note(notes, "the mesh is thinner than the smallest voxel: it is sampled on its triangles");
    return true;
}

/* Decides from the area inside the solids whether a closed mesh is sampled on its triangles (*out). */
static bool shows_enough(const mesh_source_request *r, const mesh_patches *p, bool *out, mesh_notes *notes,
                         error *e)
{
    double hidden = 0;
    *out = true;
    if (r->spec->interior == SPEC_INTERIOR_KEEP) return true;
    if (!fidelity_hidden(&p->m, &hidden, e)) return false;
    *out = r->resolve || hidden <= most_hidden;
    if (!*out) return is_tangled(r, &p->m, out, notes, e);
    if (hidden > shown_hidden)
        mesh_note(notes,
                  "%.3g %% of the mesh area is inside its solids and is sampled, too; set interior to "
                  "\"drop\" to exclude it",
                  100 * hidden);
    return true;
}

/* Whether the mesh is sampled on its triangles. */
static bool wants_patches(const mesh_source_request *r, const mesh_patches *p, bool *out, mesh_notes *notes,
                          error *e)
{
    *out = !p->closed && r->spec->holes == SPEC_HOLES_KEEP;
    for (size_t k = 0; p->closed && k < p->count; k++)
        *out |= p->one_sided[k]; /* a Klein bottle has no inside */
    if (!p->closed || *out) return true;
    *out = r->spec->has_features && r->spec->feature_angle > 0 && p->feature_edges + p->nonmanifold_edges > 0;
    return *out || asks_for_volume(r) || shows_enough(r, p, out, notes, e);
}

/* The mesh of a file. It is welded once for all surfaces made of it, if possible; then its edges are
 * known. */
typedef struct welded {
    mesh m;
    mesh_edges edges;
} welded;

static const mesh_edges *edges_of(const welded *w)
{
    return w->m.welded ? &w->edges : NULL;
}

/* Makes the patches of the mesh, or (`placed`) of the transformed and cut mesh. */
static bool make_patches(const mesh_source_request *r, const welded *w, double feature_angle, bool placed,
                         mesh_notes *notes, mesh_patches *made, error *e)
{
    mesh copy = {0};
    if (!mesh_copy(&w->m, r->as_volume.pool, &copy, e)) return false;
    if (placed && r->to_world) mesh_move(&copy, r->to_world);
    if (placed && r->region && !mesh_clip(&copy, *r->region, e)) {
        mesh_free(&copy);
        return false;
    }
    const mesh_patches_params params = {.weld = r->spec->weld,
                                        .feature_angle = feature_angle,
                                        .spacing = spacing_of(r, mesh_area(&copy)),
                                        .edges = placed ? NULL : edges_of(w),
                                        .pool = r->as_volume.pool};
    if (!mesh_patches_make(&copy, &params, notes, made, e)) return false;
    if (mesh_orientation_fix(made, e)) return true;
    mesh_patches_free(made);
    return false;
}

/* If a closed mesh is to be resolved and has no feature edges, cuts it at edges bent by cut_angle, which its
 * spacing would not represent. */
static bool cut_bends(const mesh_source_request *r, const welded *w, const mesh_notes *read,
                      mesh_patches *given, mesh_notes *notes, error *e)
{
    if (!given->closed || given->feature_edges > 0 || r->spec->has_features) return true;
    mesh_notes again = *read;
    mesh_patches cut = {0};
    if (!make_patches(r, w, cut_angle, false, &again, &cut, e)) return false;
    mesh_patches_free(given);
    cut.has_rough_curves = true;
    *given = cut;
    *notes = again;
    return true;
}

/* Decides whether the mesh is sampled on its triangles: *made is empty if it becomes a level set. `thin`: a
 * level set was tried, and represents too little or encloses no volume. *open_edges: of the mesh before a region
 * cuts it. */
static bool choose_patches(const mesh_source_request *r, const welded *w, bool thin, mesh_notes *notes,
                           mesh_patches *made, size_t *open_edges, error *e)
{
    const spec_mesh *s = r->spec;
    const double angle = s->has_features ? s->feature_angle : MESH_PATCHES_AUTOMATIC;
    mesh_notes as_given = *notes;
    mesh_patches given = {0};
    bool wanted = thin;
    if (!r->alone || s->interior == SPEC_INTERIOR_DROP) return true;
    bool ok = make_patches(r, w, angle, false, &as_given, &given, e) &&
              (!r->resolve || cut_bends(r, w, notes, &given, &as_given, e)) &&
              (thin || wants_patches(r, &given, &wanted, &as_given, e));
    if (!ok || !wanted) {
        mesh_patches_free(&given);
        return ok;
    }
    *open_edges = given.open_edges;
    if (!r->to_world && !r->region) {
        *made = given;
        *notes = as_given;
        return true;
    }
    const double found = given.feature_angle;
    const bool rough = given.has_rough_curves;
    mesh uncut = {0};
    if (r->region) {
        uncut = given.m;
        given.m = (mesh){0};
        if (r->to_world) mesh_move(&uncut, r->to_world);
    }
    mesh_patches_free(&given);
    if (!make_patches(r, w, found, true, notes, made, e)) {
        mesh_free(&uncut);
        return false;
    }
    made->has_rough_curves = rough;
    made->uncut = uncut;
    return true;
}

/* ---- holes */

static const char what[] = "the edges of the mesh";

/* A connected set of open edges. */
typedef struct hole {
    vec3 sum; /* sum of the ends of its edges */
    size_t ends;
    uint32_t middle; /* index of the new vertex */
} hole;

static size_t gather_holes(const mesh *m, const seam_edge *open, size_t count, uint32_t *set, hole *of_root)
{
    size_t holes = 0;
    sets_reset(set, m->vertex_count);
    for (size_t k = 0; k < count; k++) sets_join(set, open[k].from, open[k].to);
    for (size_t k = 0; k < count; k++) {
        hole *h = &of_root[sets_root(set, open[k].from)];
        if (h->ends == 0) h->middle = (uint32_t)(m->vertex_count + holes++);
        h->sum = vec3_add(h->sum, vec3_add(m->vertex[open[k].from], m->vertex[open[k].to]));
        h->ends += 2;
    }
    return holes;
}

/* Closes the holes of a mesh: each connected set of open edges gets a vertex in its centre, and each of its
 * edges a triangle to it, so that an even number of triangles meets at each new edge. *holes: their number.
 * Errors: limit_memory; the mesh is unchanged then. */
static bool close_holes(mesh *m, const mesh_edges *edges, size_t *holes, error *e)
{
    seam_edge *open = NULL;
    size_t count = 0;
    if (!mesh_edges_open(edges, &open, &count, e)) return false;
    uint32_t *set = mem_array(m->vertex_count, sizeof *set, what, e);
    hole *of_root = mem_array(m->vertex_count, sizeof *of_root, what, e);
    bool ok = set && of_root;
    size_t found = ok ? gather_holes(m, open, count, set, of_root) : 0;
    vec3 *vertex = ok ? mem_array(m->vertex_count + found, sizeof *vertex, what, e) : NULL;
    uint32_t(*faces)[3] = vertex ? mem_array(m->triangle_count + count, sizeof *faces, what, e) : NULL;
    ok = faces != NULL;
    if (ok) {
        memcpy(vertex, m->vertex, m->vertex_count * sizeof *vertex);
        memcpy(faces, m->triangle, m->triangle_count * sizeof *faces);
        for (size_t k = 0; k < count; k++) {
            const hole *h = &of_root[sets_root(set, open[k].from)];
            vertex[h->middle] = vec3_scale(h->sum, 1 / (double)h->ends);
            uint32_t *t = faces[m->triangle_count + k];
            t[0] = open[k].to;
            t[1] = open[k].from;
            t[2] = h->middle;
        }
        free(m->vertex);
        free(m->triangle);
        *m = (mesh){m->vertex_count + found, m->triangle_count + count, vertex, faces, false};
        *holes = found;
    } else {
        free(vertex);
    }
    free(open);
    free(set);
    free(of_root);
    return ok;
}

/* Makes a closed copy of a mesh by filling its holes. *out is empty if that is not sufficient. */
static bool fill_holes(const mesh_source_request *r, const welded *w, mesh *out, mesh_notes *notes, error *e)
{
    mesh_edges closed_edges = {0};
    const mesh_edges *edges = NULL;
    mesh_notes unused = {0}; /* dropped: the level set adds the same notes */
    size_t holes = 0;
    bool ok = mesh_copy(&w->m, r->as_volume.pool, out, e) &&
              mesh_weld(out, MESH_DROP_IF_CLOSED, &unused, e) &&
              (edges = mesh_edges_close_seams(out, edges_of(w),
                                              r->spec->weld * bbox_longest(mesh_box(out, r->as_volume.pool)),
                                              r->as_volume.pool, &closed_edges, &unused, e)) &&
              close_holes(out, edges, &holes, e);
    mesh_edges_free(&closed_edges);
    if (ok && holes) mesh_note(notes, "%zu holes of the mesh are filled", holes);
    return ok;
}

/* ---- public functions */

static volume *open_level_set(const mesh_source_request *r, const welded *w, const mesh_notes *read, error *e)
{
    volume_mesh_request as_it_is = r->as_volume;
    as_it_is.edges = edges_of(w);
    if (r->spec->holes == SPEC_HOLES_KEEP) return volume_of_mesh(&as_it_is, &w->m, read, e);
    mesh filled = {0};
    mesh_notes notes = *read;
    volume *v = NULL;
    if (fill_holes(r, w, &filled, &notes, e))
        v = volume_of_mesh(&r->as_volume, &filled, &notes, e);
    else
        error_prefix(e, "%s", r->as_volume.path);
    mesh_free(&filled);
    return v;
}

/* After a level set was tried: the reason, as a note, why the triangles are sampled instead; NULL: they are
 * not. A level set with automatic voxels, or none, may represent less of the surface than is permitted.
 * Patches are also cut where faces overlap, which can close the mesh; a level set is not cut. */
static const char *why_triangles(const mesh_source_request *r, const volume *v, const error *e)
{
    const spec_mesh *s = r->spec;
    if (!r->alone || s->interior == SPEC_INTERIOR_DROP || s->voxel_size > 0 || s->resolution > 0) return NULL;
    if (v ? volume_describe(v)->fidelity.thin > most_missing : e->code == ERROR_NO_SURFACE)
        return "the mesh is thinner than the smallest voxel: it is sampled on its triangles";
    if (!v && e->code == ERROR_INPUT_UNSUPPORTED && s->holes == SPEC_HOLES_KEEP)
        return "faces of the mesh overlap, so it encloses no volume: it is sampled on its "
               "triangles. Join the faces for a level set.";
    return NULL;
}

/* Adds the reason why the mesh must be closed to the error about an open mesh. */
static void explain_closed(error *e)
{
    const size_t used = strlen(e->message);
    snprintf(
        e->message + used, sizeof e->message - used,
        ". A mesh in a combination, an offset or a region must be closed; a transform or a region box may "
        "have an open one.");
}

/* Refuses a spacing that gives too many points, before the triangles are cut into pieces as small as it. */
static bool check_target(const mesh_source_request *r, const mesh_patches *p, error *e)
{
    if (!r->target) return true;
    const plan_memory memory = {plan_particle_memory(r->target, (size_t)r->memory, 0), r->memory,
                                r->most_memory};
    size_t count;
    return plan_count(r->target, mesh_area(&p->m), 0, &count, e) &&
           plan_check_memory(r->target, (plan_particles){.has_patches = true}, (double)count, &memory, e);
}

static bool open_read(const mesh_source_request *r, const welded *w, const mesh_notes *read,
                      volume **as_volume, mesh_surface **as_patches, mesh_notes *notes, error *e)
{
    mesh_patches patches = {0};
    mesh_notes about = *read;
    size_t open_edges = 0;
    if (!choose_patches(r, w, false, &about, &patches, &open_edges, e))
        return error_prefix(e, "%s", r->as_volume.path);
    if (patches.count == 0) {
        volume *opened = open_level_set(r, w, read, e);
        const char *why = why_triangles(r, opened, e);
        if (!why && opened) *as_volume = opened;
        if (!why && !opened && !r->alone && e->code == ERROR_INPUT_UNSUPPORTED) explain_closed(e);
        if (!why) return opened != NULL;
        volume_close(opened);
        if (!choose_patches(r, w, true, &about, &patches, &open_edges, e))
            return error_prefix(e, "%s", r->as_volume.path);
        mesh_note(&about, "%s", why);
    }
    if (open_edges > 0)
        mesh_note(&about,
                  "the mesh is open (%zu edges with one triangle): it is sampled as an open surface; "
                  "set holes to \"fill\" to close it",
                  open_edges);
    if (patches.turned > 0)
        mesh_note(&about,
                  "%zu of %zu triangles are reversed, so that normals agree along edges and point out "
                  "of closed components",
                  patches.turned, patches.m.triangle_count);
    patches.merges_near_curves = true;
    if (!check_target(r, &patches, e)) {
        mesh_patches_free(&patches);
        return false;
    }
    mesh_surface *surface = mesh_surface_new(&patches, longest_cell(r, &patches),
                                             r->as_volume.resolution.memory_limit, r->as_volume.pool, e);
    if (!surface) return error_prefix(e, "%s", r->as_volume.path);
    *as_patches = surface;
    *notes = about;
    return true;
}

/* The origin to subtract: along each axis along which the mesh is farther from the origin than FAR_AWAY
 * times its longest side, the middle of its box; otherwise 0. There all coordinates are within a factor of 2
 * of the middle, so that the difference is exact (Sterbenz). */
static vec3 far_origin(const mesh *m, threads *pool)
{
    const bbox box = mesh_box(m, pool);
    vec3 origin = {0, 0, 0};
    for (int k = 0; k < 3; k++) {
        const double middle = 0.5 * (vec3_get(box.min, k) + vec3_get(box.max, k));
        if (fabs(middle) > FAR_AWAY * bbox_longest(box)) vec3_set(&origin, k, middle);
    }
    return origin;
}

static void move_to_origin(mesh *m, vec3 origin)
{
    for (size_t k = 0; k < m->vertex_count; k++) m->vertex[k] = vec3_sub(m->vertex[k], origin);
}

bool mesh_source_open(const mesh_source_request *request, volume **as_volume, mesh_surface **as_patches,
                      vec3 *origin, mesh_notes *notes, error *e)
{
    const volume_mesh_request *v = &request->as_volume;
    const mesh_file file = {request->fd, v->path, NULL, v->resolution.memory_limit};
    welded w = {0};
    mesh_notes read = {0};
    mesh_source_request moved = *request;
    bbox region;
    if (!(request->array ? mesh_array_read(request->array, file.memory_limit, &w.m, &read, e)
                         : mesh_file_read(&file, &w.m, &read, e)))
        return error_prefix(e, "%s", v->path);
    bool ok = flat_triangles_remove(&w.m, v->pool, &read, e);
    *origin = ok && request->may_move ? far_origin(&w.m, v->pool) : vec3_make(0, 0, 0);
    if (vec3_norm(*origin) > 0) move_to_origin(&w.m, *origin);
    if (request->region) {
        region = bbox_move(*request->region, vec3_scale(*origin, -1));
        moved.region = &region;
    }
    ok = ok && mesh_weld_clean(&w.m, v->pool, e) &&
         (!w.m.welded || mesh_edges_list(&w.m, v->pool, &w.edges, e));
    if (!ok) error_prefix(e, "%s", v->path);
    ok = ok && open_read(&moved, &w, &read, as_volume, as_patches, notes, e);
    mesh_edges_free(&w.edges);
    mesh_free(&w.m);
    return ok;
}

void mesh_source_describe(const mesh_surface *s, const mesh_notes *notes, json *members, json *warnings)
{
    const mesh_patches *p = mesh_surface_patches(s);
    json *of_mesh = json_put_object(members, "mesh");
    size_t one_sided = 0;
    for (size_t k = 0; k < p->count; k++) one_sided += p->one_sided[k];
    json_put_integer(of_mesh, "triangles", (int64_t)mesh_surface_triangles(s));
    json_put_number(of_mesh, "area", mesh_area(&p->m));
    json_put_integer(of_mesh, "patches", (int64_t)p->count);
    json_put_integer(of_mesh, "one_sided_patches", (int64_t)one_sided);
    json_put_integer(of_mesh, "curves", (int64_t)p->curve_count);
    json_put_integer(of_mesh, "corners", (int64_t)p->corner_count);
    json_put_integer(of_mesh, "open_edges", (int64_t)p->open_edges);
    json_put_integer(of_mesh, "sharp_edges", (int64_t)p->feature_edges);
    json_put_integer(of_mesh, "nonmanifold_edges", (int64_t)p->nonmanifold_edges);
    json_put_number(of_mesh, "feature_angle", p->feature_angle);
    for (size_t k = 0; k < notes->count; k++) json_append_string(warnings, notes->text[k]);
}
