// SPDX-License-Identifier: Apache-2.0
/* spec: the table determines most of these tests: default, bounds and types of every row. */
#include <malloc.h>
#include <ctype.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "base/core/memory.h"
#include "spec/spec.h"
#include "spec/spec_table.h"

#define SPHERE                                                                         \
    "{\"version\":1,\"surface\":{\"analytic\":{\"shape\":\"sphere\",\"radius\":0.4}}," \
    "\"sampling\":{\"count\":100}"

#define UNIT_SPHERE "{\"version\":1,\"surface\":{\"analytic\":{\"shape\":\"sphere\",\"radius\":1}}"

#define GRADED(grading)                                                                \
    "{\"version\":1,\"surface\":{\"analytic\":{\"shape\":\"sphere\",\"radius\":0.4}}," \
    "\"sampling\":{\"count\":100," grading "}}"
#define EXR(path, slices)                                                                            \
    "{\"version\":1,\"surface\":{\"exr\":{\"path\":" path ",\"slices\":" slices ",\"isovalue\":1}}," \
    "\"sampling\":{\"count\":100}}"

#define STACKED_LABELS                                                                      \
    "{\"version\":1,\"surface\":{\"labels\":{\"path\":\"a.####.exr\",\"slices\":\"1-9\"}}," \
    "\"sampling\":{\"count\":100}}"

#define COMBINED(kind)                                                                  \
    "{\"version\":1,\"surface\":{\"" kind "\":[{\"analytic\":{\"shape\":\"quartic\"}}," \
    "{\"mesh\":{\"path\":\"a.ply\"}}]},\"sampling\":{\"count\":100}}"

static json *document(const char *text)
{
    error e = {0};
    json *root = json_parse(text, strlen(text), &e);
    if (!root) fail_msg("%s: %s", text, e.message);
    return root;
}

static spec *good(const char *text)
{
    error e = {0};
    json *root = document(text);
    spec *s = spec_parse(root, NULL, &e);
    if (!s) fail_msg("%s refused: %s", text, e.message);
    json_free(root);
    return s;
}

static spec_faults bad(const char *text, error *e)
{
    spec_faults faults;
    json *root = document(text);
    spec *s = spec_parse(root, &faults, e);
    if (s) fail_msg("accepted: %s", text);
    json_free(root);
    return faults;
}

static void expect_fault(const char *text, error_code code, const char *pointer, const char *words)
{
    error e = {0};
    spec_faults faults = bad(text, &e);
    for (size_t i = 0; i < faults.count; i++)
        if (strcmp(faults.item[i].pointer, pointer) == 0 && strstr(faults.item[i].detail, words) &&
            faults.item[i].code == code)
            return;
    fail_msg("%s: no fault %s '%s' but %s", text, pointer, words, e.message);
}

/* ---- the table ---- */

static json *member(json *object, const char *key)
{
    json_at at = json_root(object);
    return (json *)json_member(&at, key).node;
}

/* Puts a value at a pointer and creates the groups on the path. A NULL value only creates the groups. */
static void put_at(json *root, const char *pointer, json *value)
{
    char *path = mem_strdup(pointer + 1), *save = NULL, *key = strtok_r(path, "/", &save), *next;
    for (; (next = strtok_r(NULL, "/", &save)); key = next) {
        json *child = member(root, key);
        root = child ? child : json_put_object(root, key);
    }
    json_put(root, key, value);
    free(path);
}

/* A valid document to which the row can be added. */
static json *document_for(const spec_row *row)
{
    static const char *const shapes[] = {
        "\"sphere\",\"radius\":0.4",
        "\"torus\",\"major_radius\":0.3,\"minor_radius\":0.1",
        "\"box\",\"half_size\":[0.3,0.3,0.3]",
        "\"ellipsoid\",\"radii\":[0.3,0.3,0.3]",
        "\"quartic\"",
        "\"gyroid\",\"period\":0.5",
        "\"cylinder\",\"radius\":1,\"height\":2",
        "\"cone\",\"radius\":1,\"height\":2",
        "\"capsule\",\"radius\":1,\"height\":2",
    };
    static const struct {
        const char *begins, *text;
    } documents[] = {
        {"/output/preview/camera",
         SPHERE ",\"output\":{\"preview\":{\"camera\":{\"position\":[0,3,0],\"target\":[0,0,1]}}}}"},
        {"/surface/vdb",
         "{\"version\":1,\"surface\":{\"vdb\":{\"path\":\"a.vdb\"}},\"sampling\":{\"count\":100}}"},
        {"/surface/bspline/coefficients",
         "{\"version\":1,\"surface\":{\"bspline\":{\"dims\":[4,4,4]}},\"sampling\":{\"count\":100}}"},
        {"/surface/bspline", "{\"version\":1,\"surface\":{\"bspline\":{\"dims\":[4,4,4],\"path\":\"a.raw\"}},"
                             "\"sampling\":{\"count\":100}}"},
        {"/region/inside", SPHERE ",\"region\":{\"inside\":{\"analytic\":{\"shape\":\"quartic\"}}}}"},
        {"/region", SPHERE ",\"region\":{\"min\":[-1e12,-1e12,-1e12],\"max\":[1e12,1e12,1e12]}}"},
        {"/surface/mesh/features",
         "{\"version\":1,\"surface\":{\"mesh\":{\"path\":\"a.ply\",\"features\":{}}},\"sampling\":{\"count\":100}}"},
        {"/surface/mesh",
         "{\"version\":1,\"surface\":{\"mesh\":{\"path\":\"a.ply\"}},\"sampling\":{\"count\":100}}"},
        {"/surface/volume", "{\"version\":1,\"surface\":{\"volume\":{\"path\":\"a.nrrd\",\"isovalue\":1}},"
                            "\"sampling\":{\"count\":100}}"},
        {"/surface/labels/voxel_size", STACKED_LABELS},
        {"/surface/labels/origin", STACKED_LABELS},
        {"/surface/labels",
         "{\"version\":1,\"surface\":{\"labels\":{\"path\":\"a.nrrd\"}},\"sampling\":{\"count\":100}}"},
        {"/surface/union", COMBINED("union")},
        {"/surface/intersection", COMBINED("intersection")},
        {"/surface/difference", COMBINED("difference")},
        {"/surface/offset", "{\"version\":1,\"surface\":{\"offset\":{\"surface\":{\"analytic\":{\"shape\":"
                            "\"quartic\"}},\"distance\":1}},"
                            "\"sampling\":{\"count\":100}}"},
        {"/surface/transform",
         "{\"version\":1,\"surface\":{\"transform\":{\"surface\":{\"analytic\":{\"shape\":\"quartic\"}},"
         "\"matrix\":[1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1]}},\"sampling\":{\"count\":100}}"},
        {"/surface/exr", EXR("\"a.####.exr\"", "\"1-9\"")},
        {"/solver/step", SPHERE ",\"solver\":{\"minimiser\":\"gradient\"}}"},
        {"/sampling/curvature/chord_error", SPHERE "}"},
        {"/sampling/curvature/scale/", GRADED("\"curvature\":{\"ratio\":2}")},
        {"/sampling/curvature/scale", GRADED("\"curvature\":{\"ratio\":2,\"scale\":{\"spacings\":1}}")},
        {"/sampling/alpha/scale/", GRADED("\"alpha\":{}")},
        {"/sampling/alpha/scale", GRADED("\"alpha\":{\"scale\":{\"spacings\":1}}")},
        {"/sampling/alpha/", GRADED("\"alpha\":{}")},
        {"/sampling/curvature", GRADED("\"curvature\":{\"ratio\":2}")},
        {"/sampling/feature/", GRADED("\"feature\":{}")},
        {"/sampling/resolve", "{\"version\":1,\"surface\":{\"analytic\":{\"shape\":\"quartic\"}},"
                              "\"sampling\":{\"feature\":{}}}"},
        {"/sampling/grid", "{\"version\":1,\"surface\":{\"vdb\":{\"path\":\"a.vdb\"}},"
                           "\"sampling\":{\"count\":100,\"grid\":{\"name\":\"size\"}}}"},
        {"/sampling/points/distance",
         GRADED("\"points\":{\"path\":\"a.ply\",\"mode\":\"avoid\",\"distance\":1}")},
        {"/sampling/points", GRADED("\"points\":{\"path\":\"a.ply\",\"mode\":\"refine\"}")},
        {"/sampling/control", "{\"version\":1,\"surface\":{\"analytic\":{\"shape\":\"quartic\"}},"
                              "\"sampling\":{\"control\":{\"min_count\":100,\"max_sigma\":0.1}}}"},
        {"/output/usd",
         SPHERE ",\"output\":{\"points_usda\":true,\"usd\":{\"instancer\":{\"prototype\":\"a\"}}}}"},
        {"/output/order", "{\"version\":1,\"surface\":{\"vdb\":{\"path\":\"a.####.vdb\"}},"
                          "\"sampling\":{\"count\":100},\"queue\":{\"frames\":\"1-2\",\"coherent\":true}}"},
        {"/queue/chunk", "{\"version\":1,\"surface\":{\"vdb\":{\"path\":\"a.####.vdb\"}},"
                         "\"sampling\":{\"count\":100},\"queue\":{\"frames\":\"1-2\"}}"},
        {"/solver/witkin_heckbert", SPHERE ",\"solver\":{\"method\":\"witkin-heckbert\"}}"},
        {"/sampling/m", GRADED("\"curvature\":{\"ratio\":2}")},
        {"/sampling/gradation", GRADED("\"curvature\":{\"ratio\":2}")},
    };
    for (size_t k = 0; k < sizeof documents / sizeof *documents; k++)
        if (strncmp(row->pointer, documents[k].begins, strlen(documents[k].begins)) == 0)
            return document(documents[k].text);
    int shape = row->shapes ? __builtin_ctz(row->shapes) : 0;
    bool target = row->choice == SPEC_CHOICE_TARGET; /* only one at a time is permitted */
    char *text = mem_printf("{\"version\":1,\"surface\":{\"analytic\":{\"shape\":%s}},\"sampling\":{%s}}",
                            shapes[shape], target ? "" : "\"count\":100");
    json *root = document(text);
    free(text);
    return root;
}

static json *number_of(double value)
{
    json *list = json_new_array();
    json_append_number(list, value);
    json_at at = json_root(list);
    json *number = json_copy(json_first(&at).node);
    json_free(list);
    return number;
}

static json *numbers(double value, int count)
{
    json *list = json_new_array();
    for (int i = 0; i < count; i++) json_append_number(list, value);
    return list;
}

/* The row's value in a parsed spec's normalised text, or JSON_NONE. */
static json_type normalised_type(const spec *s, const char *pointer, double *value)
{
    char *path = mem_strdup(pointer + 1), *save = NULL;
    json_at chain[8] = {json_root(s->normalised)};
    int depth = 0;
    for (char *key = strtok_r(path, "/", &save); key; key = strtok_r(NULL, "/", &save), depth++)
        chain[depth + 1] = json_member(&chain[depth], key);
    json_at leaf = chain[depth];
    json_type type = json_type_of(leaf);
    *value = json_number(type == JSON_ARRAY ? json_first(&leaf) : leaf, NAN);
    free(path);
    return type;
}

/* Parses a document with the row set to `value` (taken over) and checks the result. */
static void try_value(const spec_row *row, json *value, bool accepted, double expected)
{
    error e = {0};
    spec_faults faults;
    json *root = document_for(row);
    put_at(root, row->pointer, value);
    char *text = json_print(root);
    spec *s = spec_parse(root, &faults, &e);
    if (!s != !accepted) fail_msg("%s: %s %s", row->pointer, text, s ? "accepted" : e.message);
    if (s) {
        double normal;
        assert_int_not_equal(normalised_type(s, row->pointer, &normal), JSON_NONE);
        if (!isnan(expected) && normal != expected)
            fail_msg("%s: %g became %g", row->pointer, expected, normal);
        assert_int_equal(faults.count, 0);
    } else {
        assert_true(faults.count >= 1);
        size_t n = strlen(row->pointer);
        if (strncmp(faults.item[0].pointer, row->pointer, n) != 0)
            fail_msg("%s: fault at %s", row->pointer, faults.item[0].pointer);
        assert_int_equal(e.code, ERROR_SPEC_INVALID);
    }
    spec_free(s);
    json_free(root);
    free(text);
}

