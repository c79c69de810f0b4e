// SPDX-License-Identifier: Apache-2.0
#include "spec/json_schema.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"
#include "spec/spec_table.h"

static const char analytic[] = "/surface/analytic", surface[] = "/surface";

/* The reference to the schema of a surface within a surface. */
static const char *const surface_ref[] = {
    [JSON_SCHEMA_ALONE] = "#/properties/surface",
    [JSON_SCHEMA_SENT] = "#/components/schemas/Surface",
    [JSON_SCHEMA_ANSWERED] = "#/components/schemas/AnsweredSurface",
};

static void put_bounds(json *schema, const spec_row *row)
{
    json_put_number(schema, row->flags & SPEC_LOW_OPEN ? "exclusiveMinimum" : "minimum", row->low);
    json_put_number(schema, "maximum", row->high);
}

static void put_integer(json *schema, const spec_row *row)
{
    if (row->flags & SPEC_OR_ZERO) {
        json *list = json_put_array(schema, "oneOf");
        json *zero = json_append_object(list);
        json_put_string(zero, "type", "integer");
        json_put_integer(zero, "const", 0);
        schema = json_append_object(list);
    }
    json_put_string(schema, "type", "integer");
    put_bounds(schema, row);
}

static void put_words(json *schema, const spec_row *row)
{
    json_put_string(schema, "type", "string");
    json *list = json_put_array(schema, "enum");
    for (const char *const *word = row->words; *word; word++) json_append_string(list, *word);
}

static void put_items(json *schema, const char *type, const spec_row *row, int count)
{
    json_put_string(schema, "type", "array");
    json *items = json_put_object(schema, "items");
    json_put_string(items, "type", type);
    put_bounds(items, row);
    if (count == 0) return;
    json_put_integer(schema, "minItems", count);
    json_put_integer(schema, "maxItems", count);
}

static void put_length(json *schema, double low, double high)
{
    json_put_string(schema, "type", "string");
    json_put_number(schema, "minLength", low);
    json_put_number(schema, "maxLength", high);
    json_put_string(schema, "pattern", "^[^\\x00]*$"); /* texts must not contain byte 0 */
}

/* A size in pixels: one integer for both sides, or two. */
static void put_size(json *schema, const spec_row *row)
{
    json *list = json_put_array(schema, "oneOf");
    json *one = json_append_object(list);
    json_put_string(one, "type", "integer");
    put_bounds(one, row);
    put_items(json_append_object(list), "integer", row, 2);
}

/* Forbids further members, except in answers: later versions add members. */
static void put_end(json *object, json_schema_use use)
{
    if (use != JSON_SCHEMA_ANSWERED) json_put_bool(object, "additionalProperties", false);
}

/* Values by frame: lists or ramps, by JSON Pointer. */
static void put_frame_values(json *schema, const spec_row *row, json_schema_use use)
{
    json_put_string(schema, "type", "object");
    json_put_number(schema, "minProperties", row->low);
    json_put_number(schema, "maxProperties", row->high);
    json *list = json_put_array(json_put_object(schema, "additionalProperties"), "oneOf");
    json *values = json_append_object(list), *ramp = json_append_object(list);
    json_put_string(values, "type", "array");
    json_put_string(ramp, "type", "object");
    put_end(ramp, use);
    json *required = json_put_array(ramp, "required"), *properties = json_put_object(ramp, "properties");
    for (size_t i = 0; i < 2; i++) {
        static const char *const ends[] = {"from", "to"};
        json_append_string(required, ends[i]);
        json_put_string(json_put_object(properties, ends[i]), "type", "number");
    }
}

/* Adds an array of row->low to row->high items. Returns the schema of an item. */
static json *put_list(json *schema, const spec_row *row)
{
    json_put_string(schema, "type", "array");
    json_put_number(schema, "minItems", row->low);
    json_put_number(schema, "maxItems", row->high);
    return json_put_object(schema, "items");
}

