// SPDX-License-Identifier: Apache-2.0
#include "job/phases/attributes.h"

#include <inttypes.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <unistd.h>

#include "base/core/memory.h"
#include "base/core/precision.h"
#include "io/points/column.h"
#include "io/points/property.h"
#include "io/points/writers.h"
#include "geometry/space/affine.h"
#include "job/phases/instances.h"
#include "files/sent_file.h"

struct attributes_entry {
    const spec_attribute *spec; /* NULL: a property of points on patches, or a given attribute */
    bool is_given;              /* its values are already known */
    char *name;
    int fd; /* descriptor of its file, or -1 */
    attribute_request request;
    exr_stack_params stack; /* if the surface is an EXR stack */
    slices_files files;
    attribute_counts counts;
    bool is_far;        /* many points are far from the mesh of its file */
    int place;          /* for positions on a mesh: the index of the array (ATTACHMENT_MESH ...); otherwise
                         * -1 */
    double distance;    /* for positions on meshes: largest distance of a point from its stored position, in
                         * spacings */
    double least, most; /* range of the components; for vectors, of each component */
};

/* ---- files and their transforms ---- */

static const char *file_of(const spec_surface *s)
{
    return s->exr.count > 0                 ? s->exr.path
           : s->kind == SPEC_SURFACE_VDB    ? s->vdb.path
           : s->kind == SPEC_SURFACE_MESH   ? s->mesh.path
           : s->kind == SPEC_SURFACE_VOLUME ? s->volume.path
                                            : NULL;
}

/* The first part of the surface that uses this file (NULL: any file), and the map from its space to world
 * space. */
static const spec_surface *find_part(const spec_surface *s, const char *path, double m[3][4])
{
    const char *own = file_of(s);
    if (own && (!path || strcmp(own, path) == 0)) return s;
    if (s->kind == SPEC_SURFACE_TRANSFORM) surface_append_transform(s, m);
    for (size_t k = 0; k < s->part_count; k++) {
        double below[3][4];
        memcpy(below, m, sizeof below);
        const spec_surface *found = find_part(s->parts[k], path, below);
        if (!found) continue;
        memcpy(m, below, sizeof below);
        return found;
    }
    return NULL;
}

/* The map of a file that no part of the surface uses: the transforms that move the whole surface, outside
 * any combination. */
static void place_beside(const spec_surface *s, double m[3][4])
{
    for (; s->part_count == 1; s = s->parts[0])
        if (s->kind == SPEC_SURFACE_TRANSFORM) surface_append_transform(s, m);
}

/* Opens a file that another file refers to, relative to that file. */
static int open_beside(void *context, const char *path, error *e)
{
    source *from = context;
    const int fd = source_open_file(from, path, e);
    from->lacks_file |= fd < 0;
    return fd;
}

static const double world[3][4] = {{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}};

static bool open_file(const spec_attribute *a, const spec *s, source *from, attributes_entry *out, error *e)
{
    bool beside = spec_attribute_has_file(a);
    memcpy(out->request.from_file, world, sizeof world);
    const spec_surface *part = find_part(&s->surface, beside ? a->from : NULL, out->request.from_file);
    if (!part) memcpy(out->request.from_file, world, sizeof world);
    if (!part && !beside)
        return error_set(
            e, ERROR_ATTRIBUTE_MISSING,
            "the surface has no file with an attribute \"%s\": give the path of the file as `from`",
            a->name ? a->name : "");
    if (!part) place_beside(&s->surface, out->request.from_file);
    out->request.is_of_surface = part;
    out->request.path = part ? file_of(part) : a->from;
    out->files = (slices_files){open_beside, from};
    out->request.files = &out->files;
    if (part && part->kind == SPEC_SURFACE_VOLUME && part->exr.has_voxel_size)
        out->request.voxel_size = &part->exr.voxel_size;
    if (part && part->exr.count > 0) {
        out->stack = source_stack(&part->exr, &out->files);
        out->request.stack = &out->stack;
        return true;
    }
    if (source_arrays_find(from->arrays, out->request.path))
        return error_set(e, ERROR_NOT_SUPPORTED,
                         "/attributes: the array \"%s\" has no attributes: sample them at the points",
                         out->request.path);
    out->fd = out->request.fd = source_open_file(from, out->request.path, e);
    return out->fd >= 0;
}

