// SPDX-License-Identifier: Apache-2.0
#include "job/source/point_curvature.h"

#include <math.h>
#include <stdlib.h>

#include "base/core/memory.h"
#include "surface/levelset/mesh_faces.h"
#include "surface/triangles/mesh_curvature.h"
#include "surface/triangles/triangle_tree.h"

static const char what[] = "the curvature of the points";

/* Distance from another part of a combination, in voxels of the level set, within which the curvature is undefined:
 * the sampled surface is rounded there. */
static const double BESIDE_PART = 2;
/* GRAIN: points of a task. NO_LEAF: the point lies on no mesh. */
enum { GRAIN = 1024, NO_LEAF = 0xffff };

/* A mesh of the surface. */
typedef struct leaf {
    const source_part *part;
    const placement **outer; /* transforms around it, the innermost one first */
    size_t outer_count;
    const mesh *m;
    double unit; /* of its lengths, in the space of the part */
    double offset;
    triangle_tree *tree; /* of triangles that have no tree yet; or NULL */
    mesh_curvature *curvature;
    uint32_t (*beside)[3]; /* of mesh_surface_neighbours; or NULL */
} leaf;

/* The place of a point. */
typedef struct point_place {
    mesh_place place;
    vec3 normal; /* of the point, in the space of the leaf */
    uint16_t leaf;
    bool is_beside;  /* within BESIDE_PART voxels of another part */
    bool is_limited; /* beside limited samples of a volume */
} point_place;

typedef struct curvature_job {
    const source *source;
    const point_curvature_input *in;
    leaf *leaves;
    size_t leaf_count;
    point_place *at;
    point_curvature *out;
} curvature_job;

/* ---- the meshes of a surface */

static bool is_mesh(const source_part *p)
{
    return p->mesh || (p->volume && volume_mesh_faces(p->volume));
}

static size_t count_meshes(const source_part *p)
{
    size_t count = is_mesh(p);
    for (size_t k = 0; k < p->part_count; k++) count += count_meshes(&p->parts[k]);
    return count;
}

/* Whether a volume among the parts has limited samples. */
static bool has_limits(const source_part *p)
{
    bool found = p->volume && volume_describe(p->volume)->is_limited;
    for (size_t k = 0; k < p->part_count; k++) found |= has_limits(&p->parts[k]);
    return found;
}

bool point_curvature_has_mesh(const source *s)
{
    return count_meshes(&s->whole) > 0;
}

bool point_curvature_is_special(const source *s)
{
    return count_meshes(&s->whole) > 0 || has_limits(&s->whole);
}

/* The transform between a part and the parts within it, or NULL. A mesh of patches was transformed when it was
 * opened. */
static const placement *placement_within(const source_part *p)
{
    return p->placement && p->field == placement_field(p->placement) ? p->placement : NULL;
}

static void list_meshes(curvature_job *f, const source_part *p, const placement **outer, size_t depth)
{
    const placement *within = placement_within(p);
    if (within) outer[depth++] = within;
    for (size_t k = 0; k < p->part_count; k++) list_meshes(f, &p->parts[k], outer, depth);
    if (!is_mesh(p)) return;
    leaf *out = &f->leaves[f->leaf_count++];
    *out = (leaf){
        .part = p, .outer = mem_alloc((depth + 1) * sizeof *out->outer), .outer_count = depth, .unit = 1};
    for (size_t k = 0; k < depth; k++) out->outer[k] = outer[depth - 1 - k];
    if (p->mesh) {
        const mesh *uncut = &mesh_surface_patches(p->mesh)->uncut;
        out->m = uncut->triangle_count > 0 ? uncut : mesh_surface_given(p->mesh);
    } else {
        const mesh_faces *faces = volume_mesh_faces(p->volume);
        out->m = mesh_faces_mesh(faces);
        out->unit = mesh_faces_unit(faces);
        out->offset = volume_mesh_offset(p->volume);
    }
}

static size_t depth_of(const source_part *p)
{
    size_t depth = 0;
    for (size_t k = 0; k < p->part_count; k++) {
        const size_t below = depth_of(&p->parts[k]);
        if (below > depth) depth = below;
    }
    return depth + 1;
}

static bool is_uncut(const leaf *l)
{
    return l->part->mesh && l->m != mesh_surface_given(l->part->mesh);
}

