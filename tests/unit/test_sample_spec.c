// SPDX-License-Identifier: Apache-2.0
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "spec/sample_spec.h"

static json *parse(const char *text)
{
    json *document = json_parse(text, strlen(text), NULL);
    assert_non_null(document);
    return document;
}

/* The spec of an inspection and options as text, which the caller frees; NULL: an error. */
static char *make(const char *inspection, const char *path, const sample_options *options, error *e)
{
    json *found = parse(inspection), *document = sample_spec_make(found, path, options, e);
    char *text = document ? json_print(document) : NULL;
    json_free(document);
    json_free(found);
    return text;
}

static void expect(const char *inspection, const sample_options *options, const char *expected)
{
    error e = {0};
    char *text = make(inspection, "a/b.obj", options, &e);
    assert_non_null(text);
    assert_string_equal(text, expected);
    free(text);
}

#define MESH "{\"version\":1,\"surface\":{\"mesh\":{\"path\":\"x\"}},\"sampling\":{\"count\":700}}"
#define ONE "{\"suggestions\":[{\"measured\":true,\"spec\":" MESH "}]}"
#define HEAD "{\"version\":1,\"name\":\"b\",\"surface\":{\"mesh\":{\"path\":\"x\"}},"

static void a_measured_surface_comes_first(void **state)
{
    (void)state;
    const sample_options none = {0};
    expect(ONE, &none, HEAD "\"sampling\":{\"count\":700}}");
    expect(
        "{\"suggestions\":[{\"error\":{}},{\"measured\":false,\"spec\":{\"surface\":1,\"sampling\":{\"count\":5}}},"
        "{\"measured\":true,\"spec\":" MESH "}]}",
        &none, HEAD "\"sampling\":{\"count\":700}}");
    expect("{\"suggestions\":[{\"measured\":false,\"spec\":" MESH "},{\"error\":{}}]}", &none,
           HEAD "\"sampling\":{\"count\":700}}");
}

static void a_target_replaces_the_suggested_count(void **state)
{
    (void)state;
    static const char *const density[] = {"/sampling/density=3"}, *const other[] = {"/solver/seed=3"};
    expect(ONE, &(sample_options){.count = "50"}, HEAD "\"sampling\":{\"count\":50}}");
    expect(ONE, &(sample_options){.spacing = "0.5"}, HEAD "\"sampling\":{\"spacing\":0.5}}");
    expect(ONE, &(sample_options){.set = density, .set_count = 1}, HEAD "\"sampling\":{\"density\":3}}");
    expect(ONE, &(sample_options){.set = other, .set_count = 1},
           HEAD "\"sampling\":{\"count\":700},\"solver\":{\"seed\":3}}");
    expect(ONE, &(sample_options){.grade = "curvature=2.5", .pattern = "blue_noise"},
           HEAD "\"sampling\":{\"curvature\":{\"ratio\":2.5},\"pattern\":\"blue_noise\",\"count\":700}}");
    expect(ONE, &(sample_options){.grade = "curvature"},
           HEAD "\"sampling\":{\"curvature\":{\"ratio\":4},\"count\":700}}");
}

static void a_mesh_needs_no_inspection(void **state)
{
    (void)state;
    static const char *const density[] = {"/sampling/density=3"}, *const other[] = {"/solver/seed=3"};
    json *whole = sample_spec_unseen("mesh", "x");
    char *text = json_print(whole);
    expect(text, &(sample_options){.count = "50"}, HEAD "\"sampling\":{\"count\":50}}");
    expect(text, &(sample_options){0}, HEAD "\"sampling\":{\"count\":100000}}");
    free(text);
    json_free(whole);
    assert_true(sample_spec_has_target(&(sample_options){.count = "50"}));
    assert_true(sample_spec_has_target(&(sample_options){.spacing = "0.5"}));
    assert_true(sample_spec_has_target(&(sample_options){.set = density, .set_count = 1}));
    assert_false(sample_spec_has_target(&(sample_options){.set = other, .set_count = 1}));
    assert_false(sample_spec_has_target(&(sample_options){.grade = "curvature"}));
    assert_false(sample_spec_has_target(&(sample_options){.count = "many"}));
}