static json *numeric(const spec_row *row, double value)
{
    bool three = row->type == SPEC_TYPE_VECTOR || row->type == SPEC_TYPE_TRIPLE;
    bool many = row->type == SPEC_TYPE_NUMBERS || row->type == SPEC_TYPE_INTEGERS;
    return three ? numbers(value, 3) : many ? numbers(value, 64) : number_of(value);
}

/* Rows whose bounds depend on another member; they have separate tests. */
static bool is_bound_by_another(const spec_row *row)
{
    const char *key = spec_row_key(row);
    return strcmp(key, "minor_radius") == 0 || strcmp(key, "major_radius") == 0 ||
           strcmp(key, "rounding") == 0 || strcmp(key, "min") == 0 || strcmp(key, "max") == 0 ||
           strcmp(key, "start_count") == 0 || strcmp(key, "matrix") == 0 || strcmp(key, "range") == 0;
}

/* Members of objects in a list, which have separate tests. */
static bool is_in_list(const spec_row *row)
{
    return strncmp(row->pointer, "/attributes/", strlen("/attributes/")) == 0;
}

static bool has_fractions(const spec_row *row)
{
    return row->type == SPEC_TYPE_NUMBER || row->type == SPEC_TYPE_VECTOR || row->type == SPEC_TYPE_NUMBERS;
}

static double beyond(const spec_row *row, double bound, int direction)
{
    if (has_fractions(row)) return nextafter(bound, direction * INFINITY);
    return bound + direction * (fabs(bound) < 9e15 ? 1 : 2);
}

static void test_bounds_of_every_row(void **state)
{
    (void)state;
    for (size_t i = 0; i < spec_row_count; i++) {
        const spec_row *row = &spec_rows[i];
        bool number = row->type == SPEC_TYPE_NUMBER || row->type == SPEC_TYPE_INTEGER ||
                      row->type == SPEC_TYPE_LARGE || row->type == SPEC_TYPE_VECTOR ||
                      row->type == SPEC_TYPE_TRIPLE || row->type == SPEC_TYPE_NUMBERS ||
                      row->type == SPEC_TYPE_INTEGERS || row->type == SPEC_TYPE_SIZE;
        if (!number) continue;
        bool open = row->flags & SPEC_LOW_OPEN;
        if (!is_bound_by_another(row)) {
            double low = open ? beyond(row, row->low, 1) : row->low;
            try_value(row, numeric(row, low), true, low);
            try_value(row, numeric(row, row->high), true, row->high);
        }
        try_value(row, numeric(row, open ? row->low : beyond(row, row->low, -1)), false, NAN);
        try_value(row, numeric(row, beyond(row, row->high, 1)), false, NAN);
        const double least = fabs(row->low) < 1e15 ? row->low : 0; /* larger doubles have no fractions */
        if (!has_fractions(row)) try_value(row, numeric(row, least + 0.25), false, NAN);
        if (row->flags & SPEC_OR_ZERO) try_value(row, numeric(row, 0), true, 0);
    }
}

/* A form and the help show titles instead of keys. */
static void test_titles_are_short_and_differ_within_a_group(void **state)
{
    (void)state;
    for (size_t i = 0; i < spec_row_count; i++) {
        const spec_row *row = &spec_rows[i];
        if (!row->title) continue;
        const size_t length = strlen(row->title);
        const bool is_file = strchr(row->title, '.') != NULL;
        if (length > 48 || row->title[length - 1] == '.' ||
            (!is_file && !isupper((unsigned char)row->title[0])))
            fail_msg("%s: %s", row->pointer, row->title);
        for (size_t k = 0; k < i; k++) {
            const spec_row *other = &spec_rows[k];
            const bool siblings = row->key_offset == other->key_offset &&
                                  strncmp(row->pointer, other->pointer, row->key_offset) == 0;
            if (siblings && other->title && strcmp(row->title, other->title) == 0)
                fail_msg("%s and %s: %s", row->pointer, other->pointer, row->title);
        }
    }
}

static void test_types_of_every_row(void **state)
{
    (void)state;
    for (size_t i = 0; i < spec_row_count; i++) {
        const spec_row *row = &spec_rows[i];
        json *wrong[] = {number_of(1.5),   numbers(1.5, 2),  json_new_object(),
                         document("true"), document("null"), document("\"no such word\"")};
        for (size_t k = 0; k < sizeof wrong / sizeof *wrong; k++) {
            bool fits =
                (row->type == SPEC_TYPE_NUMBER && k == 0) || (row->type == SPEC_TYPE_STRING && k == 5) ||
                (row->type == SPEC_TYPE_GROUP && k == 2) || (row->flags & SPEC_OR_ONE && k == 5) ||
                is_in_list(row) || ((row->flags & SPEC_SWITCH || row->type == SPEC_TYPE_BOOL) && k == 3) ||
                is_bound_by_another(row) || strcmp(row->pointer, "/surface") == 0;
            if (fits)
                json_free(wrong[k]);
            else
                try_value(row, wrong[k], false, NAN);
        }
    }
}

static void test_defaults_and_presence(void **state)
{
    (void)state;
    for (size_t i = 0; i < spec_row_count; i++) {
        const spec_row *row = &spec_rows[i];
        if (row->type == SPEC_TYPE_GROUP || is_in_list(row)) continue;
        json *root = document_for(row);
        if (row->choice == SPEC_CHOICE_TARGET) put_at(root, "/sampling/count", number_of(100));
        if (row->type == SPEC_TYPE_NUMBERS && !is_bound_by_another(row))
            put_at(root, row->pointer, numbers(1, 64));
        spec *s = spec_parse(root, NULL, NULL);
        assert_non_null(s);
        double value;
        json_type type = normalised_type(s, row->pointer, &value);
        if (row->otherwise) {
            json *expected = document(row->otherwise);
            json_at at = json_root(expected);
            assert_int_equal(type, json_type_of(at));
            if (type == JSON_NUMBER && value != json_number(at, 0))
                fail_msg("%s: default is %g", row->pointer, value);
            json_free(expected);
        }
        spec_free(s);
        json_free(root);
    }
}

static void test_words_of_every_row(void **state)
{
    (void)state;
    for (size_t i = 0; i < spec_row_count; i++) {
        const spec_row *row = &spec_rows[i];
        /* other shapes and modes require other members */
        bool shape =
            strcmp(spec_row_key(row), "shape") == 0 || strcmp(row->pointer, "/sampling/points/mode") == 0;
        for (size_t k = 0; !shape && !is_in_list(row) && row->words && row->words[k]; k++) {
            char *quoted = mem_printf(row->type == SPEC_TYPE_WORDS ? "[\"%s\"]" : "\"%s\"", row->words[k]);
            try_value(row, document(quoted), true, NAN);
            free(quoted);
        }
    }
}

static void expect_attribute(const char *attribute, const char *pointer, const char *words)
{
    spec_faults faults = {0};
    error e = {0};
    char *text =
        mem_printf("{\"version\":1,\"surface\":{\"vdb\":{\"path\":\"a.vdb\"}},\"sampling\":{\"count\":100},"
                   "\"attributes\":[{\"name\":\"a\"},%s]}",
                   attribute);
    json *root = document(text);
    assert_null(spec_parse(root, &faults, &e));
    assert_string_equal(faults.item[0].pointer, pointer);
    if (!strstr(faults.item[0].detail, words))
        fail_msg("'%s' does not say '%s'", faults.item[0].detail, words);
    json_free(root);
    free(text);
}

static void test_attributes(void **state)
{
    (void)state;
    json *root = document(
        "{\"version\":1,\"surface\":{\"vdb\":{\"path\":\"a.vdb\"}},\"sampling\":{\"count\":100},"
        "\"attributes\":[{\"name\":\"heat.1\"},{\"from\":\"b.####.nrrd\",\"as\":\"v\",\"type\":\"vector\","
        "\"interpolation\":\"cubic\"},{\"from\":\"geometry\",\"name\":\"part\"}],"
        "\"output\":{\"ply\":{\"properties\":\"blender\"}}}");
    spec *s = spec_parse(root, NULL, NULL);
    spec_input input;
    assert_non_null(s);
    assert_int_equal(s->attribute_count, 3);
    assert_string_equal(s->attributes[0].from, "surface");
    assert_int_equal(s->attributes[0].interpolation, SPEC_INTERPOLATION_LINEAR);
    assert_int_equal(s->attributes[1].type, SPEC_ATTRIBUTE_VECTOR);
    assert_int_equal(s->attributes[1].interpolation, SPEC_INTERPOLATION_CUBIC);
    assert_true(spec_input_at(s, 1, &input)); /* after the inputs of the surface */
    assert_string_equal(input.pointer, "/attributes/1/from");
    spec_set_frame(s, 7);
    assert_true(spec_input_at(s, 1, &input));
    assert_string_equal(input.path, "b.0007.nrrd");
    assert_false(spec_input_at(s, 2, &input));
    assert_int_equal(s->ply_property_count, 1);
    assert_string_equal(s->ply_properties[0], "blender");
    spec_free(s);
    json_free(root);
    s = good(
        "{\"version\":1,\"surface\":{\"analytic\":{\"shape\":\"quartic\"}},\"sampling\":{\"count\":9,\"grid\":{"
        "\"path\":\"a.####.vdb\",\"name\":\"b\"}},\"queue\":{\"frames\":\"1-2\"}}");
    spec_set_frame(s, 2);
    assert_true(spec_input_at(s, 0, &input)); /* a map is an input, and may depend on the frame */
    assert_string_equal(input.pointer, "/sampling/grid/path");
    assert_string_equal(input.path, "a.0002.vdb");
    assert_false(spec_input_at(s, 1, &input));
    spec_free(s);
    s = good(
        "{\"version\":1,\"surface\":{\"analytic\":{\"shape\":\"quartic\"}},\"sampling\":{\"count\":9,\"points\":{"
        "\"path\":\"a.####.npz\",\"mode\":\"keep\"}},\"queue\":{\"frames\":\"1-2\"}}");
    spec_set_frame(s, 2);
    assert_true(spec_input_at(s, 0, &input));
    assert_string_equal(input.pointer, "/sampling/points/path");
    assert_string_equal(input.path, "a.0002.npz");
    assert_false(spec_input_at(s, 1, &input));
    spec_free(s);
    expect_attribute("{}", "/attributes/1/as", "is required if name is absent");
    expect_attribute("{\"as\":\"a b\"}", "/attributes/1/as", "letters, digits and _");
    expect_attribute("{\"from\":\"geometry\",\"name\":\"heat\"}", "/attributes/1/name", "direction1");
    expect_attribute("{\"name\":\"b\",\"type\":\"words\"}", "/attributes/1/type", "must be one of");
    expect_attribute("{\"name\":\"b\",\"kind\":1}", "/attributes/1/kind", "unknown member");
    expect_attribute("7", "/attributes/1", "must be an object; its members are from, name, as");
}

static void labels_are_neither_cut_nor_combined(void **state)
{
    (void)state;
    static const char labels[] =
        "{\"version\":1,\"surface\":{\"labels\":{\"path\":\"a.nrrd\"}},\"sampling\":{\"count\":10}";
    char *cut = mem_printf("%s,\"region\":{\"min\":[0,0,0],\"max\":[1,1,1]}}", labels);
    expect_fault(cut, ERROR_SPEC_INVALID, "/region", "excludes surface.labels");
    free(cut);
    expect_fault(
        "{\"version\":1,\"surface\":{\"offset\":{\"distance\":1,\"surface\":{\"labels\":{\"path\":\"a.nrrd\"}}}},"
        "\"sampling\":{\"count\":10}}",
        ERROR_SPEC_INVALID, "/surface", "contains labels");
}

