// SPDX-License-Identifier: Apache-2.0
#include "spec/group.h"

#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"
#include "spec/rules.h"
#include "spec/member_value.h"

static const char *const surface_keys[] = {SPEC_SURFACE_LIST(WORDS_TEXT, )};

/* Sets the kind of surface that a member of /surface makes; false if it makes none. */
static bool set_surface_kind(reading *r, const char *key)
{
    for (size_t k = 0; k < sizeof surface_keys / sizeof surface_keys[0]; k++) {
        if (strcmp(key, surface_keys[k]) != 0) continue;
        *(spec_surface_kind *)reading_target(r, offsetof(spec, surface.kind)) = (spec_surface_kind)k;
        return true;
    }
    return false;
}

const char *spec_surface_kind_name(spec_surface_kind kind)
{
    return surface_keys[kind];
}

static void read_members(reading *r, const json_at *at, const char *group, const spec_row *first,
                         json *normal);

/* Appends a part to the current surface. */
static void append_part(reading *r, spec_surface *part)
{
    spec_surface ***parts = reading_target(r, offsetof(spec, surface.parts));
    size_t *count = reading_target(r, offsetof(spec, surface.part_count));
    *parts = mem_resize(*parts, (*count + 1) * sizeof **parts);
    (*parts)[(*count)++] = part;
}

/* Reads a further part of the current surface, or, with `stored`, a surface that is not a part and is stored
 * there. */
static void read_part(reading *r, const json_at *at, spec_surface **stored, json *normal)
{
    enum { DEEPEST = 16, MOST_SURFACES = 256 };
    partial_surface *whole = r->surface;
    if (r->depth == DEEPEST || r->surfaces == MOST_SURFACES) {
        reading_add_fault(
            r, at, "the combination has more than %d surfaces or more than %d nested levels: use fewer",
            MOST_SURFACES, DEEPEST);
        return;
    }
    void *part = mem_alloc(sizeof(spec_surface));
    if (stored)
        *stored = part;
    else
        append_part(r, part);
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
    for (json_at element = json_first(at); element.node; element = json_next(&element))
        read_part(r, &element, NULL, json_append_object(list));
}

static void note_attribute(spec_attribute *a, const json_at *at)
{
    json_at from = json_member(at, "from");
    a->input_pointer = mem_alloc(sizeof((spec_fault *)0)->pointer);
    json_pointer(&from, a->input_pointer, sizeof((spec_fault *)0)->pointer);
}

