// SPDX-License-Identifier: Apache-2.0
#include "surface/labels/label_surface.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/elementary.h"
#include "base/core/memory.h"
#include "surface/labels/label_majority.h"
#include "surface/labels/label_mesh.h"
#include "surface/labels/label_thinness.h"
#include "surface/triangles/mesh_surface.h"
#include "geometry/space/packing.h"

struct label_surface {
    label_volume labels; /* its voxels are freed after the triangles are made */
    mesh_surface *surface;
    label_thin *thin;
    size_t thin_count;
    dense_warnings warnings; /* warnings of the reader */
};

typedef struct wanted_pairs {
    const spec_labels *spec;
    const label_volume *labels;
} wanted_pairs;

static bool is_wanted(const void *context, uint16_t first, uint16_t second)
{
    const wanted_pairs *w = context;
    const double a = (double)w->labels->material[first].value, b = (double)w->labels->material[second].value;
    for (size_t k = 0; k < w->spec->interface_count; k++) {
        const double *pair = w->spec->interfaces[k].number;
        if ((pair[0] == a && pair[1] == b) || (pair[0] == b && pair[1] == a)) return true;
    }
    return false;
}

/* ---- thin labels */

/* A patch between a thin label and a label that is not thin. */
typedef struct thin_side {
    size_t thin, other, patch;
} thin_side;

static int by_labels(const void *left, const void *right)
{
    const thin_side *a = left, *b = right;
    if (a->thin != b->thin) return a->thin < b->thin ? -1 : 1;
    if (a->other != b->other) return a->other < b->other ? -1 : 1;
    return (a->patch > b->patch) - (a->patch < b->patch);
}

static size_t list_sides(const label_surface *s, thin_side *out)
{
    const label_material *m = s->labels.material;
    const mesh_patches *p = mesh_surface_patches(s->surface);
    size_t count = 0;
    for (size_t n = 0; n < p->count; n++)
        for (int side = 0; side < 2; side++) {
            const size_t one = p->kind[n] >> 16, two = p->kind[n] & 0xffff, thin = side ? two : one,
                         other = side ? one : two;
            if (label_thinness_is_thin(&m[thin]) && !label_thinness_is_thin(&m[other]))
                out[count++] = (thin_side){thin, other, n};
        }
    qsort(out, count, sizeof *out, by_labels);
    return count;
}

/* Among the sides of one thin label, which start at `first`, finds the other label with the largest total
 * area; of equal ones, the one whose last patch comes first. Returns the index of the next label's sides. */
static size_t choose_largest(const label_surface *s, const thin_side *side, size_t count, size_t first,
                             size_t *best)
{
    const field_patches *p = mesh_surface_field(s->surface)->patches;
    double most = 0;
    size_t last = 0, k = first;
    while (k < count && side[k].thin == side[first].thin) {
        const size_t other = side[k].other;
        double area = 0;
        for (; k < count && side[k].thin == side[first].thin && side[k].other == other; k++)
            area += p->patch[side[k].patch].area;
        if (!(area > most) && !(area == most && area > 0 && side[k - 1].patch < last)) continue;
        most = area;
        last = side[k - 1].patch;
        *best = other;
    }
    return k;
}

static void find_thin(label_surface *s)
{
    const label_volume *v = &s->labels;
    thin_side *side = mem_alloc((2 * mesh_surface_patches(s->surface)->count + 1) * sizeof *side);
    const size_t sides = list_sides(s, side);
    size_t solid = 0, at = 0;
    s->thin = mem_alloc((v->count + 1) * sizeof *s->thin);
    for (size_t k = 0; k < v->count; k++)
        solid += (v->material[k].background || v->material[k].voxels > 0) &&
                 !label_thinness_is_thin(&v->material[k]);
    for (size_t k = 0; k < v->count; k++) {
        size_t best = k;
        if (!label_thinness_is_thin(&v->material[k])) continue;
        if (at < sides && side[at].thin == k) at = choose_largest(s, side, sides, at, &best);
        s->thin[s->thin_count++] =
            (label_thin){v->material[k].value, v->material[best].value, best != k && solid > 1,
                         label_thinness_is_row(&v->material[k])};
    }
    free(side);
}

/* Bytes that a job takes for each triangle, points aside: 195 for 1 500 Voronoi cells
 * (measurements/labels/many_labels.py). */
enum { TRIANGLE_BYTES = 200 };