/* Whether an attribute is the position on a mesh. */
static bool is_place(const spec_attribute *a)
{
    return spec_attribute_is(a, SPEC_GEOMETRY_SOURCE);
}

/* ---- locating ---- */

static char *name_of(const spec_attribute *a, int place)
{
    const char *base = a->as ? a->as : a->name;
    char *name = place < 0 ? mem_strdup(base) : mem_printf("%s_%s", base, attachment_arrays[place].suffix);
    for (char *c = name; *c; c++)
        if (!((*c >= 'a' && *c <= 'z') || (*c >= 'A' && *c <= 'Z') || (*c >= '0' && *c <= '9'))) *c = '_';
    return name;
}

/* Names of properties of points on patches: solver_feature and the index of the patch; on interfaces of
 * labels also the two labels. */
static const char *const place_names[] = {"feature", "patch", "label_a", "label_b"};
/* Name of the property that marks given points that are kept. */
static const char kept_name[] = "kept";
enum { PLACES = 2, PLACES_OF_LABELS = sizeof place_names / sizeof *place_names };

static size_t place_count(const source *from)
{
    if (from->whole.labels) return PLACES_OF_LABELS;
    return from->field && from->field->patches ? PLACES : 0;
}

static bool check_name(const spec *s, const attributes *a, size_t index, error *e)
{
    const char *name = a->entries[index].name;
    /* properties that the points have already */
    bool moves = s->coherent && strcmp(name, "velocity") == 0;
    bool has_row = s->coherent && s->has_order && strcmp(name, "row") == 0;
    bool turns = s->has_orient && columns_is_of_orient(name);
    if (columns_is_own(name) || moves || has_row || turns || strlen(name) > 63 ||
        (*name >= '0' && *name <= '9'))
        return error_set(e, ERROR_SPEC_INVALID,
                         "the attribute name \"%.80s\" is reserved or empty: give another one as `as`", name);
    for (size_t k = 0; k < index; k++)
        if (strcasecmp(a->entries[k].name, name) == 0) /* glTF converts names to upper case */
            return error_set(e, ERROR_SPEC_INVALID,
                             "two attributes have the name \"%s\": give one of them another name as `as`",
                             name);
    return true;
}

static bool find_geometry(const spec_attribute *a, const source *from, point_attribute *out, error *e)
{
    bool part = strcmp(a->name, "part") == 0;
    if (strcmp(a->name, SPEC_GEOMETRY_WEIGHT) == 0) {
        out->kind = POINT_ATTRIBUTE_FLOAT;
        out->components = 1;
        out->is_double = true;
        return true;
    }
    out->kind = part ? POINT_ATTRIBUTE_INT : POINT_ATTRIBUTE_VECTOR;
    out->components = part ? 1 : 3;
    return !part || source_part_count(from) > 1 ||
           error_set(e, ERROR_ATTRIBUTE_MISSING,
                     "the surface is not a combination, so its points have no part: remove this attribute");
}

static bool find_one(const spec *s, source *from, size_t memory_limit, attributes_entry *entry,
                     point_attribute *out, error *e)
{
    static const stencil_kind stencils[] = {[SPEC_INTERPOLATION_LINEAR] = STENCIL_LINEAR,
                                            [SPEC_INTERPOLATION_CUBIC] = STENCIL_CUBIC,
                                            [SPEC_INTERPOLATION_NEAREST] = STENCIL_NEAREST};
    static const point_attribute_kind kinds[] = {
        [SPEC_ATTRIBUTE_FLOAT] = POINT_ATTRIBUTE_FLOAT,   [SPEC_ATTRIBUTE_INT] = POINT_ATTRIBUTE_INT,
        [SPEC_ATTRIBUTE_VECTOR] = POINT_ATTRIBUTE_VECTOR, [SPEC_ATTRIBUTE_NORMAL] = POINT_ATTRIBUTE_NORMAL,
        [SPEC_ATTRIBUTE_COLOR] = POINT_ATTRIBUTE_COLOR,   [SPEC_ATTRIBUTE_UV] = POINT_ATTRIBUTE_UV};
    const spec_attribute *a = entry->spec;
    attribute_request *r = &entry->request;
    out->name = entry->name;
    if (entry->place >= 0) {
        const attachment_array *array = &attachment_arrays[entry->place];
        out->kind = array->kind;
        out->components = array->components;
        out->is_double = array->is_double;
        return true;
    }
    if (strcmp(a->from, SPEC_FROM_GEOMETRY) == 0) return find_geometry(a, from, out, e);
    if (!open_file(a, s, from, entry, e)) return false;
    r->memory_limit = entry->stack.memory_limit = memory_limit;
    char sent[STORE_INPUT_NAME_SIZE];
    r->is_sent = r->path && sent_file_match(r->path, sent);
    r->image_pixels = (uint64_t)s->image_pixels;
    r->image_scans = (uint64_t)s->image_scans;
    r->name = a->name;
    r->has_kind = a->type != SPEC_ATTRIBUTE_AUTO;
    if (r->has_kind) r->kind = kinds[a->type];
    r->stencil = r->has_kind && r->kind == POINT_ATTRIBUTE_INT ? STENCIL_NEAREST : stencils[a->interpolation];
    if (!attribute_find(r, &out->kind, &out->components, e)) {
        if (r->path) sent_file_explain_header(r->path, e);
        return false;
    }
    r->kind = out->kind;
    return true;
}

