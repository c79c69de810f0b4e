// SPDX-License-Identifier: Apache-2.0
#include "spec/sample_spec.h"

#include <stdlib.h>
#include <string.h>

#include "base/core/frames.h"
#include "base/core/memory.h"
#include "spec/spec_table.h"

/* The largest over the least spacing of --grade curvature without RATIO. With larger values, flat parts have
 * few points. */
#define RATIO_DEFAULT 4

const json *sample_spec_suggested(const json *inspection)
{
    const json *found = NULL;
    json_at root = json_root(inspection), list = json_member(&root, "suggestions");
    for (json_at item = json_first(&list); item.node; item = json_next(&item)) {
        json_at suggested = json_member(&item, "spec");
        if (!suggested.node) continue;
        if (json_bool(json_member(&item, "measured"), false)) return suggested.node;
        if (!found) found = suggested.node;
    }
    return found;
}

const char *sample_spec_member(file_format format)
{
    const file_format_kind kind = file_formats[format].kind;
    return kind == FILE_FORMAT_GRIDS ? "vdb" : kind == FILE_FORMAT_VOLUMES ? "volume" : "mesh";
}

json *sample_spec_unseen(const char *member, const char *path)
{
    json *inspection = json_new_object(), *list = json_put_array(inspection, "suggestions"),
         *item = json_append_object(list), *document = json_put_object(item, "spec");
    json_put_bool(item, "measured", false);
    json_put_string(json_put_object(json_put_object(document, "surface"), member), "path", path);
    json_put_integer(json_put_object(document, "sampling"), "count", SAMPLE_SPEC_COUNT_MOST);
    return inspection;
}

/* Whether the pointer names a member of the objects in an array, such as /attributes/name. */
static bool is_in_array(const char *pointer)
{
    for (size_t i = 0; i < spec_row_count; i++) {
        const size_t length = strlen(spec_rows[i].pointer);
        if (spec_rows[i].type == SPEC_TYPE_GROUPS && strncmp(pointer, spec_rows[i].pointer, length) == 0 &&
            pointer[length] == '/')
            return true;
    }
    return false;
}

/* Assignments to the members of a spec whose pointers end with the name before the equals sign, as in
 * isovalue=100; the caller frees the text. "": there is none, or there are too many to list. */
static char *write_assignments(const char *assignment)
{
    enum { MOST = 4 };
    const size_t length = strcspn(assignment, "=");
    size_t found = 0;
    char *list = mem_strdup("");
    for (size_t i = 0; i < spec_row_count && length > 0 && found <= MOST; i++) {
        const char *pointer = spec_rows[i].pointer;
        const size_t all = strlen(pointer);
        if (all <= length || pointer[all - length - 1] != '/' ||
            strncmp(pointer + all - length, assignment, length) != 0 || is_in_array(pointer))
            continue;
        char *longer = mem_printf("%s%s%s%s", list, found ? " or " : "", pointer, assignment + length);
        free(list);
        list = longer;
        found++;
    }
    if (found > MOST) *list = '\0';
    return list;
}

bool sample_spec_set(json *document, const char *assignment, error *e)
{
    const char *equals = strchr(assignment, '=');
    if (*assignment != '/' || !equals || equals == assignment + 1) {
        char *meant = write_assignments(equals ? assignment : "");
        error_set(e, ERROR_SPEC_INVALID, "--set %s: must be /MEMBER=VALUE, such as %s", assignment,
                  *meant ? meant : "/sampling/count=5000");
        free(meant);
        return false;
    }
    char *pointer = mem_printf("%.*s", (int)(equals - assignment), assignment);
    json *value = json_parse(equals + 1, strlen(equals + 1), NULL);
    if (!value) value = json_new_string(equals + 1);
    bool set = json_set(document, pointer, value);
    if (!set) {
        json_free(value);
        error_set(e, ERROR_SPEC_INVALID, "--set %s: a part of %s has no members: check the path", assignment,
                  pointer);
    }
    free(pointer);
    return set;
}

/* Puts the number of an option into an object. NULL as text: the option is not given. */
static bool put_number(json *object, const char *key, const char *option, const char *text, error *e)
{
    if (!text) return true;
    json *value = json_parse(text, strlen(text), NULL);
    if (json_type_of(json_root(value)) == JSON_NUMBER) {
        json_put(object, key, value);
        return true;
    }
    json_free(value);
    return error_set(e, ERROR_SPEC_INVALID, "%s must be a number (given %s)", option, text);
}