static void values_are_json_or_texts(void **state)
{
    (void)state;
    static const struct {
        const char *assignment, *expected;
    } rows[] = {
        {"/a=1", "{\"a\":1}"},
        {"/a=true", "{\"a\":true}"},
        {"/a=[1,\"b\"]", "{\"a\":[1,\"b\"]}"},
        {"/a=word", "{\"a\":\"word\"}"},
        {"/a=\"1\"", "{\"a\":\"1\"}"},
        {"/a=", "{\"a\":\"\"}"},
        {"/a=b=c", "{\"a\":\"b=c\"}"},
        {"/a/b~1c/d=null", "{\"a\":{\"b/c\":{\"d\":null}}}"},
    };
    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
        error e = {0};
        json *document = json_new_object();
        assert_true(sample_spec_set(document, rows[i].assignment, &e));
        char *text = json_print(document);
        assert_string_equal(text, rows[i].expected);
        free(text);
        json_free(document);
    }
    static const char *const refused[] = {"a=1", "/a", "/=1", "", "=", "/old/a=1", "/list/7=1"};
    for (size_t i = 0; i < sizeof refused / sizeof *refused; i++) {
        error e = {0};
        json *document = parse("{\"old\":5,\"list\":[1]}");
        assert_false(sample_spec_set(document, refused[i], &e));
        assert_int_equal(e.code, ERROR_SPEC_INVALID);
        json_free(document);
    }
}

static void a_suggested_assignment_names_no_member_of_an_array(void **state)
{
    (void)state;
    static const struct {
        const char *assignment, *words;
    } rows[] = {
        {"name=foo", "--set name=foo: must be /MEMBER=VALUE, such as /name=foo or "
                     "/sampling/grid/name=foo"},
        {"type=double", "--set type=double: must be /MEMBER=VALUE, such as /sampling/count=5000"},
        {"method=sized", "--set method=sized: must be /MEMBER=VALUE, such as /solver/method=sized"},
    };
    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
        error e = {0};
        json *document = json_new_object();
        assert_false(sample_spec_set(document, rows[i].assignment, &e));
        assert_string_equal(e.message, rows[i].words);
        json_free(document);
    }
}

static void malformed_options_are_refused(void **state)
{
    (void)state;
    static const char *const bad[] = {"x"};
    const sample_options rows[] = {
        {.count = "5k"},
        {.count = ""},
        {.count = "[5]"},
        {.spacing = "small"},
        {.count = "5", .spacing = "1"},
        {.grade = "curvatures"},
        {.grade = "curvature="},
        {.grade = "size"},
        {.set = bad, .set_count = 1},
    };
    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
        error e = {0}, again = {0};
        assert_null(make(ONE, "b.obj", &rows[i], &e));
        assert_int_equal(e.code, ERROR_SPEC_INVALID);
        assert_false(sample_spec_check(&rows[i], &again));
        assert_string_equal(e.message, again.message);
    }
    assert_true(sample_spec_check(&(sample_options){.count = "5", .grade = "curvature=3"}, NULL));
}

static void the_error_of_the_first_surface_is_returned(void **state)
{
    (void)state;
    error e = {0};
    const sample_options none = {0};
    assert_null(make("{\"suggestions\":[{\"error\":{\"code\":\"limit_memory\",\"message\":\"too large\"}}]}",
                     "b", &none, &e));
    assert_int_equal(e.code, ERROR_LIMIT_MEMORY);
    assert_string_equal(e.message, "b: too large");
    assert_null(make("{\"suggestions\":[]}", "b", &none, &e));
    assert_int_equal(e.code, ERROR_NO_SURFACE);
}

static void a_vdb_file_without_a_surface_is_explained_by_its_grids(void **state)
{
    (void)state;
    static const struct {
        const char *grids, *words;
    } rows[] = {
        {"", "the file has no grid"},
        {"{\"name\":\"d\",\"type\":\"float\",\"scalar\":true,\"active_voxels\":0},"
         "{\"name\":\"s\",\"type\":\"float\",\"scalar\":true,\"active_voxels\":0},"
         "{\"name\":\"v\",\"type\":\"vec3s\",\"scalar\":false}",
         "the grids \"d\", \"s\" have no active voxels: choose another frame"},
        {"{\"name\":\"d\",\"type\":\"float\",\"scalar\":true,\"active_voxels\":8}",
         "the grid \"d\" has no isovalue with a surface: choose another frame"},
        {"{\"name\":\"v\",\"type\":\"vec3s\",\"scalar\":false}", "the file has only the grid \"v\" (vec3s)"},
        {"{\"name\":\"p\",\"type\":\"ptdataidx32\",\"scalar\":false}",
         "the grid \"p\" (ptdataidx32) has points"},
        {"{\"name\":\"d\",\"type\":\"float\",\"scalar\":true,\"error\":{\"message\":\"it ends early\"}}",
         "a grid cannot be read: it ends early"},
    };
    const sample_options none = {0};
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        error e = {0};
        char inspection[512];
        snprintf(inspection, sizeof inspection, "{\"suggestions\":[],\"grids\":[%s]}", rows[i].grids);
        assert_null(make(inspection, "b.vdb", &none, &e));
        assert_int_equal(e.code, ERROR_NO_SURFACE);
        assert_non_null(strstr(e.message, rows[i].words));
        assert_null(strstr(e.message, "An image of a stack"));
    }
}