static bool make_trees(curvature_job *f, const threads *pool, error *e)
{
    for (size_t k = 0; k < f->leaf_count; k++)
        if (is_uncut(&f->leaves[k]) && !(f->leaves[k].tree = triangle_tree_new(f->leaves[k].m, pool, e)))
            return false;
    return true;
}

static bool prepare_mesh(leaf *l, threads *pool, error *e)
{
    const mesh_surface *s = l->part->mesh;
    const uint32_t(*beside)[3] = NULL;
    if (s && !is_uncut(l) && !(beside = mesh_surface_neighbours(s, &l->beside, e))) return false;
    l->curvature = mesh_curvature_new(l->m, beside, s ? mesh_surface_crease(s) : MESH_PATCHES_ANGLE, pool, e);
    return l->curvature != NULL;
}

static void close_leaf(leaf *l)
{
    free(l->outer);
    triangle_tree_free(l->tree);
    mesh_curvature_free(l->curvature);
    free(l->beside);
}

/* ---- places */

static uint16_t index_of(const curvature_job *f, const source_part *p)
{
    size_t k = 0;
    while (k < f->leaf_count && f->leaves[k].part != p) k++;
    return (uint16_t)(k < f->leaf_count ? k : NO_LEAF);
}

/* Whether x, on part k of a combination, is near the surface of another part. */
static bool is_beside(const source_part *p, size_t k, vec3 x)
{
    const double near = BESIDE_PART * p->parts[k].field->cell_size;
    bool found = false;
    for (size_t other = 0; !found && other < p->part_count; other++) {
        field_sample s;
        const field *f = p->parts[other].field;
        if (other == k || !f || !field_sample_at(f, x, FIELD_GRADIENT, &s)) continue;
        found = fabs(s.value) <= near * vec3_norm(s.gradient);
    }
    return found;
}

/* Finds the mesh on which a point lies, and its place there. */
static void locate(const curvature_job *f, size_t i, point_place *out)
{
    const source_part *p = &f->source->whole;
    vec3 x = f->in->position[i], normal = f->in->normal[i];
    *out = (point_place){.leaf = NO_LEAF};
    while (p->part_count > 0) {
        const placement *within = placement_within(p);
        const size_t k = source_nearest_part(p, x);
        if (p->part_count > 1 && is_beside(p, k, x)) out->is_beside = true;
        if (within) {
            x = placement_to_part(within, x);
            normal = placement_turn_normal_to_part(within, normal);
        }
        p = &p->parts[k];
    }
    out->leaf = index_of(f, p);
    out->is_limited = p->volume && volume_is_limited(p->volume, x);
    if (out->leaf == NO_LEAF) return;
    const leaf *l = &f->leaves[out->leaf];
    out->normal = normal;
    if (l->tree) {
        mesh_place_find(l->tree, x, &normal, INFINITY, &out->place);
    } else if (p->mesh) {
        const bool has_patch = f->in->patch && f->source->field == mesh_surface_field(p->mesh);
        out->place = mesh_surface_find_given(p->mesh, has_patch ? f->in->patch[i] : UINT32_MAX, x, normal,
                                             has_patch && f->in->hint ? f->in->hint[i] : FIELD_NO_HINT);
    } else {
        out->place = mesh_faces_place(volume_mesh_faces(p->volume), x, normal);
    }
}

static void locate_chunk(void *context, int worker, size_t begin, size_t end)
{
    const curvature_job *f = context;
    (void)worker;
    for (size_t i = begin; i < end; i++) locate(f, i, &f->at[i]);
}

static bool prepare_leaf(const curvature_job *f, size_t k, threads *pool, error *e)
{
    leaf *l = &f->leaves[k];
    size_t count = 0;
    for (size_t i = 0; i < f->in->count; i++) count += f->at[i].leaf == k;
    if (count == 0) return true;
    uint32_t *places = mem_array(count, sizeof *places, what, e);
    count = 0;
    for (size_t i = 0; places && i < f->in->count; i++)
        if (f->at[i].leaf == k) places[count++] = f->at[i].place.triangle;
    const bool ok =
        places && prepare_mesh(l, pool, e) && mesh_curvature_prepare(l->curvature, places, count, pool, e);
    free(places);
    return ok;
}

/* ---- values */

static sym3 scaled(double a, sym3 m)
{
    return (sym3){a * m.xx, a * m.yy, a * m.zz, a * m.xy, a * m.xz, a * m.yz};
}