/* Whether the attribute of this name, which may be NULL, is that of the curvature. */
static bool is_defined(const char *name)
{
    return name && strcmp(name, POINTS_KAPPA_DEFINED) == 0;
}

/* Whether the preview shows the curvature, or where it is defined. */
static bool shows_curvature(const spec *s)
{
    const bool in_exr = s->has_preview_exr && s->preview_channels == SPEC_CHANNELS_ALL;
    return s->has_preview && (in_exr || (s->preview_attribute ? is_defined(s->preview_attribute)
                                                              : s->preview_color == SPEC_COLOR_CURVATURE));
}

bool attributes_have_curvature(const spec *s)
{
    bool has = shows_curvature(s) || is_defined(s->orient.twist) || is_defined(s->instancer.scale) ||
               columns_have_curvature((const char *const *)s->ply_properties, s->ply_property_count);
    for (int k = 0; k < FILE_FORMATS; k++)
        has |= writers[k].write[WRITER_POINTS] && (s->points_in[k] || s->mesh_in[k]);
    for (size_t k = 0; k < s->attribute_count; k++)
        has |= spec_attribute_is(&s->attributes[k], SPEC_GEOMETRY_DIRECTION1) ||
               spec_attribute_is(&s->attributes[k], SPEC_GEOMETRY_DIRECTION2);
    return has;
}

bool attributes_check_named(const spec *s, const points *set, error *e)
{
    if (s->has_preview && s->preview_attribute &&
        !property_find_attribute(set->attributes, set->attribute_count, s->preview_attribute))
        return property_refuse_missing(set->attributes, set->attribute_count, "/output/preview/attribute",
                                       s->preview_attribute, e);
    return instances_check(s, set, e);
}

/* Checks that the points will have what the outputs require, with a set of 0 points that has the same
 * arrays. */
static bool check_outputs(const spec *s, const attributes *a, error *e)
{
    static const vec3 vector;
    static const double number;
    static const uint32_t whole;
    columns unused;
    points set = {.position = &vector,
                  .normal = &vector,
                  .kappa = &number,
                  .kappa1 = &number,
                  .kappa2 = &number,
                  .alpha = &number,
                  .energy = &number,
                  .spacing = &number,
                  .is_graded = true,
                  .spacing_local = &number,
                  .color = &vector};
    if (s->coherent) {
        set.id = &whole;
        set.velocity = &vector;
    }
    if (s->has_alpha && !(s->alpha.has_scale && s->alpha.scale.world == 0 && s->alpha.scale.spacings == 0))
        set.kappa_scale = &number;
    set.attribute_count = a->count;
    set.attributes = a->values;
    for (size_t k = 0; k < a->count; k++)
        if (a->values[k].kind == POINT_ATTRIBUTE_UV) set.uv = &number;
    static const double turn[4];
    if (s->has_orient) set.orient = turn;
    if (!attributes_check_named(s, &set, e)) return false;
    return columns_choose(&set, (const char *const *)s->ply_properties, s->ply_property_count, &unused, e) ||
           error_prefix(e, "/output/ply/properties");
}

