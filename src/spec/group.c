#include "spec/group.h"

#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "spec/rules.h"
#include "spec/surface.h"
#include "spec/values.h"

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

const char *spec_surface_kind_name(spec_surface_kind kind)
{
    return surface_keys[kind];
}

/* One more part of the surface at hand; or one that is none and goes to *stored. */
static void read_part(reading *r, const json_at *at, spec_surface **stored, json *normal)
{
    enum { DEEPEST = 16, MOST_SURFACES = 256 };
    spec_surface *whole = r->surface;
    spec_surface *part;
    if (r->depth == DEEPEST || r->surfaces == MOST_SURFACES) {
        reading_add_fault(
            r, at, "the combination has more than %d surfaces or more than %d nested levels: use fewer",
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
    group_read(r, at, "/surface", normal);
    r->depth--;
    r->surface = whole;
}

static void read_parts(reading *r, const json_at *at, const spec_row *row, json *normal)
{
    size_t count = json_size(*at);
    if (json_type_of(*at) != JSON_ARRAY || (double)count < row->low || (double)count > row->high) {
        reading_add_mismatch(r, at, "must be an array of %.0f to %.0f surfaces", row->low, row->high);
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
        reading_add_mismatch(r, at, "must be an array of at most %.0f objects", row->high);
        return;
    }
    json *list = json_put_array(normal, spec_row_key(row));
    s->attributes = mem_alloc(count * sizeof *s->attributes);
    for (size_t k = 0; k < count; k++) {
        json_at element = json_element(at, k);
        group_read(r, &element, row->pointer, json_append_object(list));
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
    group_read(r, &place, row->pointer, json_put_object(normal, spec_row_key(row)));
}

/* Takes what the frames of a sequence share from the spec that is known; false: the row is to be read. */
static bool share_known(reading *r, const spec_row *row)
{
    if (strcmp(row->pointer, "/surface") == 0) {
        r->s->surface = r->known->surface;
    } else if (strcmp(row->pointer, "/region/inside") == 0) {
        r->s->region_inside = r->known->region_inside;
    } else if (strcmp(row->pointer, "/queue") == 0) {
        r->s->frames = r->known->frames;
        r->s->coherent = r->known->coherent;
    } else {
        return false;
    }
    return true;
}

/* A member of a part that is not built may ask for nothing: it may be absent, false or an empty array. The normalised document
 * has no such member, so that a worker that reads the document finds what was given. */
static void read_missing_part(reading *r, const json_at *at, const spec_row *row, const char *why)
{
    const bool asks = at->node && !(json_type_of(*at) == JSON_BOOL && !json_bool(*at, true)) &&
                      !(json_type_of(*at) == JSON_ARRAY && json_size(*at) == 0);
    if (asks) reading_add_missing_part(r, at, why);
    if (!at->node && row->has == offsetof(spec, has_preview)) r->s->preview_left_out = true;
}

void group_read_row(reading *r, const json_at *group, const spec_row *row, json *normal)
{
    json_at at = json_member(group, spec_row_key(row));
    if (row->methods && !(row->methods & 1u << r->s->method)) {
        const char *method = spec_row_find("/solver", "method")->words[r->s->method];
        if (at.node) reading_add_fault(r, &at, "is not a member of the method \"%s\": remove it", method);
        return;
    }
    const char *why = build_part_missing(row->part);
    if (why) {
        read_missing_part(r, &at, row, why);
        return;
    }
    if (r->known && share_known(r, row)) return;
    if (row->type == SPEC_TYPE_GROUP) {
        read_member_group(r, &at, row, normal);
        return;
    }
    if (row->shapes) {
        if (!r->shape_known) return; /* what belongs here is not known; the shape's fault says so */
        if (!(row->shapes & 1u << r->surface->analytic.shape)) {
            const char *shape =
                spec_row_find("/surface/analytic", "shape")->words[r->surface->analytic.shape];
            if (at.node) reading_add_fault(r, &at, "is not a member of the shape \"%s\": remove it", shape);
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

void group_read(reading *r, const json_at *at, const char *group, json *normal)
{
    size_t before = r->total;
    if (at->node && json_type_of(*at) != JSON_OBJECT) {
        reading_add_mismatch(r, at, "must be an object");
        return;
    }
    size_t count = 0;
    const spec_row *const *rows = spec_rows_of(group, &count);
    unsigned skipped = rules_check_names(r, at, group);
    for (size_t i = 0; i < count; i++)
        if (!(skipped & 1u << rows[i]->choice)) group_read_row(r, at, rows[i], normal);
    note_surface(r, at, group);
    if (r->total == before) rules_check_values(r, at, group);
}