static void put_labels(json *schema, const spec_row *row)
{
    if (row->flags & SPEC_OR_ONE) {
        json *list = json_put_array(schema, "oneOf");
        put_length(json_append_object(list), 1, SPEC_LABEL_LENGTH_MAX);
        schema = json_append_object(list);
    }
    json_put_string(schema, "type", "array");
    json_put_number(schema, "maxItems", row->high);
    put_length(json_put_object(schema, "items"), 1, SPEC_LABEL_LENGTH_MAX);
}

/* A pattern, or a list of names. */
static void put_files(json *schema, const spec_row *row)
{
    json *list = json_put_array(schema, "oneOf");
    put_length(json_append_object(list), 1, SPEC_FILE_NAME_MAX);
    put_length(put_list(json_append_object(list), row), 1, SPEC_FILE_NAME_MAX);
}

static void put_group(json *schema, const char *group, json_schema_use use);

static void put_type(json *schema, const spec_row *row, json_schema_use use)
{
    switch (row->type) {
    case SPEC_TYPE_GROUP:
        put_group(schema, row->pointer, use);
        break;
    case SPEC_TYPE_NUMBER:
        json_put_string(schema, "type", "number");
        put_bounds(schema, row);
        break;
    case SPEC_TYPE_INTEGER:
    case SPEC_TYPE_LARGE:
        put_integer(schema, row);
        break;
    case SPEC_TYPE_BOOL:
        json_put_string(schema, "type", "boolean");
        break;
    case SPEC_TYPE_WORD:
        put_words(schema, row);
        break;
    case SPEC_TYPE_WORDS:
        json_put_string(schema, "type", "array");
        json_put_number(schema, "minItems", 1);
        json_put_bool(schema, "uniqueItems", true);
        put_words(json_put_object(schema, "items"), row);
        break;
    case SPEC_TYPE_STRING:
        put_length(schema, row->low, row->high);
        break;
    case SPEC_TYPE_VECTOR:
        put_items(schema, "number", row, 3);
        break;
    case SPEC_TYPE_TRIPLE:
        put_items(schema, "integer", row, 3);
        break;
    case SPEC_TYPE_NUMBERS:
        put_items(schema, "number", row, 0);
        break;
    case SPEC_TYPE_INTEGERS:
        put_items(schema, "integer", row, 0);
        break;
    case SPEC_TYPE_LISTS:
        json_put_string(schema, "type", "array");
        put_items(json_put_object(schema, "items"), "integer", row, 0);
        break;
    case SPEC_TYPE_SIZE:
        put_size(schema, row);
        break;
    case SPEC_TYPE_SURFACE:
        json_put_string(schema, "$ref", surface_ref[use]);
        break;
    case SPEC_TYPE_SURFACES:
        json_put_string(put_list(schema, row), "$ref", surface_ref[use]);
        break;
    case SPEC_TYPE_GROUPS:
        put_group(put_list(schema, row), row->pointer, use);
        break;
    case SPEC_TYPE_FRAME_VALUES:
        put_frame_values(schema, row, use);
        break;
    case SPEC_TYPE_FILES:
        put_files(schema, row);
        break;
    case SPEC_TYPE_LABELS:
        put_labels(schema, row);
        break;
    }
}

/* Adds the title, the rank and the description: the prose, the unit, and the default if the schema has no member for it. */
static void put_prose(json *schema, const spec_row *row, json_schema_use use)
{
    const char *otherwise = use == JSON_SCHEMA_SENT ? row->otherwise : NULL;
    if (row->title) json_put_string(schema, "title", row->title);
    if (use != JSON_SCHEMA_ANSWERED) json_put_string(schema, "x-rank", option_rank_name(row->rank));
    char *prose = mem_printf("%s%s%s%s%s%s%s", row->prose, row->unit ? " (" : "", row->unit ? row->unit : "",
                             row->unit ? ")" : "", otherwise ? " Default: " : "", otherwise ? otherwise : "",
                             otherwise ? "." : "");
    json_put_string(schema, "description", prose);
    free(prose);
}