/* Adds `kappa_defined`, if the surface has a mesh, results have the curvature, and no attribute has this name. */
static void add_defined(const spec *s, const source *from, attributes *out)
{
    if (!point_curvature_is_special(from) || !attributes_have_curvature(s)) return;
    for (size_t k = 0; k < out->count; k++)
        out->has_own_defined |= strcasecmp(out->entries[k].name, POINTS_KAPPA_DEFINED) == 0;
    if (out->has_own_defined) return;
    out->entries[out->count] =
        (attributes_entry){.name = mem_strdup(POINTS_KAPPA_DEFINED), .fd = -1, .place = -1};
    out->values[out->count] =
        (point_attribute){out->entries[out->count].name, POINT_ATTRIBUTE_INT, 1, NULL, false};
    out->count++;
}

bool attributes_find(const spec *s, source *from, size_t memory_limit, attributes *out, error *e)
{
    const size_t of_patches = place_count(from),
                 places = of_patches + (s->has_points && s->points.mode == SPEC_POINTS_KEEP);
    out->count = places + s->attribute_count;
    for (size_t k = 0; k < s->attribute_count; k++)
        if (is_place(&s->attributes[k])) out->count += ATTACHMENT_ARRAYS - 1;
    out->entries = mem_alloc((out->count + 1) * sizeof *out->entries); /* one more: add_defined */
    out->values = mem_alloc((out->count + 1) * sizeof *out->values);
    for (size_t k = 0; k < places; k++) {
        const char *name = k < of_patches ? place_names[k] : kept_name;
        out->entries[k] = (attributes_entry){.name = mem_strdup(name), .fd = -1, .place = -1};
        out->values[k] = (point_attribute){out->entries[k].name, POINT_ATTRIBUTE_INT, 1, NULL, false};
    }
    for (size_t i = 0, k = places; i < s->attribute_count; i++) {
        const spec_attribute *a = &s->attributes[i];
        const int begin = is_place(a) ? 0 : -1, end = is_place(a) ? ATTACHMENT_ARRAYS : 0;
        for (int place = begin; place < end; place++)
            out->entries[k++] =
                (attributes_entry){.spec = a, .name = name_of(a, place), .fd = -1, .place = place};
    }
    attribute_mesh *last = NULL;
    bool ok = true;
    for (size_t k = places; ok && k < out->count; k++) {
        attributes_entry *entry = &out->entries[k];
        entry->request.last = &last;
        ok = (check_name(s, out, k, e) &&
              (entry->place < 0 || out->meshes.file ||
               surface_meshes_open(&s->surface, from, &out->meshes, e)) &&
              find_one(s, from, memory_limit, entry, &out->values[k], e)) ||
             error_prefix(e, "/attributes/%td", entry->spec - s->attributes);
    }
    attribute_forget(&last);
    if (ok) add_defined(s, from, out);
    return ok && check_outputs(s, out, e);
}

/* The index of the entry with a name that is not a given attribute; a->count: there is none. */
static size_t find_located(const attributes *a, const char *name)
{
    size_t k = 0;
    while (k < a->count && (!a->entries[k].name || strcmp(a->entries[k].name, name) != 0)) k++;
    return k;
}

/* The index of `kappa_defined`, unless a spec's attribute has this name; a->count: there is none. */
static size_t find_own_defined(const attributes *a)
{
    size_t k = 0;
    while (k < a->count && (a->entries[k].spec || strcmp(a->entries[k].name, POINTS_KAPPA_DEFINED) != 0 ||
                            a->values[k].kind != POINT_ATTRIBUTE_INT || a->values[k].components != 1))
        k++;
    return k;
}

/* Makes an attribute the last one. */
static void move_to_end(attributes *a, size_t k)
{
    if (k >= a->count) return;
    const attributes_entry entry = a->entries[k];
    const point_attribute value = a->values[k];
    const size_t behind = a->count - k - 1;
    memmove(a->entries + k, a->entries + k + 1, behind * sizeof *a->entries);
    memmove(a->values + k, a->values + k + 1, behind * sizeof *a->values);
    a->entries[a->count - 1] = entry;
    a->values[a->count - 1] = value;
}