static bool put_grading(json *sampling, const char *text, error *e)
{
    static const char word[] = "curvature";
    const size_t length = sizeof word - 1;
    if (!text) return true;
    const bool named = strncmp(text, word, length) == 0;
    json *curvature = named ? json_put_object(sampling, word) : NULL;
    if (named && !text[length]) {
        json_put_integer(curvature, "ratio", RATIO_DEFAULT);
        return true;
    }
    if (named && text[length] == '=')
        return put_number(curvature, "ratio", "--grade curvature=RATIO: the ratio", text + length + 1, e);
    return error_set(e, ERROR_SPEC_INVALID, "--grade must be curvature or curvature=RATIO (given %s)", text);
}

/* Whether the sampling has a target, such as count or spacing. */
static bool has_target(json_at sampling)
{
    for (const spec_row *row = spec_row_first("/sampling"); row; row = spec_row_next(row))
        if (row->choice == SPEC_CHOICE_TARGET && json_member(&sampling, spec_row_key(row)).node) return true;
    return false;
}

/* Puts the options into a spec that has the surface only. `count`: the suggested one. */
static bool apply(json *document, const sample_options *o, double count, error *e)
{
    json *sampling = json_put_object(document, "sampling");
    if (o->count && o->spacing)
        return error_set(e, ERROR_SPEC_INVALID, "--count and --spacing exclude each other: give one of them");
    if (!put_number(sampling, "count", "--count", o->count, e) ||
        !put_number(sampling, "spacing", "--spacing", o->spacing, e) || !put_grading(sampling, o->grade, e))
        return false;
    if (o->pattern) json_put_string(sampling, "pattern", o->pattern);
    if (o->name) json_put_string(document, "name", o->name);
    if (o->frames) json_put_string(json_put_object(document, "queue"), "frames", o->frames);
    for (size_t i = 0; i < o->set_count; i++)
        if (!sample_spec_set(document, o->set[i], e)) return false;
    sampling = json_find(document, "/sampling"); /* an assignment may have replaced it */
    if (json_type_of(json_root(sampling)) == JSON_OBJECT && !has_target(json_root(sampling)))
        json_put_integer(sampling, "count", (int64_t)count);
    return true;
}

bool sample_spec_has_target(const sample_options *options)
{
    json *document = json_new_object();
    bool ok = apply(document, options, 0, NULL);
    json_at root = json_root(document), sampling = json_member(&root, "sampling"),
            count = json_member(&sampling, "count");
    /* no permitted count is 0 */
    bool named = ok && !(json_type_of(count) == JSON_NUMBER && json_number(count, 0) == 0);
    json_free(document);
    return named;
}

bool sample_spec_check(const sample_options *options, error *e)
{
    json *document = json_new_object();
    bool ok = apply(document, options, 0, e);
    json_free(document);
    return ok;
}

/* The members of a surface that inspect suggests. */
static const char *const members[] = {"mesh", "vdb", "volume", "labels", "exr"};
enum { MEMBERS = sizeof members / sizeof *members };

/* A value of the surface in a document, such as its path. NULL: it has none. */
static json *value_of_surface(json *document, const char *member, const char *key)
{
    char *pointer = mem_printf("/surface/%s/%s", member, key);
    json *value = json_find(document, pointer);
    free(pointer);
    return value;
}

bool sample_spec_is_complete(const char *member, const sample_options *options)
{
    json *document = json_new_object();
    const bool ok = sample_spec_has_target(options) && apply(document, options, 0, NULL) &&
                    (strcmp(member, "mesh") == 0 || value_of_surface(document, member, "isovalue"));
    json_free(document);
    return ok;
}

bool sample_spec_needs_inspection(const char *member, const sample_options *options)
{
    return strcmp(member, "volume") == 0 || !sample_spec_is_complete(member, options);
}

/* The text about a value of the first of these members of the surface that is suggested and has one, unless an option
 * sets it. `write` makes the text, which the caller frees. NULL: none. */
typedef char *note_writer(const json *inspection, const char *member, double value);

static char *note_of(const json *inspection, const sample_options *options, const char *key,
                     note_writer *write)
{
    const json *suggested = sample_spec_suggested(inspection);
    json *own = suggested ? json_copy(suggested) : NULL, *given = json_new_object();
    char *note = NULL;
    apply(given, options, 0, NULL);
    for (size_t i = 0; own && i < MEMBERS && !note; i++) {
        json *value = value_of_surface(own, members[i], key);
        if (value && !value_of_surface(given, members[i], key))
            note = write(inspection, members[i], json_number(json_root(value), 0));
    }
    json_free(own);
    json_free(given);
    return note;
}