static void test_unknown_member_in_every_group(void **state)
{
    (void)state;
    for (size_t i = 0; i < spec_row_count; i++) {
        const spec_row *row = &spec_rows[i];
        if (row->type != SPEC_TYPE_GROUP) continue;
        error e = {0};
        spec_faults faults;
        char *pointer = mem_printf("%s/zzzzz", row->pointer);
        json *root = document_for(row);
        put_at(root, pointer, number_of(1));
        assert_null(spec_parse(root, &faults, &e));
        assert_int_equal(faults.count, 1);
        assert_string_equal(faults.item[0].pointer, pointer);
        assert_int_equal(strncmp(faults.item[0].detail, "unknown member 'zzzzz'", 22), 0);
        assert_null(strstr(faults.item[0].detail, "did you mean"));
        json_free(root);
        free(pointer);
    }
    expect_fault(SPHERE ",\"solver\":{\"max_sweep\":1}}", ERROR_SPEC_INVALID, "/solver/max_sweep",
                 "did you mean 'max_sweeps'?");
    expect_fault("{\"version\":1,\"surface\":{\"vbd\":{\"path\":\"a\"}},\"sampling\":{\"count\":10}}",
                 ERROR_SPEC_INVALID, "/surface/vbd", "did you mean 'vdb'?");
    expect_fault(SPHERE ",\"seed\":1}", ERROR_SPEC_INVALID, "/seed", "did you mean '/solver/seed'?");
    expect_fault(
        "{\"version\":1,\"surface\":{\"transform\":{\"scale\":2,\"surface\":{\"analytic\":{\"shape\":\"sphere\","
        "\"radius\":1}},\"matrix\":[1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1]}},\"sampling\":{\"count\":10}}",
        ERROR_SPEC_INVALID, "/surface/transform/scale",
        "unknown member 'scale': the members here are surface, matrix");
    expect_fault(SPHERE ",\"region\":{\"center\":[0,0,0]}}", ERROR_SPEC_INVALID, "/region/center",
                 "unknown member 'center': the members here are inside, min, max");
    expect_fault(SPHERE ",\"\":1}", ERROR_SPEC_INVALID, "/", "unknown member ''");
    expect_fault(SPHERE ",\"limits\":{\"a/b\":1}}", ERROR_SPEC_INVALID, "/limits/a~1b",
                 "unknown member 'a/b'");
}

/* ---- other tests */

static void test_fields(void **state)
{
    (void)state;
    spec *s =
        good("{\"version\":1,\"name\":\"n\",\"surface\":{\"vdb\":{\"path\":\"p\",\"grid\":\"g\","
             "\"isovalue\":0.5,"
             "\"reconstruction\":\"smoothing\"}},\"sampling\":{\"count\":5000,\"alpha\":{\"d\":3}},"
             "\"solver\":{\"sigma\":0.125,\"init\":\"random\",\"seed\":9007199254740992,\"threads\":3},"
             "\"output\":{\"ply\":{\"format\":\"ascii\",\"precision\":\"double\"},\"preview\":{\"size\":"
             "[640,480],"
             "\"color\":\"curvature\"}},\"limits\":{\"memory_mb\":512,\"timeout_s\":1.5,\"max_"
             "attempts\":2},"
             "\"queue\":{\"priority\":-7,\"labels\":[\"a\",\"b\xc3\xa4\"]}}");
    assert_int_equal(s->surface.kind, SPEC_SURFACE_VDB);
    assert_string_equal(s->name, "n");
    assert_string_equal(s->surface.vdb.path, "p");
    assert_string_equal(s->surface.vdb.grid, "g");
    assert_true(s->surface.vdb.has_isovalue && s->surface.vdb.isovalue == 0.5);
    assert_int_equal(s->surface.vdb.reconstruction, SPEC_RECONSTRUCTION_SMOOTHING);
    assert_int_equal(s->count, 5000);
    assert_true(s->has_alpha && s->alpha.d == 3 && s->alpha.gamma == 0.1 && s->alpha.nu == 0.75 &&
                s->alpha.kappa_max == 20);
    assert_true(s->sigma == 0.125 && s->seed == UINT64_C(9007199254740992) && s->threads == 3);
    assert_int_equal(s->init, SPEC_INIT_RANDOM);
    assert_int_equal(s->max_sweeps, 5000);
    assert_true(s->step_tolerance == 3e-3 && s->energy_tolerance == 0.05);
    assert_int_equal(s->ply_format, SPEC_PLY_ASCII);
    assert_int_equal(s->ply_precision, SPEC_PRECISION_DOUBLE);
    assert_true(s->has_preview && s->preview_width == 640 && s->preview_height == 480);
    assert_int_equal(s->preview_color, SPEC_COLOR_CURVATURE);
    assert_true(s->memory_mb == 512 && s->timeout_s == 1.5 && s->stall_s == 0 && s->max_attempts == 2);
    assert_int_equal(s->priority, -7);
    assert_int_equal(s->label_count, 2);
    assert_string_equal(s->labels[1], "b\xc3\xa4");
    spec_free(s);
    s = good("{\"version\":1,\"surface\":{\"analytic\":{\"shape\":\"torus\",\"axis\":[0,2,0],\"major_"
             "radius\":2,"
             "\"minor_radius\":1}},\"sampling\":{\"count\":4},\"output\":{\"preview\":{\"size\":64}}}");
    assert_int_equal(s->surface.kind, SPEC_SURFACE_ANALYTIC);
    assert_int_equal(s->surface.analytic.shape, SPEC_SHAPE_TORUS);
    assert_true(s->surface.analytic.axis.y == 2 && s->surface.analytic.center.x == 0.5 &&
                s->surface.analytic.radius == 0);
    assert_int_equal(s->preview_height, 64);
    assert_int_equal(s->preview_color, SPEC_COLOR_SHADING);
    assert_true(!s->has_alpha && !s->name);
    spec_free(s);
    spec_free(NULL);
}

static void test_region(void **state)
{
    (void)state;
    spec *s = good(SPHERE ",\"region\":{\"min\":[-1,0,0.5],\"max\":[1,2,0.75]}}");
    assert_true(s->has_region && s->region.min.z == 0.5 && s->region.max.z == 0.75);
    spec_free(s);
    s = good(SPHERE "}");
    assert_false(s->has_region);
    spec_free(s);
    expect_fault(SPHERE ",\"region\":{\"min\":[0,0,0]}}", ERROR_SPEC_INVALID, "/region/max",
                 "is required with min: a box is {\"min\": [0, 0, 0], \"max\": [1, 1, 1]}");
    expect_fault(SPHERE ",\"region\":{\"max\":[1,1,1]}}", ERROR_SPEC_INVALID, "/region/min",
                 "is required with max: a box is {\"min\": [0, 0, 0], \"max\": [1, 1, 1]}");
    expect_fault(SPHERE ",\"region\":{}}", ERROR_SPEC_INVALID, "/region", "exactly one of inside, min");
    expect_fault(SPHERE ",\"region\":{\"min\":[0,0,0],\"max\":[1,1,0]}}", ERROR_SPEC_INVALID, "/region/max/2",
                 "max must be above min, 0 (given 0)");
    expect_fault(SPHERE ",\"region\":{\"min\":[0,0,0],\"max\":[1,-1,\"x\"]}}", ERROR_SPEC_INVALID,
                 "/region/max/2", "must be a number");
    expect_fault(
        SPHERE
        ",\"region\":{\"inside\":{\"analytic\":{\"shape\":\"quartic\"}},\"min\":[0,0,0],\"max\":[1,1,1]}}",
        ERROR_SPEC_INVALID, "/region", "exactly one of inside, min");
    s = good(SPHERE ",\"region\":{\"inside\":{\"mesh\":{\"path\":\"a.stl\"}}}}");
    spec_input input;
    assert_true(s->has_region && s->region_inside->kind == SPEC_SURFACE_MESH && spec_input_at(s, 0, &input));
    assert_string_equal(input.pointer, "/region/inside/mesh/path");
    assert_false(spec_input_at(s, 1, &input));
    spec_free(s);
    expect_fault(SPHERE ",\"region\":[0,1]}", ERROR_SPEC_INVALID, "/region", "must be an object");
}

/* A document with a B-spline of 4 x 4 x 4 coefficients and these additional members. */
static char *bspline(const char *dims, const char *members)
{
    return mem_printf("{\"version\":1,\"surface\":{\"bspline\":{\"dims\":%s%s}},\"sampling\":{"
                      "\"count\":100}}",
                      dims, members);
}

static void expect_bspline_fault(const char *dims, const char *members, const char *pointer,
                                 const char *words)
{
    char *text = bspline(dims, members);
    expect_fault(text, ERROR_SPEC_INVALID, pointer, words);
    free(text);
}

/* `count` coefficients; the one with the index `odd` is `value`. */
static char *coefficients(int count, int odd, const char *value)
{
    char *list = mem_strdup(",\"coefficients\":[");
    for (int i = 0; i < count; i++) {
        char *longer = i == odd ? mem_printf("%s%s%s", list, i ? "," : "", value)
                                : mem_printf("%s%s%d", list, i ? "," : "", i - 30);
        free(list);
        list = longer;
    }
    char *closed = mem_printf("%s]", list);
    free(list);
    return closed;
}

static void test_bspline(void **state)
{
    (void)state;
    char *list = coefficients(80, 7, "-1.25e3");
    char *members = mem_printf("%s,\"domain\":{\"min\":[-1,-2,-3]}", list);
    char *text = bspline("[4,5,4]", members);
    spec *s = good(text);
    assert_int_equal(s->surface.kind, SPEC_SURFACE_BSPLINE);
    assert_true(s->surface.bspline.dims[0] == 4 && s->surface.bspline.dims[1] == 5 &&
                s->surface.bspline.dims[2] == 4);
    assert_int_equal(s->surface.bspline.coefficient_count, 80);
    assert_true(s->surface.bspline.coefficients[7] == -1250 && s->surface.bspline.coefficients[79] == 49);
    assert_true(s->surface.bspline.domain.min.z == -3 && s->surface.bspline.domain.max.z == 1 &&
                !s->surface.bspline.path);
    spec_free(s);
    expect_bspline_fault("[4,4,4]", members, "/surface/bspline/coefficients", "4 x 4 x 4 = 64 (given 80)");
    free(text);
    free(members);
    free(list);
    text = bspline("[9,4,4096]", ",\"path\":\"c.raw\"");
    s = good(text);
    assert_string_equal(s->surface.bspline.path, "c.raw");
    assert_null(s->surface.bspline.coefficients);
    spec_free(s);
    free(text);
    static const char *const bad_values[] = {"null", "\"1\"", "[1]", "1e31", "1e999"};
    for (size_t k = 0; k < sizeof bad_values / sizeof *bad_values; k++) {
        list = coefficients(64, 41, bad_values[k]);
        text = bspline("[4,4,4]", list);
        json *root = json_parse(text, strlen(text), NULL);
        if (root) /* 1e999 is refused when the JSON is parsed, or here */
            expect_bspline_fault("[4,4,4]", list, "/surface/bspline/coefficients/41", "must be a number");
        json_free(root);
        free(text);
        free(list);
    }
    expect_bspline_fault("[4,4,3]", ",\"path\":\"c\"", "/surface/bspline/dims/2", "(given 3)");
    expect_bspline_fault("[4,4,4]", "", "/surface/bspline", "exactly one of coefficients, path (given none)");
    expect_bspline_fault("[4,4,4]", ",\"path\":\"c\",\"domain\":{\"max\":[1,0,1]}",
                         "/surface/bspline/domain/max/1", "max must be above min, 0 (given 0)");
    expect_bspline_fault("[4,4,4]", ",\"path\":\"c\",\"domain\":{\"min\":[0,0,1]}", "/surface/bspline/domain",
                         "max must be above min, 1 (given 1)");
}

/* An array is read in one pass: by index, this would take minutes. */
static void test_many_coefficients(void **state)
{
    (void)state;
    json *root = document("{\"version\":1,\"sampling\":{\"count\":9}}"), *list = numbers(-1, 64 * 64 * 64);
    put_at(root, "/surface/bspline/coefficients", list);
    put_at(root, "/surface/bspline/dims", numbers(64, 3));
    spec *s = spec_parse(root, NULL, NULL);
    assert_non_null(s);
    assert_int_equal(s->surface.bspline.coefficient_count, 64 * 64 * 64);
    spec_free(s);
    json_free(root);
}

static void test_preview_switch(void **state)
{
    (void)state;
    static const char *const values[] = {"true", "{}", "false"};
    for (int i = 0; i < 3; i++) {
        char *text = mem_printf(SPHERE ",\"output\":{\"preview\":%s}}", values[i]);
        spec *s = good(text);
        assert_int_equal(s->has_preview, i < 2);
        if (i < 2) assert_int_equal(s->preview_width, 512);
        spec_free(s);
        free(text);
    }
    spec *s = good("{\"version\":1,\"surface\":{\"analytic\":{\"shape\":\"quartic\"}},"
                   "\"sampling\":{\"count\":100,\"alpha\":{}}}");
    assert_true(s->has_preview && s->preview_color == SPEC_COLOR_ALPHA && s->surface.analytic.r == 0.13);
    spec_free(s);
}