void attributes_adopt(attributes *a, const point_attribute *given, size_t count)
{
    const size_t most = a->count + count;
    attributes_entry *entries = mem_alloc(most * sizeof *entries);
    point_attribute *values = mem_alloc(most * sizeof *values);
    size_t n = 0;
    for (size_t k = 0; k < count; k++, n++) {
        const size_t located = find_located(a, given[k].name);
        if (located < a->count) {
            entries[n] = a->entries[located];
            values[n] = a->values[located];
            a->entries[located].name = NULL;
            free((char *)given[k].name);
            free((double *)given[k].values);
            continue;
        }
        entries[n] =
            (attributes_entry){.is_given = true, .name = (char *)given[k].name, .fd = -1, .place = -1};
        values[n] = given[k];
    }
    for (size_t k = 0; k < a->count; k++) {
        if (!a->entries[k].name) continue; /* a given attribute */
        entries[n] = a->entries[k];
        values[n++] = a->values[k];
    }
    free(a->entries);
    free(a->values);
    a->entries = entries;
    a->values = values;
    a->count = n;
    move_to_end(a, find_own_defined(a));
}

/* ---- values ---- */

/* Values of a property of points on patches. */
static void read_place(const char *name, const source *from, const solver_points *solved, double *values)
{
    size_t which = 0;
    while (strcmp(name, place_names[which]) != 0) which++;
    for (size_t i = 0; i < solved->count; i++) {
        int64_t sides[2] = {0, 0};
        if (which >= PLACES) label_surface_sides(from->whole.labels, solved->patch[i], sides);
        values[i] = which == 0       ? (double)solved->feature[i]
                    : which < PLACES ? (double)solved->patch[i]
                                     : (double)sides[which - PLACES];
    }
}

/* The first principal direction in the tangent plane of a point, or the second one at a right angle to it. The
 * direction of a mesh is that of the smooth surface, whose normal differs from the point's on coarse meshes. 0, of an
 * undefined direction, stays 0. */
static vec3 tangential(vec3 first, vec3 normal, bool is_first)
{
    const vec3 flat = vec3_axpy(-vec3_dot(first, normal), normal, first);
    if (!(vec3_norm2(flat) > 0)) return (vec3){0, 0, 0};
    return is_first ? vec3_unit(flat) : vec3_cross(normal, vec3_unit(flat));
}

/* Values of the surface itself, from what the job has set in *a. */
static void read_geometry(const char *name, const source *from, const attributes *a, const points *set,
                          double *values)
{
    const bool is_first = strcmp(name, SPEC_GEOMETRY_DIRECTION1) == 0;
    const point_curvature *curvature = a->curvature;
    if (strcmp(name, SPEC_GEOMETRY_WEIGHT) == 0) {
        memcpy(values, a->weight, set->count * sizeof *values);
        return;
    }
    for (size_t i = 0; i < set->count; i++) {
        field_sample sample = {0};
        vec3 d = {0, 0, 0};
        if (strcmp(name, "part") == 0) {
            values[i] = (double)source_part_at(from, set->position[i]);
            continue;
        }
        if (curvature && curvature[i].is_special) {
            d = curvature[i].direction1;
            if (from->turned) d = placement_turn_normal(from->turned, d);
        } else if (field_sample_at(source_world(from), set->position[i], FIELD_HESSIAN, &sample))
            d = field_principal_direction(&sample, true);
        d = tangential(d, set->normal[i], is_first);
        memcpy(values + 3 * i, &d, 3 * sizeof *values);
    }
}

static void note_range(attributes_entry *entry, const double *values, size_t count)
{
    entry->least = INFINITY;
    entry->most = -INFINITY;
    for (size_t i = 0; i < count; i++) {
        entry->least = fmin(entry->least, values[i]);
        entry->most = fmax(entry->most, values[i]);
    }
}

/* Fills in the arrays of the positions on meshes, of which entry k is the last. */
static bool read_attachment(attributes *a, size_t k, size_t memory_limit, const points *set, error *e)
{
    const size_t first = k + 1 - ATTACHMENT_ARRAYS;
    double *values[ATTACHMENT_ARRAYS];
    attachment_counts counts;
    for (size_t n = 0; n < ATTACHMENT_ARRAYS; n++) values[n] = (double *)a->values[first + n].values;
    if (!attachment_find(a->meshes.file, a->meshes.count, memory_limit, set->count, set->position,
                         set->normal, set->spacing, values, &counts, e))
        return false;
    for (size_t n = 0; n < ATTACHMENT_ARRAYS; n++) {
        attributes_entry *entry = &a->entries[first + n];
        note_range(entry, values[n], set->count * (size_t)a->values[first + n].components);
        entry->distance = counts.distance;
        entry->counts.outside = counts.outside;
    }
    return true;
}