/* The symmetric matrix with the eigenvalues a, b and 0 for the orthogonal unit vectors u and v and their normal. */
static sym3 of_principal(double a, vec3 u, double b, vec3 v)
{
    return (sym3){a * u.x * u.x + b * v.x * v.x, a * u.y * u.y + b * v.y * v.y,
                  a * u.z * u.z + b * v.z * v.z, a * u.x * u.y + b * v.x * v.y,
                  a * u.x * u.z + b * v.x * v.z, a * u.y * u.z + b * v.y * v.z};
}

/* The surface at a distance from a mesh: changes the sample, which is of the mesh. False: its curvature is
 * undefined. */
static bool move_by_offset(const leaf *l, const point_place *at, bool is_defined, field_sample *s)
{
    const double d = l->offset;
    vec3 along = {0, 0, 0}, u, v;
    double k1, k2;
    const mesh_curvature_feature feature =
        mesh_curvature_feature_at(l->curvature, at->place.triangle, at->place.weight, &along);
    if (feature != MESH_CURVATURE_SMOOTH) {
        s->gradient = at->normal;
        along = vec3_unit(vec3_axpy(-vec3_dot(along, at->normal), at->normal, along));
        if (feature == MESH_CURVATURE_CORNER) vec3_frame(at->normal, &along, &v);
        v = vec3_cross(at->normal, along);
        s->hessian = of_principal(feature == MESH_CURVATURE_CORNER ? 1 / d : 0, along, 1 / d, v);
        return true;
    }
    if (!is_defined) return false;
    field_curvature(s, &k1, &k2);
    u = field_principal_direction(s, true);
    v = field_principal_direction(s, false);
    if (!(1 + d * k1 > 0 && 1 + d * k2 > 0)) return false;
    s->hessian = of_principal(k1 / (1 + d * k1), u, k2 / (1 + d * k2), v);
    return true;
}

static void evaluate(const curvature_job *f, size_t i, point_curvature *out)
{
    const point_place *at = &f->at[i];
    *out = (point_curvature){.is_special = at->leaf != NO_LEAF || at->is_limited};
    if (at->leaf == NO_LEAF || at->is_beside) return;
    const leaf *l = &f->leaves[at->leaf];
    const mesh_curvature_value v = mesh_curvature_at(l->curvature, at->place.triangle, at->place.weight);
    const double side = vec3_dot(v.normal, at->normal) < 0 ? -1 : 1;
    field_sample s = {0, vec3_scale(v.normal, side), scaled(side / l->unit, v.shape)};
    if (!(l->offset == 0 ? v.defined : move_by_offset(l, at, v.defined, &s))) return;
    for (size_t k = 0; k < l->outer_count; k++) placement_turn_sample(l->outer[k], &s);
    out->is_defined = true;
    field_curvature(&s, &out->kappa1, &out->kappa2);
    out->direction1 = field_principal_direction(&s, true);
}

static void evaluate_chunk(void *context, int worker, size_t begin, size_t end)
{
    const curvature_job *f = context;
    (void)worker;
    for (size_t i = begin; i < end; i++) evaluate(f, i, &f->out[i]);
}

bool point_curvature_find(const source *s, const point_curvature_input *in, threads *pool,
                          point_curvature *out, error *e)
{
    const size_t meshes = count_meshes(&s->whole);
    curvature_job f = {s, in, mem_alloc((meshes + 1) * sizeof *f.leaves), 0, NULL, out};
    const placement **outer = mem_alloc(depth_of(&s->whole) * sizeof *outer);
    list_meshes(&f, &s->whole, outer, 0);
    free(outer);
    f.at = mem_array(in->count, sizeof *f.at, what, e);
    bool ok = f.at && make_trees(&f, pool, e);
    if (ok) threads_run(pool, in->count, GRAIN, locate_chunk, &f);
    ok = ok && threads_may_go_on(pool, e);
    for (size_t k = 0; ok && k < f.leaf_count; k++) ok = prepare_leaf(&f, k, pool, e);
    if (ok) threads_run(pool, in->count, GRAIN, evaluate_chunk, &f);
    for (size_t k = 0; k < f.leaf_count; k++) close_leaf(&f.leaves[k]);
    free(f.leaves);
    free(f.at);
    return ok && threads_may_go_on(pool, e);
}
