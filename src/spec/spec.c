#include "spec/spec.h"

#include <assert.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "base/frames.h"
#include "base/memory.h"
#include "spec/reading.h"
#include "spec/rules.h"
#include "spec/spec_table.h"
#include "spec/surface.h"
#include "spec/frame_values.h"
#include "spec/values.h"

static void read_group(reading *r, const json_at *at, const char *group, json *normal);

static const char *const surface_keys[] = {SPEC_SURFACE_LIST(WORDS_TEXT, )};

/* Sets the kind of surface that a member of /surface makes; false if it makes none. */
static bool set_surface_kind(reading *r, const char *key)
{
    for (size_t k = 0; k < sizeof surface_keys / sizeof surface_keys[0]; k++) {
        if (strcmp(key, surface_keys[k]) != 0) continue;
        r->surface->kind = (spec_surface_kind)k;
        return true;
    }
    return false;
}

/* One more part of the surface at hand; or one that is none and goes to *stored. */
static void read_part(reading *r, const json_at *at, spec_surface **stored, json *normal)
{
    enum { DEEPEST = 16, MOST_SURFACES = 256 };
    spec_surface *whole = r->surface;
    spec_surface *part;
    if (r->depth == DEEPEST || r->surfaces == MOST_SURFACES) {
        reading_add_fault(r, at, "more than %d surfaces, or more than %d levels of nested surfaces",
                          MOST_SURFACES, DEEPEST);
        return;
    }
    part = mem_alloc(sizeof *part);
    if (stored) {
        *stored = part;
    } else {
        whole->parts = mem_resize(whole->parts, (whole->part_count + 1) * sizeof *whole->parts);
        whole->parts[whole->part_count++] = part;
    }
    r->surface = part;
    r->shape_known = false;
    r->depth++;
    r->surfaces++;
    read_group(r, at, "/surface", normal);
    r->depth--;
    r->surface = whole;
}

static void read_parts(reading *r, const json_at *at, const spec_row *row, json *normal)
{
    size_t count = json_size(*at);
    if (json_type_of(*at) != JSON_ARRAY || (double)count < row->low || (double)count > row->high) {
        char given[READING_SHOWN_MAX + 8];
        reading_describe(*at, given);
        reading_add_fault(r, at, "must be an array of %.0f to %.0f surfaces (given %s)", row->low, row->high,
                          given);
        return;
    }
    set_surface_kind(r, spec_row_key(row));
    json *list = json_put_array(normal, spec_row_key(row));
    for (size_t k = 0; k < count; k++) {
        json_at element = json_element(at, k);
        read_part(r, &element, NULL, json_append_object(list));
    }
}

static void note_attribute(spec *s, const json_at *at)
{
    json_at from = json_member(at, "from");
    s->attribute.input_pointer = mem_alloc(sizeof((spec_fault *)0)->pointer);
    json_pointer(&from, s->attribute.input_pointer, sizeof((spec_fault *)0)->pointer);
}

/* Each is read into spec.attribute and goes from there into the list. */
static void read_attributes(reading *r, const json_at *at, const spec_row *row, json *normal)
{
    size_t count = json_size(*at);
    spec *s = r->s;
    if (json_type_of(*at) != JSON_ARRAY || (double)count > row->high) {
        char given[READING_SHOWN_MAX + 8];
        reading_describe(*at, given);
        reading_add_fault(r, at, "must be an array of at most %.0f objects (given %s)", row->high, given);
        return;
    }
    json *list = json_put_array(normal, spec_row_key(row));
    s->attributes = mem_alloc(count * sizeof *s->attributes);
    for (size_t k = 0; k < count; k++) {
        json_at element = json_element(at, k);
        read_group(r, &element, row->pointer, json_append_object(list));
        note_attribute(s, &element);
        s->attributes[s->attribute_count++] = s->attribute;
        s->attribute = (spec_attribute){0};
    }
}

static void read_member(reading *r, const json_at *at, const spec_row *row, json *normal)
{
    if (row->type == SPEC_TYPE_SURFACE)
        read_part(r, at, row->offset == SPEC_NOWHERE ? NULL : reading_target(r, row->offset),
                  json_put_object(normal, spec_row_key(row)));
    else if (row->type == SPEC_TYPE_SURFACES)
        read_parts(r, at, row, normal);
    else if (row->type == SPEC_TYPE_GROUPS)
        read_attributes(r, at, row, normal);
    else
        values_read(r, at, row, normal);
}