static void test_normalised_is_idempotent(void **state)
{
    (void)state;
    static const char *const texts[] = {
        SPHERE "}",
        SPHERE ",\"output\":{\"preview\":false}}",
        SPHERE ",\"output\":{\"preview\":true},\"queue\":{\"labels\":[\"x\"]},\"name\":\"\\\"\\u00e4\"}",
        "{\"sampling\":{\"alpha\":{},\"count\":1e3},\"version\":1.0,\"solver\":{\"seed\":-0},"
        "\"surface\":{\"vdb\":{\"path\":\"p\",\"isovalue\":-0.0}}}",
        "{\"version\":1,\"surface\":{\"analytic\":{\"shape\":\"gyroid\",\"period\":0.3}},"
        "\"sampling\":{\"count\":9}}",
    };
    for (size_t i = 0; i < sizeof texts / sizeof *texts; i++) {
        spec *s = good(texts[i]);
        char *once = json_print(s->normalised);
        spec *again = good(once);
        char *twice = json_print(again->normalised);
        assert_string_equal(once, twice);
        assert_null(strstr(once, "-0,"));
        spec_free(s);
        spec_free(again);
        free(once);
        free(twice);
    }
    spec *s = good(SPHERE "}");
    char *text = json_print(s->normalised);
    assert_string_equal(
        text,
        "{\"version\":1,\"surface\":{\"analytic\":{\"shape\":\"sphere\",\"center\":[0.5,0.5,0.5],"
        "\"radius\":0.4}},\"features\":false,"
        "\"sampling\":{\"count\":100,\"pattern\":\"hexagonal\"},\"solver\":{\"method\":\"sized\",\"energy\":\"cotangent\","
        "\"minimiser\":\"lm\",\"sigma\":0,\"init\":\"surface\",\"seed\":0,\"threads\":0,\"isa\":"
        "\"auto\",\"max_sweeps\":5000,"
        "\"step_tolerance\":0.003,\"energy_tolerance\":0.05},\"output\":{\"ply\":{\"format\":"
        "\"binary_little_endian\",\"precision\":\"float\"},\"preview\":{\"size\":[512,512],"
        "\"color\":\"shading\",\"map\":\"viridis\",\"channels\":\"basic\",\"compression\":\"zip\",\"up\":\"auto\",\"turntable\":0},\"preview_exr\":false,\"convergence\":false,"
        "\"points_vdb\":false,\"points_npz\":false,\"points_vtp\":false,\"points_glb\":false,\"points_usda\":false,"
        "\"mesh\":false,\"mesh_usda\":false,\"label_meshes\":false},"
        "\"limits\":{\"memory_mb\":0,\"timeout_s\":0,\"stall_s\":0,\"max_chunks\":100000,\"image_pixels\":268435456,\"image_scans\":500,\"max_attempts\":0},"
        "\"queue\":{\"priority\":0,\"labels\":[],\"depends_on\":[],\"after\":[],\"after_frames\":[],"
        "\"accept\":[\"converged\",\"unresolved\",\"not_converged\"],\"max_running\":0,\"chunk\":1,\"coherent\":false,"
        "\"retention_s\":0,\"slurm\":[]}}");
    free(text);
    spec_free(s);
}

static void test_mesh(void **state)
{
    (void)state;
    static const struct {
        const char *members;
        double voxel_size;
        int resolution, max_resolution, band_vox;
    } cases[] = {{"", 0, 0, 4096, 4},
                 {",\"max_resolution\":512", 0, 0, 512, 4},
                 {",\"resolution\":100,\"band_vox\":6", 0, 100, 0, 6},
                 {",\"voxel_size\":0.5", 0.5, 0, 0, 4}};
    for (size_t k = 0; k < sizeof cases / sizeof *cases; k++) {
        char *text = mem_printf(
            "{\"version\":1,\"surface\":{\"mesh\":{\"path\":\"a/b.obj\"%s}},\"sampling\":{\"count\":9}}",
            cases[k].members);
        json *root = document(text);
        spec *s = spec_parse(root, NULL, NULL);
        assert_non_null(s);
        assert_int_equal(s->surface.kind, SPEC_SURFACE_MESH);
        assert_string_equal(s->surface.mesh.path, "a/b.obj");
        assert_true(s->surface.mesh.voxel_size == cases[k].voxel_size);
        assert_int_equal(s->surface.mesh.resolution, cases[k].resolution);
        assert_int_equal(s->surface.mesh.max_resolution, cases[k].max_resolution);
        assert_int_equal(s->surface.mesh.band_vox, cases[k].band_vox);
        spec_free(s);
        json_free(root);
        free(text);
    }
}

static void test_inputs(void **state)
{
    (void)state;
    static const char *const kinds[] = {"vdb", "mesh"};
    for (int k = 0; k < 2; k++) {
        char *text = mem_printf(
            "{\"version\":1,\"surface\":{\"%s\":{\"path\":\"a\"}},\"sampling\":{\"count\":9}}", kinds[k]);
        char *pointer = mem_printf("/surface/%s/path", kinds[k]);
        json *root = document(text);
        spec *s = spec_parse(root, NULL, NULL);
        spec_input input;
        assert_non_null(s);
        assert_true(spec_input_at(s, 0, &input));
        assert_string_equal(input.pointer, pointer);
        assert_string_equal(input.path, "a");
        assert_false(spec_input_at(s, 1, &input));
        spec_free(s);
        json_free(root);
        free(pointer);
        free(text);
    }
    json *root = document(SPHERE "}");
    spec *s = spec_parse(root, NULL, NULL);
    spec_input input;
    assert_false(spec_input_at(s, 0, &input));
    spec_free(s);
    json_free(root);
}

static void test_slices(void **state)
{
    (void)state;
    static const struct {
        const char *text;
        const char *first, *last;
        size_t count;
        int step;
    } cases[] = {{EXR("\"d/a.####.exr\"", "\"1-93\""), "d/a.0001.exr", "d/a.0093.exr", 93, 1},
                 {EXR("\"a%04d.exr\"", "\"0-10x5\""), "a0000.exr", "a0010.exr", 3, 5},
                 {EXR("\"#\"", "\"9-11\""), "9", "11", 3, 1},
                 {EXR("\"a.%d\"", "\"8-13x2\""), "a.8", "a.12", 3, 2}};
    for (size_t k = 0; k < sizeof cases / sizeof *cases; k++) {
        spec *s = good(cases[k].text);
        spec_input input;
        assert_int_equal(s->surface.kind, SPEC_SURFACE_EXR);
        assert_int_equal(s->surface.exr.count, cases[k].count);
        assert_int_equal(s->surface.exr.numbers[1] - s->surface.exr.numbers[0], cases[k].step);
        assert_true(spec_input_at(s, 0, &input));
        assert_string_equal(input.path, cases[k].first);
        assert_true(spec_input_at(s, cases[k].count - 1, &input));
        assert_string_equal(input.path, cases[k].last);
        assert_string_equal(input.pointer, "/surface/exr/path");
        assert_false(spec_input_at(s, cases[k].count, &input));
        spec_free(s);
    }
    static const char *const slices[] = {"\"1\"",    "\"1-\"",   "\"3-3\"",   "\"9-1\"",    "\"1-9x0\"",
                                         "\"1-9x\"", "\"1-9 \"", "\"1-3x5\"", "\"0-65536\""};
    for (size_t k = 0; k < sizeof slices / sizeof *slices; k++) {
        char *text =
            mem_printf("{\"surface\":{\"exr\":{\"path\":\"#\",\"slices\":%s,\"isovalue\":1}}}", slices[k]);
        expect_fault(text, ERROR_SPEC_INVALID, "/surface/exr/slices", "must be");
        free(text);
    }
    static const char *const paths[] = {"a", "a#b##", "%04d%d", "#%d", "%s", "%", "%1234d", "%5.d"};
    for (size_t k = 0; k < sizeof paths / sizeof *paths; k++) {
        char *text = mem_printf("{\"surface\":{\"exr\":{\"path\":\"%s\",\"slices\":\"1-3\",\"isovalue\":1}}}",
                                paths[k]);
        expect_fault(text, ERROR_SPEC_INVALID, "/surface/exr/path", "must contain one ####, %04d or $F4");
        free(text);
    }
}

static void test_surfaces_of_surfaces(void **state)
{
    (void)state;
    spec *s = good(
        "{\"version\":1,\"surface\":{\"difference\":[{\"vdb\":{\"path\":\"a.vdb\"}},{\"offset\":{\"surface\":"
        "{\"union\":[{\"mesh\":{\"path\":\"b.ply\"}},{\"analytic\":{\"shape\":\"sphere\",\"radius\":2}}]},"
        "\"distance\":-0.5}}]},\"sampling\":{\"count\":100}}");
    const spec_surface *whole = &s->surface, *offset = whole->parts[1], *both = offset->parts[0];
    spec_input input;
    assert_int_equal(whole->kind, SPEC_SURFACE_DIFFERENCE);
    assert_int_equal(whole->part_count, 2);
    assert_int_equal(whole->parts[0]->kind, SPEC_SURFACE_VDB);
    assert_int_equal(offset->kind, SPEC_SURFACE_OFFSET);
    assert_true(offset->distance == -0.5);
    assert_int_equal(both->kind, SPEC_SURFACE_UNION);
    assert_int_equal(both->parts[0]->mesh.max_resolution, 4096);
    assert_true(both->parts[1]->analytic.radius == 2 && both->parts[1]->analytic.center.x == 0.5);
    assert_true(spec_input_at(s, 0, &input));
    assert_string_equal(input.pointer, "/surface/difference/0/vdb/path");
    assert_true(spec_input_at(s, 1, &input));
    assert_string_equal(input.pointer, "/surface/difference/1/offset/surface/union/0/mesh/path");
    assert_string_equal(input.path, "b.ply");
    assert_false(spec_input_at(s, 2, &input));
    spec_free(s);
}