static char *write_isovalue(const json *inspection, const char *member, double isovalue)
{
    json_at root = json_root(inspection);
    return mem_printf(
        "isovalue %g: suggested by inspect, of %zu; set another with --set /surface/%s/isovalue=V", isovalue,
        json_size(json_member(&root, "suggestions")), member);
}

static char *write_volume(const json *inspection, const char *member, double index)
{
    json_at root = json_root(inspection), volume = json_member(&root, "volume");
    return mem_printf("volume %.0f of %.0f, from 0; set another with --set /surface/%s/index=K", index,
                      json_number(json_member(&volume, "volumes"), 1), member);
}

char *sample_spec_isovalue_note(const json *inspection, const sample_options *options)
{
    return note_of(inspection, options, "isovalue", write_isovalue);
}

char *sample_spec_volume_note(const json *inspection, const sample_options *options)
{
    return note_of(inspection, options, "index", write_volume);
}

char *sample_spec_inspected(const char *path, const sample_options *options, error *e)
{
    json *document = json_new_object();
    char *inspected = NULL;
    if (apply(document, options, 0, e)) {
        const char *frames = json_string(json_root(json_find(document, "/queue/frames")), NULL);
        size_t count = 0;
        int *frame = NULL;
        if (!frames || !frames_is_pattern(path))
            inspected = mem_strdup(path);
        else if (strcmp(frames, FRAMES_ALL) == 0)
            error_set(e, ERROR_SPEC_INVALID,
                      "/queue/frames: the first frame is inspected: write numbers in place of \"" FRAMES_ALL
                      "\", such as 1-100");
        else if ((frame = frames_parse(frames, &count, e)))
            inspected = frames_path(path, frame[0]);
        else
            error_prefix(e, "/queue/frames");
        free(frame);
    }
    json_free(document);
    return inspected;
}

/* Replaces the path of the inspected frame by the pattern. */
static void put_pattern(json *document, const char *pattern, const char *inspected)
{
    for (size_t i = 0; i < MEMBERS; i++) {
        json *path = value_of_surface(document, members[i], "path");
        if (path && strcmp(json_string(json_root(path), ""), inspected) == 0) json_set_string(path, pattern);
    }
}

/* The names of an OpenVDB file's grids, or of those with scalars, with their types if `typed`; the caller frees
 * the text. */
static char *list_grids(json_at grids, bool scalars_only, bool typed)
{
    char *list = mem_strdup("");
    for (json_at grid = json_first(&grids); grid.node; grid = json_next(&grid)) {
        if (scalars_only && !json_bool(json_member(&grid, "scalar"), false)) continue;
        const char *name = json_string(json_member(&grid, "name"), ""),
                   *type = json_string(json_member(&grid, "type"), "");
        char *longer = mem_printf("%s%s\"%s\"%s%s%s", list, *list ? ", " : "", name, typed ? " (" : "",
                                  typed ? type : "", typed ? ")" : "");
        free(list);
        list = longer;
    }
    return list;
}

/* Why no surface of an OpenVDB file can be sampled, and what to do; the caller frees the text. */
static char *explain_grids(json_at grids)
{
    size_t scalars = 0, empty = 0, points = 0;
    const char *fault = NULL;
    for (json_at grid = json_first(&grids); grid.node; grid = json_next(&grid)) {
        json_at told = json_member(&grid, "error");
        if (told.node && !fault) fault = json_string(json_member(&told, "message"), "");
        if (json_bool(json_member(&grid, "scalar"), false)) scalars++;
        if (json_number(json_member(&grid, "active_voxels"), 1) == 0) empty++;
        if (strncmp(json_string(json_member(&grid, "type"), ""), "ptdataidx", strlen("ptdataidx")) == 0)
            points++;
    }
    const size_t all = json_size(grids);
    char *list = list_grids(grids, scalars > 0, scalars == 0), *text;
    const char *noun = (scalars ? scalars : all) == 1 ? "grid" : "grids";
    if (all == 0)
        text = mem_strdup("the file has no grid: give another file");
    else if (fault)
        text = mem_printf("a grid cannot be read: %s", fault);
    else if (scalars > 0 && empty == scalars)
        text = mem_printf("the %s %s %s no active voxels: choose another frame or file", noun, list,
                          scalars == 1 ? "has" : "have");
    else if (scalars > 0)
        text = mem_printf("the %s %s %s no isovalue with a surface: choose another frame or file", noun, list,
                          scalars == 1 ? "has" : "have");
    else if (points == all)
        text = mem_printf("the %s %s %s points, and a surface is taken from a grid of type float or double: "
                          "convert the points to a level set or a fog volume",
                          noun, list, all == 1 ? "has" : "have");
    else
        text = mem_printf(
            "a surface is taken from a grid of type float or double, and the file has only the %s %s: "
            "give a file with a density or a level set",
            noun, list);
    free(list);
    return text;
}