/* Each attribute is read into spec.attribute, and then moved to the list. */
static void read_attributes(reading *r, const json_at *at, const spec_row *row, json *normal)
{
    size_t count = json_size(*at);
    spec_attribute *one = reading_target(r, offsetof(spec, attribute)),
                   **all = reading_target(r, offsetof(spec, attributes));
    size_t *read = reading_target(r, offsetof(spec, attribute_count));
    if (json_type_of(*at) != JSON_ARRAY || (double)count > row->high) {
        reading_add_mismatch(r, at, "must be an array of at most %.0f objects", row->high);
        return;
    }
    json *list = json_put_array(normal, spec_row_key(row));
    *all = mem_alloc(count * sizeof **all);
    for (json_at element = json_first(at); element.node; element = json_next(&element)) {
        read_members(r, &element, row->pointer, spec_row_first_below(row), json_append_object(list));
        note_attribute(one, &element);
        (*all)[(*read)++] = *one;
        *one = (spec_attribute){0};
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
        member_value_read(r, at, row, normal);
}

void group_read_default(reading *r, const spec_row *row, const char *otherwise, json *normal)
{
    json *root = json_parse(otherwise, strlen(otherwise), NULL);
    json_at at = json_root(root);
    read_member(r, &at, row, normal);
    json_free(root);
}

/* Adds the fault that a required member is absent. It names the values that the member may have. */
static void add_required(reading *r, const json_at *at, const spec_row *row, json *normal)
{
    if (row->type == SPEC_TYPE_GROUP || row->type == SPEC_TYPE_SURFACE)
        reading_add_mismatch(r, at, "must be an object");
    else if (strcmp(spec_row_key(row), "isovalue") == 0)
        reading_add_mismatch(r, at, "must be a number: hexadctl inspect FILE suggests one");
    else
        member_value_read(r, at, row, normal);
}

static void refuse_value(reading *r, const json_at *at, const spec_row *first, bool is_switch);

static void read_member_group(reading *r, const json_at *at, const spec_row *row, json *normal)
{
    bool on = at->node || !(row->flags & SPEC_OPTIONAL);
    json_at place = *at;
    if (row->flags & SPEC_SWITCH && json_type_of(*at) == JSON_BOOL) {
        on = json_bool(*at, true);
        place.node = NULL; /* true stands for an object without members */
        if (!on) json_put_bool(normal, spec_row_key(row), false);
    }
    if (row->has != SPEC_NOWHERE) *(bool *)reading_target(r, row->has) = on;
    if (!on) return;
    if (row->flags & SPEC_SWITCH && place.node && json_type_of(place) != JSON_OBJECT) {
        refuse_value(r, at, spec_row_first_below(row), true);
        return;
    }
    if (!place.node && row->flags & SPEC_REQUIRED) {
        add_required(r, at, row, normal);
        return;
    }
    read_members(r, &place, row->pointer, spec_row_first_below(row),
                 json_put_object(normal, spec_row_key(row)));
}

/* Copies the values that all frames of a sequence share from the known spec. False: the row must be read. */
static bool share_known(reading *r, const spec_row *row)
{
    if (strcmp(row->pointer, "/surface") == 0) {
        *(spec_surface *)reading_target(r, offsetof(spec, surface)) = r->known->surface;
    } else if (strcmp(row->pointer, "/region/inside") == 0) {
        *(spec_surface **)reading_target(r, offsetof(spec, region_inside)) = r->known->region_inside;
    } else if (strcmp(row->pointer, "/queue") == 0) {
        *(char **)reading_target(r, offsetof(spec, frames)) = r->known->frames;
        *(bool *)reading_target(r, offsetof(spec, coherent)) = r->known->coherent;
    } else {
        return false;
    }
    return true;
}

/* Reads a member of a part that is not built. It may be absent, false or an empty array, which request
 * nothing. It is omitted from the normalised document, so that a worker that reads the document gets the
 * given value. */
static void read_missing_part(reading *r, const json_at *at, const spec_row *row, const char *why)
{
    const bool asks = at->node && !(json_type_of(*at) == JSON_BOOL && !json_bool(*at, true)) &&
                      !(json_type_of(*at) == JSON_ARRAY && json_size(*at) == 0);
    if (asks) reading_add_missing_part(r, at, why);
    if (!at->node && row->has == offsetof(spec, has_preview))
        *(bool *)reading_target(r, offsetof(spec, preview_left_out)) = true;
}

/* Whether the solver's method has the member. If not, and it is given, adds a fault. If no method is given,
 * it is one of SPEC_DEFAULT_METHODS. */
static bool has_method(reading *r, const json_at *at, const spec_row *row)
{
    if (!row->methods || row->methods & r->methods) return true;
    if (!at->node || !r->methods) return false; /* the method has a fault, which was added */
    const char *const *words = spec_row_find("/solver", "method")->words;
    unsigned given = 0;
    while (!(r->methods & 1u << given)) given++;
    if (r->methods == SPEC_DEFAULT_METHODS)
        reading_add_fault(r, at, "requires the method \"%s\": add it to /solver, or remove this member",
                          words[SPEC_METHOD_WITKIN_HECKBERT]);
    else
        reading_add_fault(r, at, "is not a member of the method \"%s\": remove it", words[given]);
    return false;
}

/* Whether the shape has the member. If not, and it is given, adds a fault. */
static bool has_shape(reading *r, const json_at *at, const spec_row *row)
{
    if (!row->shapes) return true;
    if (!r->shape_known)
        return false; /* the members are unknown, because the shape has a fault, which was
                                        * added */
    const spec_shape shape = *(spec_shape *)reading_target(r, offsetof(spec, surface.analytic.shape));
    if (row->shapes & 1u << shape) return true;
    if (at->node)
        reading_add_fault(r, at, "is not a member of the shape \"%s\": remove it",
                          spec_row_find("/surface/analytic", "shape")->words[shape]);
    return false;
}

void group_read_row(reading *r, const json_at *group, const spec_row *row, json *normal)
{
    json_at at = json_member(group, spec_row_key(row));
    if (row->offset == offsetof(spec, method)) r->methods = at.node ? 0 : SPEC_DEFAULT_METHODS;
    if (!has_method(r, &at, row)) return;
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
    if (!has_shape(r, &at, row)) return;
    if (at.node)
        read_member(r, &at, row, normal);
    else if (row->flags & SPEC_REQUIRED)
        add_required(r, &at, row, normal);
    else if (row->flags & SPEC_DEPENDENT)
        reading_add_absent(r, row, normal);
    else if (row->otherwise)
        group_read_default(r, row, row->otherwise, normal);
}

/* Stores the kind of surface that a member of /surface determines, and its input file. */
static void note_surface(reading *r, const json_at *at, const char *group)
{
    static const char prefix[] = "/surface/";
    if (strncmp(group, prefix, strlen(prefix)) != 0) return;
    if (!set_surface_kind(r, group + strlen(prefix))) return;
    json_at path = json_member(at, "path");
    char **pointer = reading_target(r, offsetof(spec, surface.input_pointer));
    if (!path.node || *pointer) return;
    *pointer = mem_alloc(sizeof((spec_fault *)0)->pointer);
    json_pointer(&path, *pointer, sizeof((spec_fault *)0)->pointer);
}

/* Whether a member can be a value of this type. */
static bool has_type(const spec_row *row, json_type type)
{
    switch (row->type) {
    case SPEC_TYPE_STRING:
        return type == JSON_STRING;
    case SPEC_TYPE_NUMBER:
    case SPEC_TYPE_INTEGER:
    case SPEC_TYPE_LARGE:
        return type == JSON_NUMBER;
    default:
        return false;
    }
}

/* The required member that can be a value of this type, or the only member that can. Else NULL. */
static const spec_row *member_of_type(const spec_row *first, json_type type)
{
    const spec_row *found = NULL;
    size_t count = 0;
    for (const spec_row *row = first; row; row = spec_row_next(row)) {
        if (!has_type(row, type)) continue;
        if (row->flags & SPEC_REQUIRED) return row;
        found = row;
        count++;
    }
    return count == 1 ? found : NULL;
}

/* Adds the fault that a value is not an object, or, of a switch, not a boolean either. It shows an object with the
 * value, or lists the members. */
static void refuse_value(reading *r, const json_at *at, const spec_row *first, bool is_switch)
{
    const char *also = is_switch ? "true, false or " : "";
    char members[RULES_LIST_MAX];
    const spec_row *row = member_of_type(first, json_type_of(*at));
    char *value = row ? json_print(at->node) : NULL;
    rules_list_members(first, members);
    if (value && strlen(value) <= READING_SHOWN_MAX)
        reading_add_mismatch(r, at, "must be %san object such as {\"%s\": %s}", also, spec_row_key(row),
                             value);
    else
        reading_add_mismatch(r, at, "must be %san object; its members are %s", also, members);
    free(value);
}

/* Reads the members of a group, of which `first` is the first one. */
static void read_members(reading *r, const json_at *at, const char *group, const spec_row *first,
                         json *normal)
{
    size_t before = r->total;
    if (at->node && json_type_of(*at) != JSON_OBJECT) {
        refuse_value(r, at, first, false);
        return;
    }
    unsigned skipped = rules_check_names(r, at, group, first);
    for (const spec_row *row = first; row; row = spec_row_next(row))
        if (!(skipped & 1u << row->choice)) group_read_row(r, at, row, normal);
    note_surface(r, at, group);
    if (r->total == before) rules_check_group(r, at, group);
    r->complete = !*group;
}

void group_read(reading *r, const json_at *at, const char *group, json *normal)
{
    read_members(r, at, group, spec_row_first(group), normal);
}