static void test_faults(void **state)
{
    (void)state;
    const error_code invalid = ERROR_SPEC_INVALID;
    expect_fault("[]", invalid, "", "must be an object; its members are version, name, surface");
    expect_fault("{\"surface\":\"a.obj\"}", invalid, "/surface", "its members are vdb, mesh, analytic");
    expect_fault("{\"surface\":{\"mesh\":\"a.obj\"}}", invalid, "/surface/mesh",
                 "must be an object such as {\"path\": \"a.obj\"} (given \"a.obj\")");
    expect_fault("{\"output\":{\"orient\":\"up\"}}", invalid, "/output/orient",
                 "must be true, false or an object such as {\"twist\": \"up\"} (given \"up\")");
    expect_fault("{\"output\":{\"orient\":null}}", invalid, "/output/orient",
                 "must be true, false or an object; its members are twist, seed, up (given null)");
    expect_fault("{\"sampling\":1000}", invalid, "/sampling", "(given 1000)");
    expect_fault("{}", invalid, "/version", "is required and must be 1");
    expect_fault("{}", invalid, "/surface", "is required and must be an object");
    expect_fault("{}", invalid, "/sampling", "is required and must be an object");
    expect_fault("{\"version\":2}", invalid, "/version", "must be 1 (given 2)");
    expect_fault("{\"surface\":{}}", invalid, "/surface", "give exactly one of vdb, mesh, analytic");
    expect_fault("{\"surface\":{\"vdb\":{},\"mesh\":{}}}", invalid, "/surface", "(given vdb, mesh)");
    expect_fault("{\"surface\":{\"vdb\":{}}}", invalid, "/surface/vdb/path",
                 "is required and must be a string");
    expect_fault("{\"surface\":{\"analytic\":{\"shape\":\"sphere\"}}}", invalid, "/surface/analytic/radius",
                 "is required and must be a number above 0 and at most ");
    expect_fault("{\"surface\":{\"analytic\":{\"radius\":1}}}", invalid, "/surface/analytic/shape",
                 "is required and must be one of \"sphere\", ");
    expect_fault("{\"surface\":{\"analytic\":{\"shape\":\"box\"}}}", invalid, "/surface/analytic/half_size",
                 "is required and must be an array of three numbers");
    expect_fault("{\"surface\":{\"offset\":{\"distance\":1}}}", invalid, "/surface/offset/surface",
                 "is required and must be an object");
    expect_fault("{\"surface\":{\"volume\":{\"path\":\"a.nrrd\"}}}", invalid, "/surface/volume/isovalue",
                 "is required and must be a number: hexadctl inspect FILE suggests one");
    expect_fault("{\"surface\":{\"vdb\":{\"path\":\"\"}}}", invalid, "/surface/vdb/path",
                 "characters (given 0)");
    expect_fault("{\"surface\":{\"mesh\":{\"path\":\"a.stl\",\"voxel_size\":1,\"resolution\":9}}}", invalid,
                 "/surface/mesh", "give at most one of voxel_size, resolution");
    expect_fault("{\"surface\":{\"mesh\":{\"path\":\"a.stl\",\"bandvox\":4}}}", invalid,
                 "/surface/mesh/bandvox", "did you mean 'band_vox'?");
    expect_fault("{\"sampling\":{}}", invalid, "/sampling",
                 "exactly one of count, spacing, density, control, resolve");
    expect_fault("{\"sampling\":{\"alpha\":{},\"curvature\":{}}}", invalid, "/sampling",
                 "give at most one of alpha");
    expect_fault("{\"sampling\":{\"count\":3}}", invalid, "/sampling/count",
                 "from 4 to 100000000 points (given 3)");
    expect_fault("{\"sampling\":{\"count\":4.5}}", invalid, "/sampling/count", "must be an integer from");
    expect_fault("{\"sampling\":{\"count\":\"many\"}}", invalid, "/sampling/count", "(given \"many\")");
    expect_fault("{\"surface\":{\"analytic\":{\"shape\":\"sphere\",\"radius\":0}}}", invalid,
                 "/surface/analytic/radius", "must be a number above 0 and at most 1000000000000 (given 0)");
    expect_fault("{\"surface\":{\"analytic\":{\"shape\":\"sphere\",\"radius\":1,\"period\":1}}}", invalid,
                 "/surface/analytic/period", "is not a member of the shape \"sphere\"");
    expect_fault("{\"surface\":{\"analytic\":{\"shape\":\"cube\"}}}", invalid, "/surface/analytic/shape",
                 "must be one of \"sphere\", \"torus\"");
    expect_fault("{\"surface\":{\"analytic\":{\"shape\":\"torus\",\"major_radius\":1,\"minor_radius\":1}}}",
                 invalid, "/surface/analytic/minor_radius", "less than major_radius, 1 (given 1)");
    expect_fault("{\"surface\":{\"analytic\":{\"shape\":\"torus\",\"major_radius\":2,\"minor_radius\":1,"
                 "\"axis\":[0,0,0]}}}",
                 invalid, "/surface/analytic/axis", "zero vector");
    expect_fault(
        "{\"surface\":{\"analytic\":{\"shape\":\"cylinder\",\"radius\":1,\"height\":1,\"rounding\":0.6}}}",
        invalid, "/surface/analytic/rounding",
        "at most the smallest half size or radius of the shape, 0.5 (given 0.6)");
    expect_fault(
        "{\"version\":1,\"surface\":{\"analytic\":{\"shape\":\"halfspace\"}},\"sampling\":{\"count\":9}}",
        invalid, "/surface", "it contains a halfspace");
    expect_fault("{\"version\":1,\"surface\":{\"union\":[{\"analytic\":{\"shape\":\"quartic\"}},"
                 "{\"analytic\":{\"shape\":\"halfspace\"}}]},\"sampling\":{\"count\":9}}",
                 invalid, "/surface", "give a region");
    expect_fault("{\"surface\":{\"analytic\":{\"shape\":\"box\",\"half_size\":[1,2,3],\"rounding\":1.5}}}",
                 invalid, "/surface/analytic/rounding",
                 "at most the smallest half size or radius of the shape, 1 (given 1.5)");
    expect_fault("{\"surface\":{\"analytic\":{\"shape\":\"box\",\"half_size\":[1,-2,3]}}}", invalid,
                 "/surface/analytic/half_size/1", "(given -2)");
    expect_fault(SPHERE ",\"output\":{\"preview\":{\"size\":[64,8193]}}}", invalid, "/output/preview/size/1",
                 "8193");
    expect_fault(SPHERE ",\"queue\":{\"labels\":[\"a\",7]}}", invalid, "/queue/labels/1", "(given 7)");
    expect_fault("{\"sampling\":{\"resolve\":true}}", invalid, "/sampling/resolve",
                 "add \"feature\": {} to /sampling");
    expect_fault("{\"sampling\":{\"resolve\":false,\"feature\":{}}}", invalid, "/sampling/resolve",
                 "must be true");
    expect_fault("{\"sampling\":{\"resolve\":true,\"feature\":{},\"curvature\":{\"ratio\":2}}}", invalid,
                 "/sampling/curvature", "excludes resolve");
    expect_fault("{\"sampling\":{\"count\":9,\"feature\":{},\"alpha\":{}}}", invalid, "/sampling/alpha",
                 "excludes feature");
    expect_fault("{\"sampling\":{\"time_s\":9}}", invalid, "/sampling/time_s",
                 "was removed: give count, spacing or density");
    expect_fault("{\"sampling\":{\"control\":{\"min_count\":9}}}", invalid, "/sampling/control/max_sigma",
                 "is required and must be a number above 0");
    expect_fault("{\"sampling\":{\"control\":{\"min_count\":9,\"max_sigma\":1,\"start_count\":8}}}", invalid,
                 "/sampling/control/start_count", "at least min_count, 9 (given 8)");
    expect_fault(SPHERE ",\"solver\":{\"witkin_heckbert\":{}}}", invalid, "/solver/witkin_heckbert",
                 "requires the method \"witkin-heckbert\"");
    expect_fault(SPHERE ",\"solver\":{\"method\":\"paper\",\"witkin_heckbert\":{}}}", invalid,
                 "/solver/witkin_heckbert", "is not a member of the method \"paper\"");
    expect_fault(SPHERE ",\"solver\":{\"method\":\"witkin-heckbert\",\"energy\":\"gaussian\"}}", invalid,
                 "/solver/energy", "is not a member of the method \"witkin-heckbert\"");
    expect_fault(UNIT_SPHERE
                 ",\"sampling\":{\"control\":{\"min_count\":9,\"max_sigma\":1}},\"solver\":{\"method\":"
                 "\"witkin-heckbert\"}}",
                 invalid, "/solver/method", "requires the method \"sized\" or \"paper\"");
    expect_fault(SPHERE ",\"solver\":{\"step\":0.1}}", invalid, "/solver/step", "requires the minimiser");
    expect_fault(UNIT_SPHERE ",\"sampling\":{\"count\":9,\"alpha\":{}},\"solver\":{\"method\":\"sized\"}}",
                 invalid, "/solver/method", "requires the method \"paper\" or \"witkin-heckbert\"");
    assert_null(spec_parse(NULL, NULL, NULL));
}

static void test_all_faults_are_collected(void **state)
{
    (void)state;
    error e = {0};
    spec_faults faults =
        bad("{\"version\":1,\"surface\":{\"analytic\":{\"shape\":\"quartic\"}},\"sampling\":{\"count\":1,"
            "\"counts\":1},"
            "\"solver\":{\"seed\":-1,\"threads\":\"x\"},\"output\":{\"mesh\":{}},\"queue\":{\"webhook\":{}}}",
            &e);
    assert_int_equal(faults.count, 6);
    assert_int_equal(e.code, ERROR_SPEC_INVALID);
    assert_string_equal(e.message,
                        "/sampling/counts: unknown member 'counts': did you mean 'count'? (and 5 more)");
    char *text = mem_strdup(SPHERE);
    for (int i = 0; i < 500; i++) {
        char *longer = mem_printf("%s,\"unknown%d\":1", text, i);
        free(text);
        text = longer;
    }
    char *closed = mem_printf("%s}", text);
    faults = bad(closed, &e);
    assert_int_equal(faults.count, SPEC_MAX_FAULTS);
    free(text);
    free(closed);
}

static void test_coherent_sequences(void **state)
{
    (void)state;
    static const char start[] = "{\"version\":1,\"surface\":{\"vdb\":{\"path\":\"a.####.vdb\"}},\"queue\":"
                                "{\"frames\":\"1-3\",\"coherent\":true},\"sampling\":";
    static const char *const wrong[][2] = {
        {"{\"count\":9},\"solver\":{\"method\":\"paper\"}}", "\"sized\""},
        {"{\"count\":9,\"alpha\":{\"d\":1}}}", "excludes /sampling/alpha: replace alpha by "}};
    error e = {0};
    char *text = mem_printf("%s{\"count\":9}}", start);
    json *document = json_parse(text, strlen(text), NULL);
    spec *s = spec_parse(document, NULL, &e);
    if (!s) fail_msg("%s", e.message);
    assert_true(s->coherent);
    spec_free(s);
    json_free(document);
    free(text);
    for (size_t k = 0; k < sizeof wrong / sizeof *wrong; k++) {
        text = mem_printf("%s%s", start, wrong[k][0]);
        spec_faults faults = bad(text, &e);
        assert_string_equal(faults.item[0].pointer, "/queue/coherent");
        assert_non_null(strstr(e.message, wrong[k][1]));
        free(text);
    }
    spec_faults faults = bad(SPHERE ",\"queue\":{\"coherent\":true}}", &e);
    assert_string_equal(faults.item[0].pointer, "/queue/coherent");
    assert_non_null(strstr(e.message, "queue.frames"));
}

static void test_chunks(void **state)
{
    (void)state;
    error e = {0};
    static const char *const wrong[][2] = {
        {SPHERE ",\"queue\":{\"chunk\":2}}", "requires queue.frames"},
        {"{\"version\":1,\"surface\":{\"vdb\":{\"path\":\"a.####.vdb\"}},\"sampling\":{\"count\":9},"
         "\"queue\":{\"frames\":\"1-9\",\"chunk\":3,\"coherent\":true}}",
         "excludes queue.coherent"},
        {SPHERE ",\"queue\":{\"chunk\":0}}", "from 1 to 1000"},
        {SPHERE ",\"queue\":{\"chunk\":1001}}", "from 1 to 1000"},
        {SPHERE ",\"queue\":{\"chunk\":1.5}}", "integer"},
    };
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++) {
        spec_faults faults = bad(wrong[i][0], &e);
        assert_int_equal(faults.count, 1);
        assert_string_equal(faults.item[0].pointer, "/queue/chunk");
        if (!strstr(e.message, wrong[i][1])) fail_msg("%s", e.message);
    }
}

static void test_frames(void **state)
{
    (void)state;
    error e = {0};
    static const char sequence[] =
        "{\"version\":1,\"surface\":{\"vdb\":{\"path\":\"a.####.vdb\"}},\"sampling\":"
        "{\"count\":9},\"queue\":{\"frames\":\"8-12x2\",\"depends_on\":[\"x\"],"
        "\"retention_s\":60,\"chunk\":2}}";
    json *document = json_parse(sequence, sizeof sequence - 1, NULL);
    spec *s = spec_parse(document, NULL, &e);
    json_free(document);
    if (!s) fail_msg("%s", e.message);
    assert_int_equal(s->frame_count, 3);
    assert_int_equal(s->frame[2], 12);
    assert_int_equal(s->depends_on_count, 1);
    assert_string_equal(s->depends_on[0], "x");
    assert_int_equal(s->retention_s, 60);
    assert_int_equal(s->chunk, 2);
    spec_set_frame(s, 10);
    assert_string_equal(s->surface.vdb.path, "a.0010.vdb");
    spec_free(s);
    spec_faults faults = bad(SPHERE ",\"queue\":{\"frames\":\"1-3\"}}", &e);
    assert_string_equal(faults.item[0].pointer, "/queue/frames");
    assert_non_null(strstr(e.message, "####"));
    faults = bad(SPHERE ",\"queue\":{\"frames\":\"3-1\"}}", &e);
    assert_string_equal(faults.item[0].pointer, "/queue/frames");
    assert_non_null(strstr(e.message, "3-1"));
    faults = bad(SPHERE ",\"queue\":{\"after_frames\":[\"x\"]}}", &e);
    assert_string_equal(faults.item[0].pointer, "/queue/after_frames");
    assert_non_null(strstr(e.message, "requires queue.frames"));
    faults = bad(SPHERE ",\"queue\":{\"frames\":\"all\",\"by_frame\":{\"/solver/seed\":[1]}}}", &e);
    assert_string_equal(faults.item[0].pointer, "/queue/frames");
    assert_non_null(strstr(e.message, "requires the path of a file with ####"));
}