static const char *default_of(const reading *r, const spec_row *row)
{
    if (row->offset == offsetof(spec, method) && r->s->has_alpha) return "\"paper\"";
    if (row->offset == offsetof(spec, step) && r->s->minimiser != SPEC_MINIMISER_GRADIENT) return NULL;
    if (row->offset == offsetof(spec, curvature.exponent) && !(r->s->curvature.ratio > 0)) return NULL;
    if (row->offset == offsetof(spec, gradation) && !spec_is_graded(r->s)) return NULL;
    if (row->offset == offsetof(spec, surface.mesh.max_resolution) &&
        (r->surface->mesh.voxel_size > 0 || r->surface->mesh.resolution > 0))
        return NULL;
    if (row->offset == offsetof(spec, camera.up)) return spec_y_up(r->s) ? "[0,1,0]" : "[0,0,1]";
    if (row->offset == offsetof(spec, preview_color)) return r->s->has_alpha ? "\"alpha\"" : "\"curvature\"";
    return row->otherwise;
}

static void read_default(reading *r, const json_at *group, const spec_row *row, json *normal)
{
    const char *otherwise = default_of(r, row);
    if (!otherwise) return;
    json *root = json_parse(otherwise, strlen(otherwise), NULL);
    json_at at = {root, group, spec_row_key(row), 0};
    read_member(r, &at, row, normal);
    json_free(root);
}

static void read_member_group(reading *r, const json_at *at, const spec_row *row, json *normal)
{
    bool on = at->node || !(row->flags & SPEC_OPTIONAL);
    json_at place = *at;
    if (row->flags & SPEC_SWITCH && json_type_of(*at) == JSON_BOOL) {
        on = json_bool(*at, true);
        place.node = NULL; /* true: an object without members */
        if (!on) json_put_bool(normal, spec_row_key(row), false);
    }
    if (row->has != SPEC_NOWHERE) *(bool *)reading_target(r, row->has) = on;
    if (!on) return;
    if (!place.node && row->flags & SPEC_REQUIRED) {
        reading_add_fault(r, at, "is required");
        return;
    }
    read_group(r, &place, row->pointer, json_put_object(normal, spec_row_key(row)));
}

static void read_row(reading *r, const json_at *group, const spec_row *row, json *normal)
{
    json_at at = json_member(group, spec_row_key(row));
    if (row->methods && !(row->methods & 1u << r->s->method)) {
        const char *method = spec_row_find("/solver", "method")->words[r->s->method];
        if (at.node) reading_add_fault(r, &at, "does not belong to the method \"%s\"", method);
        return;
    }
    if (row->type == SPEC_TYPE_GROUP) {
        read_member_group(r, &at, row, normal);
        return;
    }
    if (row->shapes) {
        if (!r->shape_known) return; /* what belongs here is not known; the shape's fault says so */
        if (!(row->shapes & 1u << r->surface->analytic.shape)) {
            const char *shape =
                spec_row_find("/surface/analytic", "shape")->words[r->surface->analytic.shape];
            if (at.node) reading_add_fault(r, &at, "does not belong to the shape \"%s\"", shape);
            return;
        }
    }
    if (at.node)
        read_member(r, &at, row, normal);
    else if (row->flags & SPEC_REQUIRED)
        reading_add_fault(r, &at, "is required");
    else
        read_default(r, group, row, normal);
}

/* Notes which kind of surface a member of /surface makes, and the input file that it names. */
static void note_surface(reading *r, const json_at *at, const char *group)
{
    static const char prefix[] = "/surface/";
    if (strncmp(group, prefix, strlen(prefix)) != 0) return;
    if (!set_surface_kind(r, group + strlen(prefix))) return;
    json_at path = json_member(at, "path");
    if (!path.node || r->surface->input_pointer) return;
    r->surface->input_pointer = mem_alloc(sizeof((spec_fault *)0)->pointer);
    json_pointer(&path, r->surface->input_pointer, sizeof((spec_fault *)0)->pointer);
}