static void a_vdb_file_with_an_isovalue_needs_no_inspection(void **state)
{
    (void)state;
    static const char *const isovalue[] = {"/surface/vdb/isovalue=0.3"};
    const sample_options whole = {.count = "50", .set = isovalue, .set_count = 1}, part = {.count = "50"};
    assert_false(sample_spec_needs_inspection("vdb", &whole));
    assert_true(sample_spec_needs_inspection("vdb", &part));
    assert_true(sample_spec_needs_inspection("volume", &whole));
    assert_false(sample_spec_needs_inspection("mesh", &part));
}

static void the_spec_of_frames_has_the_pattern(void **state)
{
    (void)state;
    static const char *const members[] = {"mesh", "vdb", "volume", "labels", "exr"};
    for (size_t i = 0; i < sizeof members / sizeof *members; i++) {
        error e = {0};
        char inspection[200], expected[200];
        snprintf(
            inspection, sizeof inspection,
            "{\"suggestions\":[{\"measured\":true,\"spec\":{\"surface\":{\"%s\":{\"path\":\"a.0007.x\"}},"
            "\"sampling\":{\"count\":7}}}]}",
            members[i]);
        snprintf(expected, sizeof expected, "\"surface\":{\"%s\":{\"path\":\"a.####.x\"}}", members[i]);
        char *text = make(inspection, "a.####.x", &(sample_options){.frames = "7-8"}, &e);
        assert_non_null(text);
        assert_non_null(strstr(text, expected));
        free(text);
    }
}

static void stems_and_endings(void **state)
{
    (void)state;
    static const struct {
        const char *path, *stem, *ending;
    } rows[] = {
        {"a.obj", "a", ".obj"},
        {"/x.y/a.b.stl", "a.b", ".stl"},
        {"brain.nii.gz", "brain", ".nii.gz"},
        {"a.gz", "a", ".gz"},
        {"x.y/mesh", "mesh", ""},
        {".hidden", ".hidden", ""},
        {"scan.zarr/", "scan", ".zarr/"},
        {"anim/spot.####.obj", "spot", ".obj"},
        {"a_%04d.nii.gz", "a", ".nii.gz"},
        {"####.obj", "####", ".obj"},
        {"/", "/", ""},
    };
    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
        char *stem = sample_spec_stem(rows[i].path);
        assert_string_equal(stem, rows[i].stem);
        if (rows[i].path[strlen(rows[i].path) - 1] != '/')
            assert_string_equal(sample_spec_ending(rows[i].path), rows[i].ending);
        free(stem);
    }
}

static void a_name_that_is_too_long_is_left_out(void **state)
{
    (void)state;
    error e = {0};
    const sample_options none = {0};
    char path[300];
    memset(path, 'a', sizeof path);
    path[sizeof path - 1] = '\0';
    char *text = make(ONE, path, &none, &e);
    assert_non_null(text);
    assert_null(strstr(text, "name"));
    free(text);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_measured_surface_comes_first),
        cmocka_unit_test(a_target_replaces_the_suggested_count),
        cmocka_unit_test(a_mesh_needs_no_inspection),
        cmocka_unit_test(values_are_json_or_texts),
        cmocka_unit_test(a_suggested_assignment_names_no_member_of_an_array),
        cmocka_unit_test(malformed_options_are_refused),
        cmocka_unit_test(the_error_of_the_first_surface_is_returned),
        cmocka_unit_test(a_vdb_file_without_a_surface_is_explained_by_its_grids),
        cmocka_unit_test(a_vdb_file_with_an_isovalue_needs_no_inspection),
        cmocka_unit_test(the_spec_of_frames_has_the_pattern),
        cmocka_unit_test(stems_and_endings),
        cmocka_unit_test(a_name_that_is_too_long_is_left_out),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