static void test_accepted_outcomes(void **state)
{
    (void)state;
    error e = {0};
    static const char *const given[][2] = {
        {"{}", "[\"converged\",\"unresolved\",\"not_converged\"]"},
        {"{\"accept\":[\"unresolved\",\"converged\"]}", "[\"converged\",\"unresolved\"]"}};
    static const unsigned expected[] = {7, 1u << SPEC_OUTCOME_CONVERGED | 1u << SPEC_OUTCOME_UNRESOLVED};
    for (size_t k = 0; k < 2; k++) {
        char *text = mem_printf(SPHERE ",\"queue\":%s}", given[k][0]);
        json *root = document(text);
        spec *s = spec_parse(root, NULL, &e);
        if (!s) fail_msg("%s", e.message);
        assert_int_equal(s->accept, expected[k]);
        char *normal = json_print(json_find(s->normalised, "/queue/accept"));
        assert_string_equal(normal, given[k][1]);
        free(normal);
        spec_free(s);
        json_free(root);
        free(text);
    }
    static const char *const wrong[][2] = {{"[]", "/queue/accept"},
                                           {"\"converged\"", "/queue/accept"},
                                           {"[\"converged\",\"converged\"]", "/queue/accept/1"},
                                           {"[\"converged\",\"good\"]", "/queue/accept/1"}};
    for (size_t k = 0; k < sizeof wrong / sizeof *wrong; k++) {
        char *text = mem_printf(SPHERE ",\"queue\":{\"accept\":%s}}", wrong[k][0]);
        spec_faults faults = bad(text, &e);
        assert_string_equal(faults.item[0].pointer, wrong[k][1]);
        free(text);
    }
}

#define BY_FRAME(values) SPHERE ",\"queue\":{\"frames\":\"10-14x2\",\"by_frame\":" values "}}"

static spec *parse_by_frame(const char *text)
{
    error e = {0};
    json *root = document(text);
    spec *s = spec_parse(root, NULL, &e);
    json_free(root);
    if (!s) fail_msg("%s", e.message);
    return s;
}

static void test_values_by_frame(void **state)
{
    (void)state;
    static const double radius[] = {0.1, 0.2, 0.3}, x[] = {1, 2, 3};
    static const uint64_t seed[] = {7, 9, 8};
    spec *s = parse_by_frame(
        BY_FRAME("{\"/surface/analytic/radius\":{\"from\":0.1,\"to\":0.3},"
                 "\"/surface/analytic/center\":[[1,0,0],[2,0,0],[3,0,0]],\"/solver/seed\":[7,9,8]}"));
    assert_true(s->has_frame_values && spec_check_frames(s, NULL, NULL));
    for (size_t i = 0; i < 3; i++) {
        spec *frame = spec_of_frame(s, i, NULL, NULL);
        assert_non_null(frame);
        assert_true(fabs(frame->surface.analytic.radius - radius[i]) < 1e-15);
        assert_true(frame->surface.analytic.center.x == x[i]);
        assert_int_equal(frame->seed, seed[i]);
        assert_int_equal(frame->frame_count, 1);
        assert_int_equal(frame->frame[0], 10 + 2 * i);
        /* its text is a spec that parses to the same spec */
        spec *again = spec_of_frame(frame, 0, NULL, NULL);
        char *text = json_print(frame->normalised), *same = json_print(again->normalised);
        assert_string_equal(text, same);
        free(text);
        free(same);
        spec_free(again);
        spec_free(frame);
    }
    assert_int_equal(s->seed, 7); /* the whole spec has the values of the first frame */
    spec_free(s);
    s = parse_by_frame(
        "{\"version\":1,\"surface\":{\"analytic\":{\"shape\":\"sphere\"}},\"sampling\":{\"count\":100},"
        "\"queue\":{\"frames\":\"1-2\",\"by_frame\":{\"/surface/analytic/radius\":[1,2]}}}");
    assert_true(s->surface.analytic.radius == 1); /* required, and given by frame */
    spec_free(s);
}

/* The pointer of a member with values by frame, and of its values. */
#define AT_RADIUS "/queue/by_frame/~1surface~1analytic~1radius"

static void test_faults_of_values_by_frame(void **state)
{
    (void)state;
    expect_fault(BY_FRAME("[]"), ERROR_SPEC_INVALID, "/queue/by_frame", "1 to 32 JSON Pointers");
    expect_fault(BY_FRAME("{}"), ERROR_SPEC_INVALID, "/queue/by_frame", "1 to 32 JSON Pointers");
    expect_fault(BY_FRAME("{\"/name\":[\"a\",\"b\",\"c\"]}"), ERROR_SPEC_INVALID, "/queue/by_frame/~1name",
                 "surface, region");
    expect_fault(BY_FRAME("{\"/surface/mesh/path\":[\"a\",\"b\",\"c\"]}"), ERROR_SPEC_INVALID,
                 "/queue/by_frame", "the path '/surface/mesh/path' is the same for all frames");
    expect_fault(BY_FRAME("{\"/surface/analytic/radius\":7}"), ERROR_SPEC_INVALID, AT_RADIUS,
                 "one value for each frame");
    expect_fault(BY_FRAME("{\"/surface/analytic/radius\":{\"from\":1}}"), ERROR_SPEC_INVALID, AT_RADIUS,
                 "\"to\": number");
    expect_fault(BY_FRAME("{\"/surface/analytic/radius\":[1,2]}"), ERROR_SPEC_INVALID, AT_RADIUS,
                 "2 values for 3 frames");
    expect_fault(BY_FRAME("{\"/surface\\/analytic/radius\":[1,{\"path\":\"a\"},2]}"), ERROR_SPEC_INVALID,
                 AT_RADIUS "/1", "must be a number");
    expect_fault(BY_FRAME("{\"/surface/analytic/radius\":[-1,1,1]}"), ERROR_SPEC_INVALID, AT_RADIUS "/0",
                 "frame 10: must be");
    expect_fault(BY_FRAME("{\"/surface/analytic/radius\":{\"from\":-1,\"to\":1}}"), ERROR_SPEC_INVALID,
                 AT_RADIUS, "frame 10: must be");
    expect_fault(BY_FRAME("{\"/solver/sed\":[1,2,3]}"), ERROR_SPEC_INVALID, "/queue/by_frame/~1solver~1sed/0",
                 "did you mean 'seed'");
    expect_fault(BY_FRAME("{\"/sampling/count/x\":[1,2,3]}"), ERROR_SPEC_INVALID,
                 "/queue/by_frame/~1sampling~1count~1x", "no object that could hold");
    expect_fault(
        SPHERE
        ",\"queue\":{\"frames\":\"1-10001\",\"by_frame\":{\"/solver/seed\":{\"from\":1,\"to\":10001}}}}",
        ERROR_SPEC_INVALID, "/queue/by_frame", "at most 10000 frames");
    expect_fault(SPHERE ",\"queue\":{\"by_frame\":{\"/solver/seed\":[1]}}}", ERROR_SPEC_INVALID,
                 "/queue/by_frame", "requires queue.frames");
}

/* Faults in objects that only values by frame make are at these values: no other place is in the spec. */
static void test_faults_of_objects_that_values_by_frame_add(void **state)
{
    (void)state;
#define WITH(surface, values)                                              \
    "{\"version\":1,\"surface\":" surface ",\"sampling\":{\"count\":100}," \
    "\"queue\":{\"frames\":\"10-14x2\",\"by_frame\":" values "}}"
    expect_fault(WITH("{}", "{\"/surface/analytic/radius\":[1,2,3]}"), ERROR_SPEC_INVALID, AT_RADIUS,
                 "/surface/analytic/shape: is required");
    expect_fault(WITH("{}", "{\"/surface/anlytic/radius\":[1,2,3]}"), ERROR_SPEC_INVALID,
                 "/queue/by_frame/~1surface~1anlytic~1radius", "/surface/anlytic: ");
    expect_fault(BY_FRAME("{\"/region/min\":[[0,0,0],[0,0,1],[0,0,2]]}"), ERROR_SPEC_INVALID,
                 "/queue/by_frame/~1region~1min", "/region/max: is required");
#undef WITH
}

/* For each member of the table. */
static void test_faults_of_values_by_frame_are_at_places_of_the_spec(void **state)
{
    static const char *const groups[] = {"/surface/", "/region/", "/sampling/", "/solver/", "/output/"};
    (void)state;
    size_t tried = 0;
    for (size_t i = 0; i < spec_row_count; i++) {
        bool good = false;
        for (size_t k = 0; k < sizeof groups / sizeof *groups; k++)
            good |= strncmp(spec_rows[i].pointer, groups[k], strlen(groups[k])) == 0;
        if (!good || strstr(spec_rows[i].pointer, "/path")) continue;
        json *document = json_new_object(), *by_frame;
        spec_faults faults = {0};
        error e = {0};
        json_put_integer(document, "version", 1);
        json_put(document, "surface", json_new_object());
        json_put(document, "queue", json_new_object());
        json_put_string(json_find(document, "/queue"), "frames", "1-2");
        json_put(json_find(document, "/queue"), "by_frame", by_frame = json_new_object());
        json *values = json_put_array(by_frame, spec_rows[i].pointer);
        for (int k = 0; k < 2; k++) json_append(values, json_new_number(k));
        spec_free(spec_parse(document, &faults, &e));
        for (size_t k = 0; k < faults.count; k++) {
            char *at = mem_strdup(faults.item[k].pointer);
            if (!json_find(document, at)) *strrchr(at, '/') = '\0'; /* of a missing member: its object */
            if (!json_find(document, at))
                fail_msg("%s: a fault at %s: %s", spec_rows[i].pointer, faults.item[k].pointer,
                         faults.item[k].detail);
            free(at);
        }
        tried++;
        json_free(document);
    }
    assert_true(tried > 100);
}

static void test_a_later_frame_is_checked(void **state)
{
    (void)state;
    error e = {0};
    spec_faults faults = {0};
    spec *s = parse_by_frame(BY_FRAME("{\"/surface/analytic/radius\":[1,2,-3]}"));
    assert_false(spec_check_frames(s, &faults, &e));
    assert_string_equal(faults.item[0].pointer, AT_RADIUS "/2");
    assert_non_null(strstr(e.message, "frame 14: must be"));
    spec_free(s);
    s = parse_by_frame(BY_FRAME("{\"/surface/analytic/shape\":[\"sphere\",\"sphere\",\"gyroid\"]}"));
    assert_false(spec_check_frames(s, &faults, &e)); /* a value by frame causes a fault of another member */
    assert_non_null(strstr(faults.item[0].detail, "frame 14: "));
    assert_null(strstr(faults.item[0].pointer, "/queue"));
    spec_free(s);
}

/* Members that exclude each other share memory of struct spec. The slices of a stack take 57 MB. A build with
 * sanitizers shows no blocks here, and finds leaks itself. */
static void test_surfaces_that_exclude_each_other_leave_no_memory(void **state)
{
    static const char text[] =
        "{\"version\":1,\"surface\":{\"exr\":{\"path\":\"a.####.exr\",\"slices\":\"1-65536\",\"isovalue\":1},"
        "\"labels\":{\"path\":\"b.####.exr\",\"slices\":\"1-65536\"}},\"sampling\":{\"count\":100}}";
    (void)state;
    size_t before = mallinfo2().uordblks + mallinfo2().hblkhd;
    expect_fault(text, ERROR_SPEC_INVALID, "/surface", "give exactly one of");
    size_t after = mallinfo2().uordblks + mallinfo2().hblkhd;
    assert_true(after < before + (1 << 16));
}