/* Reads the members of a group; a place without a node stands for an object without members. */
static void read_group(reading *r, const json_at *at, const char *group, json *normal)
{
    size_t before = r->total;
    if (at->node && json_type_of(*at) != JSON_OBJECT) {
        char given[READING_SHOWN_MAX + 8];
        reading_describe(*at, given);
        reading_add_fault(r, at, "must be an object (given %s)", given);
        return;
    }
    unsigned skipped = rules_check_names(r, at, group);
    for (size_t i = 0; i < spec_row_count; i++)
        if (spec_row_is_member(&spec_rows[i], group) && !(skipped & 1u << spec_rows[i].choice))
            read_row(r, at, &spec_rows[i], normal);
    note_surface(r, at, group);
    if (r->total == before) rules_check_values(r, at, group);
}

/* ---- the whole ---- */

static void sum_up(const spec_faults *faults, size_t total, error *e)
{
    const spec_fault *fault = &faults->item[0];
    const char *where = *fault->pointer ? fault->pointer : "the spec";
    if (total > 1)
        error_set(e, fault->code, "%s: %s (and %zu more)", where, fault->detail, total - 1);
    else
        error_set(e, fault->code, "%s: %s", where, fault->detail);
}

/* Reads a document that has the values of the index-th frame of `w` (NULL: it has no values by frame) in it. */
static spec *parse(const json *document, const char *group, const frame_values *w, size_t index,
                   spec_faults *faults, error *e)
{
    reading r = {.s = mem_alloc(sizeof(spec))};
    r.surface = &r.s->surface;
    json_at root = json_root(document);
    r.s->normalised = json_new_object();
    if (document)
        read_group(&r, &root, group, r.s->normalised);
    else
        reading_add_fault(&r, &root, "must be an object (given nothing)");
    if (w) frame_values_place_faults(w, index, index > 0, &r.faults);
    if (faults) *faults = r.faults;
    if (r.total == 0) return r.s;
    sum_up(&r.faults, r.total, e);
    spec_free(r.s);
    return NULL;
}

spec *spec_parse_group(const json *document, const char *group, spec_faults *faults, error *e)
{
    return parse(document, group, NULL, 0, faults, e);
}

spec *spec_parse(const json *document, spec_faults *faults, error *e)
{
    frame_values w;
    if (!document || !frame_values_open(document, &w)) return parse(document, "", NULL, 0, faults, e);
    json *copy = json_copy(document);
    bool placed = !frame_values_apply(&w, 0, copy);
    spec *s = parse(placed ? copy : document, "", placed ? &w : NULL, 0, faults, e);
    json_free(copy);
    frame_values_close(&w);
    return s;
}

spec *spec_of_frame(const spec *s, size_t index, spec_faults *faults, error *e)
{
    frame_values w;
    bool swept = frame_values_open(s->normalised, &w);
    assert(s->has_frame_values && swept && index < w.frame_count);
    json *document = frame_values_document(&w, index, s->normalised);
    spec *frame = parse(document, "", &w, index, faults, e);
    json_free(document);
    frame_values_close(&w);
    return frame;
}

bool spec_check_frames(const spec *s, spec_faults *faults, error *e)
{
    frame_values w;
    bool ok = true;
    if (!s->has_frame_values || !frame_values_open(s->normalised, &w)) return true;
    json *frame_only = json_copy(s->normalised); /* without the lists, which are long */
    json_put_null(json_find(frame_only, "/queue"), "by_frame");
    for (size_t i = 1; ok && i < w.frame_count; i++) {
        json *document = frame_values_document(&w, i, frame_only);
        spec *frame = parse(document, "", &w, i, faults, e);
        ok = frame != NULL;
        spec_free(frame);
        json_free(document);
    }
    json_free(frame_only);
    frame_values_close(&w);
    return ok;
}

/* Assets of films and games stand along y, models of CAD and printing and medical volumes along z. Of a combination the
 * first part tells. */
bool spec_y_up(const spec *s)
{
    static const char *const z_up[] = {".stl", ".3mf", ".amf"};
    const spec_surface *first = &s->surface;
    if (s->preview_up != SPEC_UP_AUTO) return s->preview_up == SPEC_UP_Y;
    while (first->part_count > 0) first = first->parts[0];
    if (first->kind != SPEC_SURFACE_MESH) return first->kind == SPEC_SURFACE_VDB;
    const char *ending = strrchr(first->mesh.path, '.');
    for (size_t k = 0; ending && k < sizeof z_up / sizeof *z_up; k++)
        if (strcasecmp(ending, z_up[k]) == 0) return false;
    return true;
}