static bool read_one(const attributes *a, size_t k, const source *from, const solver_points *solved,
                     size_t memory_limit, const points *set, error *e)
{
    attributes_entry *entry = &a->entries[k];
    point_attribute *out = &a->values[k];
    size_t numbers = set->count * (size_t)out->components;
    if (entry->is_given) {
        note_range(entry, out->values, numbers);
        return true;
    }
    double *values = mem_array(set->count, (size_t)out->components * sizeof *values, "an attribute", e);
    free((double *)out->values);
    out->values = values;
    entry->counts = (attribute_counts){0};
    entry->request.memory_limit = memory_limit;
    entry->request.spacing = set->spacing;
    entry->stack.memory_limit = memory_limit;
    if (!values) return false;
    if (entry->place >= 0) return true; /* read_attachment fills it in */
    if (!entry->spec && strcmp(entry->name, kept_name) == 0)
        for (size_t i = 0; i < set->count; i++) values[i] = a->kept[i];
    else if (!entry->spec && strcmp(entry->name, POINTS_KAPPA_DEFINED) == 0)
        for (size_t i = 0; i < set->count; i++)
            values[i] = !a->curvature || !a->curvature[i].is_special || a->curvature[i].is_defined;
    else if (!entry->spec)
        read_place(entry->name, from, solved, values);
    else if (!entry->request.path)
        read_geometry(entry->spec->name, from, a, set, values);
    else if (!attribute_read(&entry->request, set->count, set->position, values, &entry->counts, e))
        return false;
    entry->is_far = (double)entry->counts.far > SOURCE_FAR_SHARE * (double)set->count;
    for (size_t i = 0; out->kind == POINT_ATTRIBUTE_INT && i < numbers; i++) values[i] = round(values[i]);
    note_range(entry, values, numbers);
    if (out->kind == POINT_ATTRIBUTE_INT &&
        (entry->least < -PRECISION_WHOLE_MOST || entry->most > PRECISION_WHOLE_MOST))
        return error_set(
            e, ERROR_INPUT_UNSUPPORTED,
            "its whole numbers, from %.0f to %.0f, exceed what a double represents exactly: give "
            "the type float",
            entry->least, entry->most);
    return true;
}

/* Sets color and uv, which formats need as separate arrays, from the first attribute of each kind. */
static bool derive(attributes *a, points *set, error *e)
{
    free(a->color);
    free(a->uv);
    a->color = NULL;
    a->uv = NULL;
    for (size_t k = 0; k < a->count; k++) {
        const point_attribute *v = &a->values[k];
        bool color = v->kind == POINT_ATTRIBUTE_COLOR && !a->color;
        if (!color && (v->kind != POINT_ATTRIBUTE_UV || a->uv)) continue;
        size_t kept = color ? 3 : 2, stride = (size_t)v->components;
        double *copy = mem_array(set->count, kept * sizeof *copy, "an attribute", e);
        if (!copy) return false;
        for (size_t i = 0; i < set->count; i++)
            memcpy(copy + kept * i, v->values + stride * i, kept * sizeof *copy);
        if (color)
            a->color = (vec3 *)copy;
        else
            a->uv = copy;
    }
    set->attribute_count = a->count;
    set->attributes = a->values;
    const size_t defined = find_own_defined(a);
    if (defined < a->count) set->kappa_defined = a->values[defined].values;
    set->color = a->color;
    set->uv = a->uv;
    return true;
}

bool attributes_read(attributes *a, const source *from, const solver_points *solved, size_t memory_limit,
                     points *set, error *e)
{
    attribute_mesh *last = NULL;
    bool ok = true;
    for (size_t k = 0; ok && k < a->count; k++) {
        a->entries[k].request.last = &last;
        ok =
            (read_one(a, k, from, solved, memory_limit, set, e) &&
             (a->entries[k].place != ATTACHMENT_ARRAYS - 1 || read_attachment(a, k, memory_limit, set, e))) ||
            error_prefix(e, "attribute \"%s\"", a->entries[k].name);
    }
    attribute_forget(&last);
    return ok && derive(a, set, e);
}