/* Sets the error for an inspection without a surface that can be sampled. */
static void explain_missing(const json *inspection, const char *path, error *e)
{
    json_at root = json_root(inspection), list = json_member(&root, "suggestions"), first = json_first(&list),
            fault = json_member(&first, "error");
    const char *message = json_string(json_member(&fault, "message"), NULL);
    const file_format format = file_format_of_name(path);
    if (message)
        error_set(e, error_code_from_name(json_string(json_member(&fault, "code"), "")), "%s: %s", path,
                  message);
    if (message) return;
    json_at grids = json_member(&root, "grids");
    char *why =
        grids.node ? explain_grids(grids)
        : format == FILE_FORMAT_EXR || format == FILE_FORMAT_TIFF
            ? mem_strdup("no surface was found. An image of a stack requires the other images beside it")
            : mem_strdup("no surface was found");
    error_set(e, ERROR_NO_SURFACE, "%s: %s. `hexad-worker inspect FILE` shows what the file contains", path,
              why);
    free(why);
}

const char *sample_spec_ending(const char *path)
{
    const char *slash = strrchr(path, '/'), *name = slash ? slash + 1 : path, *dot = strrchr(name, '.');
    if (!dot || dot == name) return "";
    if (strcmp(dot, ".gz") != 0) return dot;
    for (const char *at = dot - 1; at > name; at--)
        if (*at == '.') return at;
    return dot;
}

char *sample_spec_stem(const char *path)
{
    size_t length = strlen(path);
    while (length > 1 && path[length - 1] == '/') length--;
    char *whole = mem_printf("%.*s", (int)length, path);
    const char *slash = strrchr(whole, '/'), *name = slash && slash[1] ? slash + 1 : whole;
    length = strlen(name) - strlen(sample_spec_ending(name));
    if (frames_is_pattern(name)) {
        size_t before = frames_prefix(name);
        while (before > 0 && strchr("._- ", name[before - 1])) before--;
        if (before > 0) length = before;
    }
    char *stem = mem_printf("%.*s", (int)length, name);
    free(whole);
    return stem;
}

/* Puts the name of the job, unless it is longer than a spec permits. */
static void put_name(json *document, const char *path)
{
    char *stem = sample_spec_stem(path);
    const spec_row *row = spec_row_find("", "name");
    if ((double)strlen(stem) <= row->high) json_put_string(document, "name", stem);
    free(stem);
}

json *sample_spec_make(const json *inspection, const char *path, const sample_options *options, error *e)
{
    const json *suggested = sample_spec_suggested(inspection);
    if (!suggested) {
        explain_missing(inspection, path, e);
        return NULL;
    }
    char *inspected = sample_spec_inspected(path, options, e);
    if (!inspected) return NULL;
    json_at root = json_root(suggested), sampling = json_member(&root, "sampling");
    json *document = json_new_object();
    json_put_integer(document, "version", 1);
    put_name(document, path);
    json_put(document, "surface", json_copy(json_member(&root, "surface").node));
    put_pattern(document, path, inspected);
    free(inspected);
    if (!apply(document, options, json_number(json_member(&sampling, "count"), 0), e)) {
        json_free(document);
        return NULL;
    }
    return document;
}

void sample_spec_advise(const char *program, const char *path, error *e)
{
    const file_format_row *row = &file_formats[file_format_of_name(path)];
    const bool is_surface =
        row->kind == FILE_FORMAT_MESHES || row->kind == FILE_FORMAT_GRIDS || row->kind == FILE_FORMAT_VOLUMES;
    if (!is_surface || row->reading == FILE_FORMAT_NOT_READ) return;
    error_set(e, ERROR_SPEC_INVALID,
              "%s is the name of a file in the format %s, and a spec is a JSON document: run %s sample %s",
              path, row->name, program, path);
}