bool spec_up_is_told(const spec *s)
{
    static const char *const either[] = {".obj", ".off", ".ply", ".stl"};
    if (s->preview_up != SPEC_UP_AUTO || s->frame_count > 0 || s->surface.kind != SPEC_SURFACE_MESH)
        return true;
    const char *ending = strrchr(s->surface.mesh.path, '.');
    for (size_t k = 0; ending && k < sizeof either / sizeof *either; k++)
        if (strcasecmp(ending, either[k]) == 0) return false;
    return true;
}

bool spec_has_other_outputs(const spec *s)
{
    return s->has_preview || s->has_convergence || s->has_mesh || s->has_points_vdb || s->has_points_npz ||
           s->has_points_glb || s->has_points_usda;
}

bool spec_attribute_has_file(const spec_attribute *a)
{
    return strcmp(a->from, SPEC_FROM_SURFACE) != 0 && strcmp(a->from, SPEC_FROM_GEOMETRY) != 0;
}

bool spec_input_at(const spec *s, size_t index, spec_input *out)
{
    if (surface_input_at(&s->surface, &index, out)) return true;
    if (s->region_inside && surface_input_at(s->region_inside, &index, out)) return true;
    if (s->grid.path && index-- == 0) {
        *out = (spec_input){"/sampling/grid/path", s->grid.path};
        return true;
    }
    for (size_t k = 0; k < s->attribute_count; k++) {
        const spec_attribute *a = &s->attributes[k];
        if (!spec_attribute_has_file(a) || index-- > 0) continue;
        *out = (spec_input){a->input_pointer, a->from};
        return true;
    }
    return false;
}

static void set_frame(char **path, int frame)
{
    char *pattern = *path;
    *path = frames_path(pattern, frame);
    free(pattern);
}

void spec_set_frame(spec *s, int frame)
{
    surface_set_frame(&s->surface, frame);
    if (s->region_inside) surface_set_frame(s->region_inside, frame);
    if (s->grid.path) set_frame(&s->grid.path, frame);
    for (size_t k = 0; k < s->attribute_count; k++) set_frame(&s->attributes[k].from, frame);
}

void spec_free(spec *s)
{
    if (!s) return;
    free(s->name);
    surface_free_parts(&s->surface);
    if (s->region_inside) surface_free_parts(s->region_inside);
    free(s->region_inside);
    free(s->grid.path);
    free(s->grid.name);
    for (size_t i = 0; i < s->attribute_count; i++) {
        free(s->attributes[i].from);
        free(s->attributes[i].name);
        free(s->attributes[i].as);
        free(s->attributes[i].input_pointer);
    }
    free(s->attributes);
    for (size_t i = 0; i < s->ply_property_count; i++) free(s->ply_properties[i]);
    free(s->ply_properties);
    free(s->preview_attribute);
    free(s->preview_range);
    for (size_t i = 0; i < s->label_count; i++) free(s->labels[i]);
    free(s->labels);
    for (size_t i = 0; i < s->depends_on_count; i++) free(s->depends_on[i]);
    free(s->depends_on);
    for (size_t i = 0; i < s->after_count; i++) free(s->after[i]);
    free(s->after);
    for (size_t i = 0; i < s->slurm_count; i++) free(s->slurm[i]);
    free(s->slurm);
    free(s->frames);
    free(s->frame);
    free(s->directory);
    free(s->webhook);
    json_free(s->normalised);
    free(s);
}

bool spec_surface_is_bounded(const spec_surface *s)
{
    if (s->part_count == 0)
        return s->kind != SPEC_SURFACE_ANALYTIC || s->analytic.shape != SPEC_SHAPE_HALFSPACE;
    bool any = false, all = true, first = spec_surface_is_bounded(s->parts[0]);
    for (size_t k = 0; k < s->part_count; k++) {
        bool bounded = spec_surface_is_bounded(s->parts[k]);
        any |= bounded;
        all &= bounded;
    }
    return s->kind == SPEC_SURFACE_INTERSECTION ? any : s->kind == SPEC_SURFACE_DIFFERENCE ? first : all;
}

const char *spec_surface_kind_name(spec_surface_kind kind)
{
    return surface_keys[kind];
}

const char *spec_energy_name(spec_energy energy)
{
    static const char *const names[] = {SPEC_ENERGY_LIST(WORDS_TEXT, )};
    return names[energy];
}