/* The names of 62 stacks of 65 536 slices with paths of 4 000 bytes would take 16 GB. */
static void test_stacks_of_a_spec_have_a_limit_together(void **state)
{
    static const struct {
        int stacks;
        const char *slices;
        int path_bytes;
        bool good;
    } cases[] = {{2, "1-32768", 10, true},
                 {2, "1-32769", 10, false},
                 {62, "1-65536", 4000, false},
                 {2, "1-9", 4000, true},
                 {2, "1-8192", 4000, false}};
    (void)state;
    for (size_t k = 0; k < sizeof cases / sizeof *cases; k++) {
        json *root = document(COMBINED("union")), *parts = json_find(root, "/surface/union");
        char *path = mem_printf("%0*d.####.exr", cases[k].path_bytes, 0);
        for (int n = 0; n < cases[k].stacks; n++) {
            json *stack = json_put_object(json_append_object(parts), "exr");
            json_put_string(stack, "path", path);
            json_put_string(stack, "slices", cases[k].slices);
            json_put_number(stack, "isovalue", 1);
        }
        spec_faults faults = {0};
        spec *s = spec_parse(root, &faults, NULL);
        assert_true(!!s == cases[k].good);
        if (!s) assert_non_null(strstr(faults.item[0].detail, "more than 65536 slices"));
        spec_free(s);
        free(path);
        json_free(root);
    }
}

/* Checks that spec_check_frames, which does not parse each frame, finds the same faults as parsing each
 * frame. */
static void expect_same_as_each(const char *surface, const char *rest, const char *by_frame)
{
    char *text = mem_printf("{\"version\":1,\"surface\":%s,%s,\"queue\":{\"frames\":\"1-3\",\"coherent\":%s,"
                            "\"by_frame\":{%s}}}",
                            surface, rest, strstr(rest, "coherent") ? "true" : "false", by_frame);
    error e = {0}, of_one = {0};
    spec_faults faults = {0}, of_frame = {0};
    spec *s = parse_by_frame(text);
    bool good = spec_check_frames(s, &faults, &e), each = true;
    for (size_t i = 1; each && i < s->frame_count; i++) {
        spec *frame = spec_of_frame(s, i, &of_frame, &of_one);
        each = frame != NULL;
        spec_free(frame);
    }
    if (good != each) fail_msg("%s: %s, but by itself %s", text, e.message, of_one.message);
    if (!good) assert_string_equal(e.message, of_one.message);
    if (!good) assert_string_equal(faults.item[0].pointer, of_frame.item[0].pointer);
    spec_free(s);
    free(text);
}

#define BALL_AT_0 "{\"analytic\":{\"shape\":\"sphere\",\"radius\":0.4}}"
#define CAPSULE "{\"analytic\":{\"shape\":\"capsule\",\"radius\":0.4,\"height\":1}}"
#define IDENTITY "[1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1]"

static void test_frames_are_checked_as_if_each_were_read(void **state)
{
    static const char count[] = "\"sampling\":{\"count\":100}",
                      coherent[] = "\"sampling\":{\"count\":100},\"name\":\"coherent\"",
                      region[] = "\"sampling\":{\"count\":100},\"region\":{\"inside\":" BALL_AT_0 "}",
                      box[] = "\"sampling\":{\"count\":100},\"region\":{\"min\":[0,0,0],\"max\":[1,1,1]}",
                      mesh[] = "{\"mesh\":{\"path\":\"a.ply\",\"features\":{\"angle\":1}}}",
                      labels[] = "{\"labels\":{\"path\":\"a.nrrd\",\"groups\":[[1,2]]}}",
                      stack[] = "{\"labels\":{\"path\":\"a.%04d.exr\",\"slices\":\"1-9\"}}",
                      spline[] = "{\"bspline\":{\"dims\":[4,4,4],\"path\":\"a.raw\"}}";
    static const struct {
        const char *surface, *rest, *by_frame;
    } cases[] = {
        {"{\"union\":[" BALL_AT_0 "," CAPSULE "]}", count, "\"/surface/union/1/analytic/radius\":[1,2,3]"},
        {"{\"union\":[" BALL_AT_0 "," CAPSULE "]}", count, "\"/surface/union/1/analytic/radius\":[1,2,-3]"},
        {"{\"union\":[" BALL_AT_0 "," CAPSULE "]}", count,
         "\"/surface/union/0/analytic/center\":[[1,2,3],[1,2,4],[1,2]]"},
        {"{\"union\":[" BALL_AT_0 "," CAPSULE "]}", count,
         "\"/surface/union/0/analytic/center\":[[1,2,3],[1,2,4],[1,2,5]],"
         "\"/surface/union/0/analytic/center/1\":[1,2,true]"},
        {CAPSULE, count, "\"/surface/analytic/shape\":[\"capsule\",\"cone\",\"cylinder\"]"},
        {CAPSULE, count, "\"/surface/analytic/shape\":[\"capsule\",\"cone\",\"sphere\"]"},
        {CAPSULE, count, "\"/surface/analytic/shape\":[\"capsule\",\"cone\",\"halfspace\"]"},
        {CAPSULE, count, "\"/surface/analytic/axis\":[[0,0,1],[0,0,0],[0,1,0]]"},
        {"{\"analytic\":{\"shape\":\"torus\",\"major_radius\":2,\"minor_radius\":1}}", count,
         "\"/surface/analytic/minor_radius\":{\"from\":1,\"to\":3}"},
        {"{\"transform\":{\"surface\":" BALL_AT_0 ",\"matrix\":" IDENTITY "}}", count,
         "\"/surface/transform/matrix\":[" IDENTITY "," IDENTITY ",[1,2,3]]"},
        {"{\"transform\":{\"surface\":{\"offset\":{\"surface\":" BALL_AT_0
         ",\"distance\":1}},\"matrix\":" IDENTITY "}}",
         count,
         "\"/surface/transform/surface/offset/distance\":[1,2,\"x\"],"
         "\"/surface/transform/surface/offset/surface/analytic/radius\":[1,2,3]"},
        {mesh, count, "\"/surface/mesh/features/angle\":[1,2,30]"},
        {mesh, count, "\"/surface/mesh/holes\":[\"keep\",\"fill\",\"kept\"]"},
        {labels, count, "\"/surface/labels/labels\":[[1,2],[3],[4.5]],\"/surface/labels/smooth\":[1,2,3]"},
        {labels, count, "\"/surface/labels/voxel_size\":[[1,1,1],[2,2,2],[3,3,3]]"},
        {stack, count,
         "\"/surface/labels/voxel_size\":[[1,1,1],[2,2,2],[3,3,3]],\"/surface/labels/channel\":[\"R\",\"G\",\"B\"]"},
        {spline, count, "\"/surface/bspline/dims\":[[4,4,4],[4,4,5],[4,4,3]]"},
        {BALL_AT_0, region, "\"/region/inside/analytic/radius\":[1,2,-1],\"/sampling/count\":[100,200,300]"},
        {BALL_AT_0, region, "\"/region/inside/analytic/radius\":[1,2,3],\"/sampling/count\":[100,200,3.5]"},
        {BALL_AT_0, box, "\"/region/max\":[[1,1,1],[1,1,2],[1,1,0]]"},
        {BALL_AT_0, coherent, "\"/solver/method\":[\"sized\",\"paper\",\"sized\"]"},
        {BALL_AT_0, coherent, "\"/solver/seed\":[1,2,3]"},
        {BALL_AT_0, count, "\"/sampling/curvature/ratio\":[1,2,3],\"/sampling/min_spacing\":[0.1,0.1,0.1]"},
        {BALL_AT_0, count, "\"/output/preview\":[true,false,7]"},
        {BALL_AT_0, count,
         "\"/output/preview/color\":[\"curvature\",\"curvature\",\"curvature\"],"
         "\"/output/preview/range\":[[1,2],[1,3],[1,1]]"},
        {BALL_AT_0, count,
         "\"/output/preview/color\":[\"curvature\",\"spacing\",\"shading\"],"
         "\"/output/preview/range\":[[1,2],[1,3],[1,4]]"},
    };
    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++)
        expect_same_as_each(cases[i].surface, cases[i].rest, cases[i].by_frame);
}

/* A stack of 65 536 images and 10 000 frames: parsing the whole spec for each frame would take minutes. */
static void test_the_last_of_many_frames_of_a_long_spec_is_checked(void **state)
{
    static const char text[] =
        "{\"version\":1,\"surface\":{\"union\":[{\"exr\":{\"path\":\"a.####.exr\",\"slices\":\"1-65536\",\"isovalue\":1}}," BALL_AT_0
        "]},\"sampling\":{\"count\":100},\"queue\":{\"frames\":\"1-10000\",\"by_frame\":{"
        "\"/surface/union/0/exr/isovalue\":{\"from\":1,\"to\":9},\"/solver/seed\":{\"from\":1,\"to\":10000},"
        "\"/surface/union/1/analytic/radius\":{\"from\":9999,\"to\":0}}}}";
    error e = {0};
    spec_faults faults = {0};
    (void)state;
    spec *s = parse_by_frame(text);
    assert_false(spec_check_frames(s, &faults, &e));
    assert_non_null(strstr(e.message, "frame 10000: must be"));
    assert_string_equal(faults.item[0].pointer, "/queue/by_frame/~1surface~1union~11~1analytic~1radius");
    spec_free(s);
}

/* Comparing all pairs, or access by index, would take minutes. */
static void test_long_lists_of_labels_are_read_in_one_walk(void **state)
{
    enum { COUNT = 50000 };
    (void)state;
    json *root = document(
        "{\"version\":1,\"surface\":{\"labels\":{\"path\":\"a.nrrd\"}},\"sampling\":{\"count\":100}}");
    json *groups = json_new_array(), *group = json_new_array(), *only = json_new_array();
    for (int i = 0; i < COUNT; i++) {
        json_append_number(group, i);
        json_append_number(only, i);
    }
    json_append(groups, group);
    put_at(root, "/surface/labels/groups", groups);
    put_at(root, "/surface/labels/labels", only);
    error e = {0};
    spec *s = spec_parse(root, NULL, &e);
    if (!s) fail_msg("%s", e.message);
    assert_int_equal(s->surface.labels.groups[0].count, COUNT);
    spec_free(s);
    json_append_number(group, 7);
    spec_faults faults;
    assert_null(spec_parse(root, &faults, NULL));
    assert_string_equal(faults.item[0].pointer, "/surface/labels/groups/0");
    json_free(root);
}

/* Rules and defaults of one group read members of another. Each spec has a fault in the other group. */
static void test_rules_between_groups_wait_for_groups_without_faults(void **state)
{
    static const char stack[] = "{\"path\":\"x\",\"slices\":\"1-3\",\"isovalue\":1}",
                      sphere[] = "{\"analytic\":{\"shape\":\"sphere\",\"radius\":1}}",
                      count[] = "\"sampling\":{\"count\":10}", frames[] = "\"queue\":{\"frames\":\"1-2\"}";
    const struct {
        char *surface, *rest;
        const char *pointer;
    } specs[] = {
        {mem_strdup(sphere), mem_printf("%s,%s,\"attributes\":[\"temperature\"]", count, frames),
         "/attributes/0"},
        {mem_strdup(sphere), mem_printf("%s,%s,\"attributes\":[{\"from\":7}]", count, frames),
         "/attributes/0/from"},
        {mem_printf("{\"exr\":%s}", stack), mem_printf("%s,%s", count, frames), "/surface/exr/path"},
        {mem_printf("{\"volume\":%s}", stack), mem_printf("%s,%s", count, frames), "/surface/volume/path"},
        {mem_strdup("{\"labels\":{\"path\":\"x\",\"slices\":\"1-3\"}}"), mem_printf("%s,%s", count, frames),
         "/surface/labels/path"},
        {mem_printf("{\"union\":[%s,{\"exr\":%s}]}", sphere, stack), mem_printf("%s,%s", count, frames),
         "/surface/union/1/exr/path"},
        {mem_strdup(sphere), mem_printf("%s,%s,\"region\":{\"inside\":{\"exr\":%s}}", count, frames, stack),
         "/region/inside/exr/path"},
        {mem_strdup("{\"mesh\":{}}"),
         mem_printf("%s,\"output\":{\"preview\":{\"camera\":{\"position\":[1,1,1]}}}", count),
         "/surface/mesh/path"},
        {mem_strdup("{\"offset\":7}"),
         mem_printf("%s,\"output\":{\"preview\":{\"camera\":{\"position\":[1,1,1],"
                    "\"target\":[0,0,0]}}}",
                    count),
         "/surface/offset"},
        {mem_strdup("{\"union\":7}"), mem_printf("%s,%s,\"region\":7", count, frames), "/surface/union"},
    };
    (void)state;
    for (size_t k = 0; k < sizeof specs / sizeof *specs; k++) {
        char *text = mem_printf("{\"version\":1,\"surface\":%s,%s}", specs[k].surface, specs[k].rest);
        expect_fault(text, ERROR_SPEC_INVALID, specs[k].pointer, "");
        free(text);
        free(specs[k].surface);
        free(specs[k].rest);
    }
}