static json *describe(const spec_row *row, json_schema_use use)
{
    json *schema = json_new_object();
    put_type(schema, row, use);
    if (row->flags & SPEC_SWITCH) {
        json *whole = json_new_object(), *list = json_put_array(whole, "oneOf");
        json_put_string(json_append_object(list), "type", "boolean");
        json_append(list, schema);
        schema = whole;
    }
    put_prose(schema, row, use);
    if (row->otherwise && use == JSON_SCHEMA_ALONE)
        json_put(schema, "default", json_parse(row->otherwise, strlen(row->otherwise), NULL));
    return schema;
}

/* Adds the condition of a choice among the members of a group: exactly one of the rows; or, if none may be
 * given, no pair of them. */
static void put_choice(json *all, const char *group, spec_choice choice)
{
    const spec_row *member[16];
    size_t count = 0;
    for (size_t i = 0; i < spec_row_count && count < sizeof member / sizeof *member; i++)
        if (spec_rows[i].choice == choice && spec_row_is_member(&spec_rows[i], group))
            member[count++] = &spec_rows[i];
    if (count == 0) return;
    json *one_of = choice < SPEC_CHOICE_GRADING ? json_put_array(json_append_object(all), "oneOf") : NULL;
    for (size_t i = 0; i < count; i++) {
        if (one_of) {
            json_append_string(json_put_array(json_append_object(one_of), "required"),
                               spec_row_key(member[i]));
            continue;
        }
        for (size_t k = i + 1; k < count; k++) {
            json *pair = json_put_array(json_put_object(json_append_object(all), "not"), "required");
            json_append_string(pair, spec_row_key(member[i]));
            json_append_string(pair, spec_row_key(member[k]));
        }
    }
}

/* Adds the members of a group. `shape`: members of other shapes are left out; -1: the group has no shapes. */
static void put_members(json *schema, const char *group, int shape, json_schema_use use)
{
    json *properties = json_put_object(schema, "properties"), *required = NULL;
    json_put_string(schema, "type", "object");
    put_end(schema, use);
    for (size_t i = 0; i < spec_row_count; i++) {
        const spec_row *row = &spec_rows[i];
        if (!spec_row_is_member(row, group)) continue;
        if (row->shapes && !(row->shapes & 1u << shape)) continue;
        if (use != JSON_SCHEMA_ALONE && strcmp(row->pointer, surface) == 0)
            json_put_string(json_put_object(properties, spec_row_key(row)), "$ref", surface_ref[use]);
        else
            json_put(properties, spec_row_key(row), describe(row, use));
        if (!(row->flags & SPEC_REQUIRED) || row->methods) continue;
        if (!required) required = json_put_array(schema, "required");
        json_append_string(required, spec_row_key(row));
    }
    if (shape < 0) return;
    json *name = json_new_object();
    json_put_string(name, "type", "string");
    json_put_string(name, "const", spec_row_find(group, "shape")->words[shape]);
    json_put(properties, "shape", name);
}

static void put_group(json *schema, const char *group, json_schema_use use)
{
    if (strcmp(group, analytic) == 0) {
        json *list = json_put_array(schema, "oneOf");
        const spec_row *shapes = spec_row_find(group, "shape");
        for (int i = 0; shapes->words[i]; i++) put_members(json_append_object(list), group, i, use);
        return;
    }
    put_members(schema, group, -1, use);
    if (use == JSON_SCHEMA_ANSWERED) return;
    json *all = json_new_array();
    for (spec_choice c = SPEC_CHOICE_NONE + 1; c < SPEC_CHOICE_COUNT; c++) put_choice(all, group, c);
    json_at at = json_root(all);
    if (json_size(at) > 0)
        json_put(schema, "allOf", all);
    else
        json_free(all);
}

json *json_schema_new(json_schema_use use)
{
    json *schema = json_new_object();
    put_group(schema, "", use);
    json_put_string(
        schema, "description",
        use == JSON_SCHEMA_ANSWERED
            ? "The spec of a job as the service returns it, with its defaults. It can be submitted "
              "again as a JobSpec."
            : "The spec of a job. hexad-worker spec-help describes each member.");
    return schema;
}

json *json_schema_new_member(const char *pointer, json_schema_use use)
{
    size_t i = 0;
    while (strcmp(spec_rows[i].pointer, pointer) != 0) i++;
    return describe(&spec_rows[i], use);
}