static bool make_surface(const label_surface_request *r, label_surface *s, error *e)
{
    const wanted_pairs wanted = {r->spec, &s->labels};
    mesh_notes unused = {0};
    label_mesh made = {0};
    mesh_patches patches = {0};
    if (!label_mesh_make(&s->labels, r->spec->smooth, r->spec->interface_count ? is_wanted : NULL, &wanted,
                         r->memory_limit / TRIANGLE_BYTES, r->pool, &made, e))
        return false;
    label_thinness_find(&s->labels, r->pool);
    free(s->labels.at);
    s->labels.at = NULL;
    const double spacing = r->spacing > 0 ? r->spacing
                           : r->count > 0 ? packing_spacing(mesh_area(&made.m), r->count)
                                          : INFINITY;
    const mesh_patches_params params = {.spacing = spacing, .kind = made.kind, .pool = r->pool};
    bool ok = mesh_patches_make(&made.m, &params, &unused, &patches, e);
    patches.has_many_parts = true;
    ok = ok && (s->surface = mesh_surface_new(&patches, spacing, r->memory_limit, r->pool, e)) != NULL;
    label_mesh_free(&made);
    if (ok) find_thin(s);
    return ok;
}

label_surface *label_surface_open(const label_surface_request *request, error *e)
{
    label_surface *s = mem_alloc(sizeof *s);
    s->warnings = request->from->warnings;
    if (label_volume_read(request->from, request->spec, request->memory_limit, &s->labels, e) &&
        label_majority_apply(&s->labels, request->spec->majority, request->memory_limit, request->pool, e) &&
        make_surface(request, s, e))
        return s;
    label_surface_close(s);
    return NULL;
}

void label_surface_close(label_surface *s)
{
    if (!s) return;
    mesh_surface_free(s->surface);
    label_volume_free(&s->labels);
    free(s->thin);
    free(s);
}

const mesh_surface *label_surface_triangles(const label_surface *s)
{
    return s->surface;
}

const field *label_surface_field(const label_surface *s)
{
    return mesh_surface_field(s->surface);
}

vec3 label_surface_nearest(const label_surface *s, vec3 x)
{
    return mesh_surface_nearest(s->surface, x);
}

const mesh_patches *label_surface_patches(const label_surface *s)
{
    return mesh_surface_patches(s->surface);
}

size_t label_surface_bytes(const label_surface *s)
{
    return s ? mesh_surface_bytes(s->surface) : 0;
}

void label_surface_sides(const label_surface *s, uint32_t patch, int64_t out[2])
{
    const uint32_t kind = mesh_surface_patches(s->surface)->kind[patch];
    out[0] = s->labels.material[kind >> 16].value;
    out[1] = s->labels.material[kind & 0xffff].value;
}

uint32_t (*label_surface_materials(const label_surface *s, const char *what, error *e))[2]
{
    const mesh_patches *p = mesh_surface_patches(s->surface);
    uint32_t(*out)[2] = mem_array(p->count, sizeof *out, what, e);
    for (uint32_t k = 0; out && k < p->count; k++) { /* a kind consists of two materials, 16 bits each */
        out[k][0] = p->kind[k] >> 16;
        out[k][1] = p->kind[k] & 0xffff;
    }
    return out;
}

size_t label_surface_labels(const label_surface *s, size_t most, int64_t *out)
{
    size_t count = 0;
    for (size_t k = 0; k < s->labels.count; k++) {
        if (s->labels.material[k].background || s->labels.material[k].voxels == 0) continue;
        if (count < most) out[count] = s->labels.material[k].value;
        count++;
    }
    return count;
}

/* The patches between two labels. */
typedef struct interface {
    uint32_t kind;
    size_t components;
    double area;
} interface;

static int by_kind(const void *left, const void *right)
{
    const interface *a = left, *b = right;
    return (a->kind > b->kind) - (a->kind < b->kind);
}