bool attributes_permute(attributes *a, const uint32_t *order, points *set, error *e)
{
    for (size_t k = 0; k < a->count; k++) {
        const size_t width = (size_t)a->values[k].components;
        const double *from = a->values[k].values;
        double *to = mem_array(set->count, width * sizeof *to, "an attribute", e);
        if (!to) return false;
        for (size_t i = 0; i < set->count; i++)
            memcpy(to + width * i, from + width * order[i], width * sizeof *to);
        free((double *)from);
        a->values[k].values = to;
    }
    return derive(a, set, e);
}

/* ---- report ---- */

static void warn(json *warnings, const attributes_entry *entry, size_t count, const char *what)
{
    if (count == 0) return;
    char *text = mem_printf("attribute \"%s\": %zu points %s", entry->name, count, what);
    json_append_string(warnings, text);
    free(text);
}

/* Describes the meshes that have points, with their topology, which a later attachment compares. */
static void describe_meshes(const attributes *a, const attributes_entry *entry, json *object, json *warnings)
{
    json *list = json_put_array(object, "meshes");
    json_put_number(object, "distance", entry->distance);
    for (size_t k = 0; k < a->meshes.count; k++) {
        const attachment_file *file = &a->meshes.file[k];
        json *of_mesh = json_append_object(list);
        char *hash = mem_printf("%016" PRIx64, file->topology.hash);
        json_put_string(of_mesh, "path", file->path);
        json_put_integer(of_mesh, "vertices", (int64_t)file->topology.vertices);
        json_put_integer(of_mesh, "faces", (int64_t)file->topology.faces);
        json_put_integer(of_mesh, "corners", (int64_t)file->topology.corners);
        json_put_string(of_mesh, "topology", hash);
        free(hash);
    }
    warn(warnings, entry, entry->counts.outside,
         "lie on no mesh, such as those on caps of a region or on other parts: their numbers are -1");
}

json *attributes_describe(const attributes *a, json *warnings)
{
    static const char *const types[] = {"float", "int", "vector", "normal", "color", "uv"};
    if (a->count == 0) return NULL;
    if (a->has_own_defined)
        json_append_string(
            warnings,
            "attribute \"kappa_defined\" has values of the spec: those of the curvature are left out. "
            "Give the attribute another name as `as`.");
    json *list = json_new_array();
    for (size_t k = 0; k < a->count; k++) {
        const attributes_entry *entry = &a->entries[k];
        json *object = json_append_object(list);
        json_put_string(object, "name", entry->name);
        json_put_string(object, "type", types[a->values[k].kind]);
        json_put_integer(object, "components", a->values[k].components);
        if (entry->request.path) json_put_string(object, "path", entry->request.path);
        json_put_number(object, "minimum", entry->least);
        json_put_number(object, "maximum", entry->most);
        json_put_integer(object, "outside", (int64_t)entry->counts.outside);
        if (entry->place == ATTACHMENT_MESH) describe_meshes(a, entry, object, warnings);
        if (entry->place >= 0) continue;
        warn(warnings, entry, entry->counts.outside,
             "are outside the data of the file: they have its background value, or the nearest one");
        if (entry->is_far)
            warn(warnings, entry, entry->counts.far,
                 "are farther than a spacing from the mesh of the file: they have the values of its nearest "
                 "places. Check the position and the units of the mesh");
        warn(warnings, entry, entry->counts.not_finite,
             "have a value that is not finite: it is written as 0");
        for (uint32_t i = 0; i < entry->counts.warnings.count; i++) {
            char *text = mem_printf("attribute \"%s\": %s", entry->name, entry->counts.warnings.text[i]);
            json_append_string(warnings, text);
            free(text);
        }
    }
    return list;
}

double attributes_bytes_per_point(const attributes *a)
{
    size_t numbers = 0;
    for (size_t k = 0; k < a->count; k++) numbers += (size_t)a->values[k].components;
    return (double)(numbers * sizeof(double));
}

void attributes_free(attributes *a)
{
    for (size_t k = 0; k < a->count; k++) {
        free(a->entries[k].name);
        if (a->entries[k].fd >= 0) close(a->entries[k].fd);
        free((double *)a->values[k].values);
    }
    surface_meshes_close(&a->meshes);
    free(a->entries);
    free(a->values);
    free(a->color);
    free(a->uv);
    *a = (attributes){0};
}