static void test_faults_within_groups_are_noted_together(void **state)
{
    static const char text[] =
        "{\"version\":1,\"surface\":{\"analytic\":{\"shape\":\"torus\",\"major_radius\":1,\"minor_radius\":2}},"
        "\"sampling\":{\"count\":9,\"feature\":{},\"min_spacing\":2,\"max_spacing\":1},"
        "\"solver\":{\"step\":0.1},\"output\":{\"mesh_usda\":true,\"label_meshes\":true},"
        "\"queue\":{\"chunk\":2,\"coherent\":true}}";
    static const char *const places[] = {
        "/surface/analytic/minor_radius", "/sampling/max_spacing", "/solver/step",   "/output/mesh_usda",
        "/output/label_meshes",           "/queue/chunk",          "/queue/coherent"};
    (void)state;
    for (size_t k = 0; k < sizeof places / sizeof *places; k++)
        expect_fault(text, ERROR_SPEC_INVALID, places[k], "");
}

/* The members of the group and of all below it are in the order of the table. */
static void expect_order_of_table(json_at at, const char *group)
{
    const spec_row *last = NULL;
    for (json_at member = json_first(&at); member.node; member = json_next(&member)) {
        const spec_row *row = spec_row_find(group, member.key);
        if (!row || (last && row < last)) fail_msg("%s/%s is out of order", group, member.key);
        if (row->type == SPEC_TYPE_GROUP && json_type_of(member) == JSON_OBJECT)
            expect_order_of_table(member, row->pointer);
        last = row;
    }
}

static void test_members_of_groups_are_found_in_the_order_of_the_table(void **state)
{
    (void)state;
    for (size_t g = 0; g <= spec_row_count; g++) {
        const char *group = g < spec_row_count ? spec_rows[g].pointer : "";
        const size_t n = strlen(group);
        const spec_row *member = spec_row_first(group);
        for (size_t k = 0; k < spec_row_count; k++) {
            const char *pointer = spec_rows[k].pointer, *key = strrchr(pointer, '/') + 1;
            const bool belongs = key == pointer + n + 1 && strncmp(pointer, group, n) == 0;
            assert_ptr_equal(spec_row_key(&spec_rows[k]), key);
            assert_int_equal(spec_row_is_member(&spec_rows[k], group), belongs);
            if (!belongs) continue;
            assert_ptr_equal(member, &spec_rows[k]);
            assert_ptr_equal(spec_row_find(group, key), member);
            member = spec_row_next(member);
        }
        assert_null(member);
        if (g < spec_row_count) assert_ptr_equal(spec_row_first_below(&spec_rows[g]), spec_row_first(group));
    }
    assert_null(spec_row_first("/surfac"));
    assert_null(spec_row_find("/surface/vdb", "grids"));
    char copy[] = "/surface";
    assert_ptr_equal(spec_row_first(copy), spec_row_first("/surface"));
}

static void test_defaults_that_depend_on_others_are_in_their_places(void **state)
{
    static const char camera[] =
        ",\"output\":{\"preview\":{\"camera\":{\"fov\":1,\"position\":[1,1,1],\"target\":"
        "[0,0,0]}}},\"solver\":{\"minimiser\":\"gradient\"}}";
    static const char *const begin[] = {
        GRADED("\"curvature\":{\"ratio\":3}"), GRADED("\"alpha\":{}"),
        "{\"version\":1,\"surface\":{\"mesh\":{\"path\":\"a.stl\"}},\"sampling\":"
        "{\"count\":9}}"};
    (void)state;
    for (size_t k = 0; k < sizeof begin / sizeof *begin; k++) {
        char *text = mem_printf("%.*s%s", (int)strlen(begin[k]) - 1, begin[k], camera);
        spec *s = good(text);
        expect_order_of_table(json_root(s->normalised), "");
        assert_non_null(json_find(s->normalised, "/output/preview/camera/up"));
        assert_non_null(json_find(s->normalised, "/output/preview/color"));
        assert_non_null(json_find(s->normalised, "/solver/method"));
        assert_non_null(json_find(s->normalised, "/solver/step"));
        assert_true((k == 0) == !!json_find(s->normalised, "/sampling/curvature/exponent"));
        assert_true((k == 0) == !!json_find(s->normalised, "/sampling/gradation"));
        assert_true((k == 2) == !!json_find(s->normalised, "/surface/mesh/max_resolution"));
        spec_free(s);
        free(text);
    }
}

static void test_members_of_one_default_method_belong_to_all(void **state)
{
    (void)state;
    for (size_t i = 0; i < spec_row_count; i++) {
        const unsigned of_defaults = spec_rows[i].methods & SPEC_DEFAULT_METHODS;
        if (of_defaults && of_defaults != SPEC_DEFAULT_METHODS) fail_msg("%s", spec_rows[i].pointer);
    }
}

static void test_members_of_an_unknown_method_are_not_refused(void **state)
{
    error e = {0};
    (void)state;
    spec_faults faults =
        bad(SPHERE ",\"solver\":{\"method\":\"witkin\",\"witkin_heckbert\":{},\"energy\":\"gaussian\"}}", &e);
    assert_int_equal(faults.count, 1);
    assert_string_equal(faults.item[0].pointer, "/solver/method");
}

static void test_lengths(void **state)
{
    (void)state;
    for (int over = 0; over <= 1; over++) {
        char name[2 * 201 + 1] = "";
        for (int i = 0; i < 200 + over; i++) strcat(name, "\xc3\xa4"); /* characters count, not bytes */
        char *text = mem_printf(SPHERE ",\"name\":\"%s\"}", name);
        json *root = document(text);
        spec *s = spec_parse(root, NULL, NULL);
        assert_int_equal(s != NULL, !over);
        spec_free(s);
        json_free(root);
        free(text);
        json *labels = json_new_array();
        for (int i = 0; i < 32 + over; i++) json_append_string(labels, "label");
        root = document(SPHERE "}");
        put_at(root, "/queue/labels", labels);
        s = spec_parse(root, NULL, NULL);
        assert_int_equal(s != NULL, !over);
        spec_free(s);
        json_free(root);
    }
}

static void test_each_member_has_a_rank_and_its_group_is_as_basic(void **state)
{
    (void)state;
    size_t basic = 0;
    for (size_t i = 0; i < spec_row_count; i++) {
        const spec_row *group = &spec_rows[i];
        assert_in_range(group->rank, OPTION_BASIC, OPTION_RESEARCH);
        basic += group->rank == OPTION_BASIC;
        for (const spec_row *row = spec_row_first_below(group); row; row = spec_row_next(row))
            if (row->rank < group->rank) fail_msg("%s is more basic than its group", row->pointer);
    }
    assert_in_range(basic, 25, 35);
}

static void test_help_names_basic_members_and_all_on_request(void **state)
{
    (void)state;
    char *text = NULL;
    size_t size = 0, printed[2] = {0}, basic = 0;
    for (int all = 0; all <= 1; all++) {
        FILE *file = open_memstream(&text, &size);
        printed[all] = spec_print_help(file, all ? SPEC_HELP_ALL : NULL);
        fclose(file);
        const char *last = text;
        for (size_t i = 0; i < spec_row_count; i++) {
            char *head = mem_printf("%s (", spec_rows[i].pointer), *line = mem_printf("\n%s", head);
            const char *at = strncmp(text, head, strlen(head)) == 0 ? text : strstr(text, line);
            const bool is_basic = spec_rows[i].rank == OPTION_BASIC;
            if ((at != NULL) != (all || is_basic)) fail_msg("%s: %s", spec_rows[i].pointer, at ? at : "none");
            if (is_basic && at > last) last = at;
            basic += all && is_basic;
            free(head);
            free(line);
        }
        const char *further = strstr(text, ", advanced)");
        assert_true(all ? further > last : !further); /* behind the last basic member */
        for (char *line = strtok(text, "\n"); line; line = strtok(NULL, "\n"))
            if (*line == ' ' && strlen(line) > HELP_TEXT_COLUMNS) fail_msg("too long: %s", line);
        free(text);
    }
    assert_int_equal(printed[0], basic);
    assert_int_equal(printed[1], spec_row_count);
}

/* The help of a member as text, which the caller frees; `rows` is the number of its paragraphs. */
static char *help_of(const char *member, size_t *rows)
{
    char *text = NULL;
    size_t size = 0, empty = 0;
    FILE *file = open_memstream(&text, &size);
    *rows = spec_print_help(file, member);
    fclose(file);
    for (const char *at = text; (at = strstr(at, "\n\n")); at++) empty++;
    assert_int_equal(*rows, empty);
    return text;
}

static void test_help_of_one_member_has_it_and_its_members(void **state)
{
    (void)state;
    size_t rows;
    char *text = help_of("/sampling/count", &rows);
    assert_int_equal(rows, 1);
    assert_int_equal(strncmp(text, "/sampling/count (", 17), 0);
    free(text);
    text = help_of("/sampling", &rows);
    assert_true(rows > 5 && strstr(text, "\n/sampling/count (") && !strstr(text, "\n/solver"));
    free(text);
    text = help_of("count", &rows);
    assert_true(strstr(text, "/sampling/count (") && !strstr(text, "/sampling/curve"));
    free(text);
    text = help_of("/count", &rows); /* a pointer is relative to the root of the spec */
    assert_true(rows == 0 && !*text);
    free(text);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_bounds_of_every_row),
        cmocka_unit_test(test_titles_are_short_and_differ_within_a_group),
        cmocka_unit_test(test_types_of_every_row),
        cmocka_unit_test(test_defaults_and_presence),
        cmocka_unit_test(test_words_of_every_row),
        cmocka_unit_test(test_attributes),
        cmocka_unit_test(test_frames),
        cmocka_unit_test(test_accepted_outcomes),
        cmocka_unit_test(test_values_by_frame),
        cmocka_unit_test(test_faults_of_values_by_frame),
        cmocka_unit_test(test_faults_of_objects_that_values_by_frame_add),
        cmocka_unit_test(test_faults_of_values_by_frame_are_at_places_of_the_spec),
        cmocka_unit_test(test_a_later_frame_is_checked),
        cmocka_unit_test(test_chunks),
        cmocka_unit_test(test_coherent_sequences),
        cmocka_unit_test(test_unknown_member_in_every_group),
        cmocka_unit_test(labels_are_neither_cut_nor_combined),
        cmocka_unit_test(test_fields),
        cmocka_unit_test(test_region),
        cmocka_unit_test(test_bspline),
        cmocka_unit_test(test_many_coefficients),
        cmocka_unit_test(test_preview_switch),
        cmocka_unit_test(test_normalised_is_idempotent),
        cmocka_unit_test(test_mesh),
        cmocka_unit_test(test_inputs),
        cmocka_unit_test(test_slices),
        cmocka_unit_test(test_surfaces_of_surfaces),
        cmocka_unit_test(test_faults),
        cmocka_unit_test(test_all_faults_are_collected),
        cmocka_unit_test(test_surfaces_that_exclude_each_other_leave_no_memory),
        cmocka_unit_test(test_stacks_of_a_spec_have_a_limit_together),
        cmocka_unit_test(test_frames_are_checked_as_if_each_were_read),
        cmocka_unit_test(test_the_last_of_many_frames_of_a_long_spec_is_checked),
        cmocka_unit_test(test_long_lists_of_labels_are_read_in_one_walk),
        cmocka_unit_test(test_rules_between_groups_wait_for_groups_without_faults),
        cmocka_unit_test(test_faults_within_groups_are_noted_together),
        cmocka_unit_test(test_members_of_groups_are_found_in_the_order_of_the_table),
        cmocka_unit_test(test_defaults_that_depend_on_others_are_in_their_places),
        cmocka_unit_test(test_members_of_one_default_method_belong_to_all),
        cmocka_unit_test(test_members_of_an_unknown_method_are_not_refused),
        cmocka_unit_test(test_lengths),
        cmocka_unit_test(test_each_member_has_a_rank_and_its_group_is_as_basic),
        cmocka_unit_test(test_help_names_basic_members_and_all_on_request),
        cmocka_unit_test(test_help_of_one_member_has_it_and_its_members),
    };
    return cmocka_run_group_tests_name("spec", tests, NULL, NULL);
}