static void put_interfaces(const label_surface *s, json *members)
{
    const field_patches *p = mesh_surface_field(s->surface)->patches;
    const uint32_t *kind = mesh_surface_patches(s->surface)->kind;
    json *list = json_put_array(members, "interfaces");
    interface *all = mem_alloc(p->count * sizeof *all);
    for (size_t k = 0; k < p->count; k++) all[k] = (interface){kind[k], 1, p->patch[k].area};
    qsort(all, p->count, sizeof *all, by_kind);
    for (size_t k = 0, n; k < p->count; k = n) {
        for (n = k + 1; n < p->count && all[n].kind == all[k].kind; n++) {
            all[k].area += all[n].area;
            all[k].components++;
        }
        json *told = json_append_object(list), *labels = json_put_array(told, "labels");
        json_append_number(labels, (double)s->labels.material[all[k].kind >> 16].value);
        json_append_number(labels, (double)s->labels.material[all[k].kind & 0xffff].value);
        json_put_number(told, "area", all[k].area);
        json_put_integer(told, "components", (int64_t)all[k].components);
    }
    free(all);
}

const label_thin *label_surface_thin(const label_surface *s, size_t *count)
{
    *count = s->thin_count;
    return s->thin;
}

/* A label is ragged if its number of thin voxels exceeds this fraction of the number of faces of a ball with
 * the same volume. Balls and ellipsoids: at most 0.08 for a radius of 5 voxels, 0.024 for 10. Labels of a
 * frog whose slices do not match: 0.15 to 0.45. */
static const double RAGGED = 0.1;

bool label_surface_is_ragged(const label_surface *s, double radius)
{
    double side[3];
    const double least = label_volume_sides(&s->labels, side),
                 unit = side[0] * side[1] * side[2] / (least * least * least);
    const label_material *largest = s->labels.material;
    size_t ragged = 0, all = 0;
    for (size_t k = 1; k < s->labels.count; k++)
        if (s->labels.material[k].voxels > largest->voxels) largest = &s->labels.material[k];
    for (size_t k = 0; k < s->labels.count; k++) {
        const label_material *m = &s->labels.material[k];
        if (m == largest || m->background || m->voxels == 0 || label_thinness_is_thin(m)) continue;
        /* radius of the ball, in voxels */
        const double own = elementary_cbrt(3 / (4 * M_PI) * (double)m->voxels);
        ragged += (double)m->thin > RAGGED * 4 * M_PI * own * own && own * elementary_cbrt(unit) >= radius;
        all++;
    }
    return 2 * ragged > all;
}

double label_surface_voxel(const label_surface *s)
{
    double side[3];
    return label_volume_sides(&s->labels, side);
}

/* A label that loses more than this fraction of its voxels by the majority filter is named in a warning. */
static const double MUCH = 0.25;

static void warn_of_taken(const label_volume *v, json *warnings)
{
    enum { MOST_NAMED = 10 };
    size_t count = 0;
    char *names = mem_strdup("");
    for (size_t k = 0; k < v->count; k++) {
        const label_material *m = &v->material[k];
        const double taken = m->before > 0 ? 1 - (double)m->voxels / (double)m->before : 0;
        if (!m->asked || taken <= MUCH || ++count > MOST_NAMED) continue;
        char *more = mem_printf(m->voxels > 0 ? "%s%s%lld (%.0f %%)" : "%s%s%lld (all)", names,
                                count > 1 ? ", " : "", (long long)m->value, 100 * taken);
        free(names);
        names = more;
    }
    char *words =
        mem_printf("/surface/labels/majority removes more than a quarter of the voxels of %zu label%s: %s%s",
                   count, count == 1 ? "" : "s", names, count > MOST_NAMED ? " and others" : "");
    if (count > 0) json_append_string(warnings, words);
    free(words);
    free(names);
}

void label_surface_describe(const label_surface *s, json *surface, json *warnings)
{
    for (uint32_t k = 0; k < s->warnings.count; k++) json_append_string(warnings, s->warnings.text[k]);
    json *members = json_put_object(surface, "labels"), *list = json_put_array(members, "materials");
    json_put_integer(members, "triangles", (int64_t)mesh_surface_patches(s->surface)->m.triangle_count);
    for (size_t k = 0; k < s->labels.count; k++) {
        const label_material *m = &s->labels.material[k];
        json *material = json_append_object(list);
        json_put_integer(material, "label", m->value);
        json_put_integer(material, "voxels", (int64_t)m->voxels);
        json_put_integer(material, "thin_voxels", (int64_t)m->thin);
        json_put_bool(material, "background", m->background);
    }
    if (s->labels.changed > 0) json_put_integer(members, "changed_voxels", (int64_t)s->labels.changed);
    warn_of_taken(&s->labels, warnings);
    label_thinness_warn(&s->labels, warnings);
    put_interfaces(s, members);
}
