// SPDX-License-Identifier: Apache-2.0
/* ply: round trips, truncations, hostile headers. */
#include <float.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "io/points/ply.h"
#include "point_set.h"

typedef struct bytes {
    char *data;
    size_t length;
} bytes;

/* All columns that a set has. */
static columns all_of(const points *set)
{
    static const char *const all[] = {"all"};
    columns what;
    error e = {0};
    if (!columns_choose(set, all, 1, &what, &e)) fail_msg("%s", e.message);
    return what;
}

static bool write_alone(FILE *file, const points *set, ply_format format, ply_precision precision, error *e)
{
    const columns what = all_of(set);
    threads *pool = threads_new(1, NULL, e);
    bool good = pool && ply_write(file, set, &what, format, precision, NULL, pool, e);
    threads_free(pool);
    return good;
}

static bytes write_columns(const points *set, const columns *what, ply_format format, ply_precision precision)
{
    bytes b = {NULL, 0};
    error e = {0};
    FILE *file = open_memstream(&b.data, &b.length);
    threads *pool = threads_new(3, NULL, &e);
    if (!pool || !ply_write(file, set, what, format, precision, NULL, pool, &e)) fail_msg("%s", e.message);
    threads_free(pool);
    fclose(file);
    return b;
}

static bytes write_set(const points *set, ply_format format, ply_precision precision)
{
    const columns what = all_of(set);
    return write_columns(set, &what, format, precision);
}

static bool read_bytes(const char *data, size_t length, ply_file *out, error *e)
{
    char *copy = mem_alloc(length); /* exactly this length, so that a sanitizer detects an overrun */
    memcpy(copy, data, length);
    FILE *file = fmemopen(copy, length ? length : 1, "rb");
    if (!length) fgetc(file);
    bool good = ply_read(file, out, e);
    fclose(file);
    free(copy);
    return good;
}

static void refuse(const char *data, size_t length, const char *words)
{
    error e = {0};
    ply_file f = {0};
    if (read_bytes(data, length, &f, &e)) fail_msg("accepted: %.400s", data);
    if (!strstr(e.message, words)) fail_msg("'%s' does not say '%s'", e.message, words);
    assert_null(f.storage);
}

static void check_equal(const points *a, const points *b, bool single)
{
    const double *x[9] = {&a->position->x, &a->normal->x, a->kappa,   a->kappa1,       a->kappa2,
                          a->alpha,        a->energy,     a->spacing, a->spacing_local};
    const double *y[9] = {&b->position->x, &b->normal->x, b->kappa,   b->kappa1,       b->kappa2,
                          b->alpha,        b->energy,     b->spacing, b->spacing_local};
    assert_int_equal(a->count, b->count);
    for (int k = 0; k < 9; k++)
        for (size_t i = 0; i < a->count * (k < 2 ? 3 : 1); i++)
            if ((single ? (double)(float)x[k][i] : x[k][i]) != y[k][i])
                fail_msg("array %d element %zu: %.17g became %.17g", k, i, x[k][i], y[k][i]);
}

static point_set awkward(void)
{
    point_set s = point_set_sphere(10007, vec3_make(0.1, -2e6, 1e-9), 1.0 / 3);
    s.position[0] = vec3_make(-0.0, 1e-30, 12345678.9);
    s.scalar[0][1] = 3e38;
    s.scalar[1][1] = FLT_MIN / 4; /* a denormal */
    s.scalar[2][1] = -1.0 / 3;
    s.scalar[3][1] = 1e22;
    return s;
}

static void test_round_trips(void **state)
{
    (void)state;
    point_set s = awkward();
    for (int format = PLY_BINARY_LITTLE_ENDIAN; format <= PLY_ASCII; format++) {
        for (int precision = PLY_FLOAT; precision <= PLY_DOUBLE; precision++) {
            error e = {0};
            ply_file f = {0};
            bytes b = write_set(&s.points, format, precision),
                  again = write_set(&s.points, format, precision);
            assert_int_equal(b.length, again.length);
            assert_memory_equal(b.data, again.data, b.length);
            if (!read_bytes(b.data, b.length, &f, &e)) fail_msg("%s", e.message);
            assert_int_equal(f.format, format);
            assert_int_equal(f.precision, precision);
            check_equal(&s.points, &f.points, precision == PLY_FLOAT);
            ply_file_free(&f);
            free(b.data);
            free(again.data);
        }
    }
    point_set_free(&s);
    ply_file_free(NULL);
}

static void test_header(void **state)
{
    (void)state;
    point_set s = point_set_sphere(1, vec3_make(0, 0, 0), 1);
    bytes b = write_set(&s.points, PLY_ASCII, PLY_FLOAT);
    static const char expected[] = "ply\nformat ascii 1.0\ncomment hexad\nelement vertex "
                                   "1\nproperty float x\nproperty float y\n"
                                   "property float z\nproperty float nx\nproperty float "
                                   "ny\nproperty float nz\nproperty float kappa\n"
                                   "property float kappa1\nproperty float kappa2\nproperty float "
                                   "alpha\nproperty float energy\n"
                                   "property float spacing\nproperty float "
                                   "spacing_local\nend_header\n1 0 0 1 0 0 1.4142135 1 1 1 0.71 ";
    assert_true(strncmp(b.data, expected, sizeof expected - 1) == 0);
    free(b.data);
    point_set_free(&s);
}

static void test_every_truncation_is_refused(void **state)
{
    (void)state;
    point_set s = point_set_sphere(3, vec3_make(1, 2, 3), 1);
    for (int format = PLY_BINARY_LITTLE_ENDIAN; format <= PLY_ASCII; format++) {
        for (int precision = PLY_FLOAT; precision <= PLY_DOUBLE; precision++) {
            bytes b = write_set(&s.points, format, precision);
            for (size_t n = 0; n < b.length; n++) refuse(b.data, n, "");
            char *longer = mem_alloc(b.length + 1);
            memcpy(longer, b.data, b.length);
            longer[b.length] = '\n';
            refuse(longer, b.length + 1,
                   format == PLY_ASCII ? "after its last point" : "do not match the 3 points");
            free(longer);
            free(b.data);
        }
    }
    point_set_free(&s);
}

/* Checks that the header with one part replaced is refused. */
static void refuse_with(const bytes *b, const char *from, const char *to, const char *words)
{
    char *where = memmem(b->data, b->length, from, strlen(from));
    assert_non_null(where);
    size_t before = (size_t)(where - b->data), after = b->length - before - strlen(from);
    size_t length = before + strlen(to) + after;
    char *data = mem_alloc(length);
    memcpy(data, b->data, before);
    memcpy(data + before, to, strlen(to));
    memcpy(data + before + strlen(to), where + strlen(from), after);
    refuse(data, length, words);
    free(data);
}

static void test_hostile_headers(void **state)
{
    (void)state;
    point_set s = point_set_sphere(3, vec3_make(1, 2, 3), 1);
    for (int format = PLY_BINARY_LITTLE_ENDIAN; format <= PLY_ASCII; format++) {
        bytes b = write_set(&s.points, format, PLY_FLOAT);
        refuse_with(&b, "vertex 3", "vertex 1000000000000", "do not match the 1000000000000 points");
        refuse_with(&b, "vertex 3", "vertex 99999999999999999999999", "do not match the");
        refuse_with(&b, "vertex 3", "vertex 18446744073709551615", "do not match the");
        refuse_with(&b, "vertex 3", "vertex -1", "the line 'element vertex -1'");
        refuse_with(&b, "vertex 3", "vertex ", "the line 'element vertex '");
        refuse_with(&b, "vertex 3", "vertex 2",
                    format == PLY_ASCII ? "after its last point" : "do not match");
        refuse_with(&b, "vertex 3", "vertex 4", format == PLY_ASCII ? "" : "do not match");
        refuse_with(&b, "float y", "float Y", "expected 'property float y'");
        refuse_with(&b, "float kappa1", "float kappa", "the line 'property float kappa'");
        refuse_with(&b, "float kappa1", "double kappa1", "no property 'double kappa1'");
        refuse_with(&b, "float kappa1", "float kappa 1", "the line 'property float kappa 1'");
        refuse_with(&b, "float kappa1", "uchar kappa1", "no property 'uchar kappa1'");
        refuse_with(&b, "vertex 3", "vertex 3\nelement face 0", "more than points");
        refuse_with(&b, "vertex 3", "vertex 3\nend_header", "expected 'property float x'");
        refuse_with(&b, "float kappa1", "list uchar float kappa1", "no property 'float kappa1'");
        refuse_with(&b, "ply\n", "plx\n", "the line 'plx'");
        refuse_with(&b, "1.0\n", "1.0 1\n", "the line 'format");
        free(b.data);
    }
    bytes b = write_set(&s.points, PLY_ASCII, PLY_FLOAT);
    refuse_with(&b, "0.71", "nan", "13 numbers");
    refuse_with(&b, "0.71", "1e99", "energy = inf");
    refuse_with(&b, "0.71", "0x1", "13 numbers");
    refuse_with(&b, "0.71 ", "0.71  ", "13 numbers");
    refuse_with(&b, "0.71 ", "", "point 0: PLY file: a line is not 13 numbers");
    refuse_with(&b, "0.71", "1 2", "13 numbers");
    free(b.data);
    point_set_free(&s);
}

static void test_values_that_cannot_be_written(void **state)
{
    (void)state;
    static const double values[] = {NAN, INFINITY, 1e39};
    point_set s = point_set_sphere(5000, vec3_make(0, 0, 0), 1);
    for (int k = 0; k < 3; k++) {
        error e = {0};
        char *data = NULL;
        size_t length = 0;
        FILE *file = open_memstream(&data, &length);
        s.normal[4999].y = values[k];
        assert_false(write_alone(file, &s.points, PLY_BINARY_LITTLE_ENDIAN, PLY_FLOAT, &e));
        assert_non_null(strstr(e.message, "point 4999 has ny = "));
        fclose(file);
        free(data);
    }
    bytes b = write_set(&s.points, PLY_BINARY_LITTLE_ENDIAN, PLY_DOUBLE); /* 1e39 is a valid double */
    double bad = NAN;
    memcpy(b.data + b.length - 8, &bad, 8);
    refuse(b.data, b.length, "point 4999 has spacing_local = ");
    free(b.data);
    point_set_free(&s);
}

/* More points than are written at a time, by one thread and by three. */
static void test_bytes_do_not_depend_on_threads(void **state)
{
    (void)state;
    point_set s = point_set_sphere(70001, vec3_make(1, 2, 3), 1);
    bytes b = write_set(&s.points, PLY_BINARY_LITTLE_ENDIAN, PLY_FLOAT), alone = {NULL, 0};
    FILE *file = open_memstream(&alone.data, &alone.length);
    assert_true(write_alone(file, &s.points, PLY_BINARY_LITTLE_ENDIAN, PLY_FLOAT, NULL));
    fclose(file);
    assert_int_equal(b.length, alone.length);
    assert_memory_equal(b.data, alone.data, b.length);
    free(alone.data);
    free(b.data);
    point_set_free(&s);
}

static void test_full_disk(void **state)
{
    (void)state;
    error e = {0};
    point_set s = point_set_sphere(5000, vec3_make(0, 0, 0), 1);
    FILE *file = fopen("/dev/full", "wb");
    if (file) {
        assert_false(write_alone(file, &s.points, PLY_ASCII, PLY_FLOAT, &e));
        assert_int_equal(e.code, ERROR_STORAGE_FULL);
        fclose(file);
    }
    point_set_free(&s);
}

static void test_ids_and_velocities(void **state)
{
    (void)state;
    /* a float does not represent the second one */
    static const uint32_t id[3] = {7, 16777217, UINT32_MAX - 1};
    static const vec3 velocity[3] = {{0, 0.5, -1}, {1e-3, 0, 0}, {-0.25, 2, 3}};
    static const double kappa_scale[3] = {0, 0.25, 3}; /* an optional member of a set */
    for (int format = 0; format <= 1; format++)
        for (int kind = 0; kind <= 3; kind++) {
            int precision = kind % 2;
            bool has_scale = kind / 2;
            const char *line = has_scale ? "a line is not 18 numbers" : "a line is not 17 numbers";
            point_set s = point_set_sphere(3, vec3_make(0, 0, 0), 1);
            s.points.kappa_scale = has_scale ? kappa_scale : NULL;
            s.points.id = id;
            s.points.velocity = velocity;
            bytes b = write_set(&s.points, (ply_format)format, (ply_precision)precision);
            error e = {0};
            ply_file f = {0};
            assert_non_null(strstr(b.data, "property uint id\n"));
            if (!read_bytes(b.data, b.length, &f, &e)) fail_msg("%s", e.message);
            check_equal(&s.points, &f.points, precision == PLY_FLOAT);
            assert_memory_equal(f.points.id, id, sizeof id);
            assert_int_equal(f.points.kappa_scale != NULL, has_scale);
            if (has_scale) assert_memory_equal(f.points.kappa_scale, kappa_scale, sizeof kappa_scale);
            for (int i = 0; i < 3; i++)
                assert_true(f.points.velocity[i].x ==
                                (precision == PLY_FLOAT ? (float)velocity[i].x : velocity[i].x) &&
                            f.points.velocity[i].z == velocity[i].z);
            for (size_t n = 0; n < b.length; n++)
                if (read_bytes(b.data, n, &f, NULL)) fail_msg("accepted %zu of %zu bytes", n, b.length);
            refuse_with(&b, "uint id", "int id", "no property 'int id'");
            if (format == PLY_ASCII) {
                refuse_with(&b, " 16777217 ", " 4294967296 ", line);
                refuse_with(&b, " 16777217 ", " 1.5 ", line);
                refuse_with(&b, " 16777217 ", " -1 ", line);
            }
            free(b.data);
            ply_file_free(&f);
            point_set_free(&s);
        }
}

/* Attributes of each kind, selected by name, by application, and all. */
static void test_columns(void **state)
{
    (void)state;
    static const double heat[3] = {0.5, -1, 3e5}, wind[9] = {1, 2, 3, 4, 5, 6, 7, 8, 9},
                        label[3] = {-7, 0, 9}, uv[6] = {0, 1, 0.25, 0.75, 1, 0};
    static const vec3 color[3] = {{0, 0.5, 1}, {-1, 2, 0.2}, {1, 1, 1}};
    static const point_attribute carried[] = {{"heat", POINT_ATTRIBUTE_FLOAT, 1, heat, false},
                                              {"wind", POINT_ATTRIBUTE_VECTOR, 3, wind, false},
                                              {"label", POINT_ATTRIBUTE_INT, 1, label, false}};
    static const char *const chosen[] = {"label", "red", "green", "blue", "wind", "s", "t", "radius"};
    static const char *const blender[] = {"blender"}, *const unknown[] = {"heat", "cold"};
    point_set s = point_set_sphere(3, vec3_make(0, 0, 0), 1);
    s.points.attribute_count = 3;
    s.points.attributes = carried;
    s.points.color = color;
    s.points.uv = uv;
    columns what;
    error e = {0};
    assert_true(columns_choose(&s.points, chosen, 8, &what, &e));
    bytes b = write_columns(&s.points, &what, PLY_ASCII, PLY_FLOAT);
    assert_non_null(strstr(b.data,
                           "property float z\nproperty int label\nproperty uchar red\nproperty uchar green\n"
                           "property uchar blue\nproperty float wind_x\nproperty float wind_y\n"
                           "property float wind_z\nproperty float s\nproperty float t\n"
                           "property float radius\nend_header\n"));
    assert_non_null(strstr(b.data, " -7 0 128 255 1 2 3 0 1 "));
    assert_non_null(strstr(b.data, " 0 0 255 51 4 5 6 0.25 0.75 "));
    assert_true(columns_choose(&s.points, blender, 1, &what, &e));
    free(b.data);
    /* columns without an array are ignored when the file is read again */
    for (int format = 0; format <= 1; format++) {
        ply_file f = {0};
        b = write_set(&s.points, (ply_format)format, PLY_DOUBLE);
        if (!read_bytes(b.data, b.length, &f, &e)) fail_msg("%s", e.message);
        check_equal(&s.points, &f.points, false);
        assert_memory_equal(f.points.uv, uv, sizeof uv);
        assert_null(f.points.color); /* computed on request only */
        if (format == PLY_ASCII) {
            refuse_with(&b, " -7\n", " -7.5\n", "numbers");
            refuse_with(&b, " -7\n", " -2147483649\n", "numbers");
        }
        free(b.data);
        ply_file_free(&f);
    }
    assert_false(columns_choose(&s.points, unknown, 2, &what, &e));
    assert_int_equal(e.code, ERROR_ATTRIBUTE_MISSING);
    assert_non_null(strstr(e.message, "\"cold\""));
    assert_non_null(strstr(e.message, "heat, wind, label"));
    assert_true(columns_is_own("velocity_x") && columns_is_own("blender") && columns_is_own("rgb") &&
                columns_is_own("all") && columns_is_own("P") && !columns_is_own("heat"));
    point_set_free(&s);
}

static void check_names(const points *set, const char *const *names, size_t name_count, const char *expected)
{
    char found[400] = "";
    columns what;
    error e = {0};
    if (!columns_choose(set, names, name_count, &what, &e)) fail_msg("%s", e.message);
    for (size_t k = 0; k < what.count; k++)
        snprintf(found + strlen(found), sizeof found - strlen(found), "%s%s", k ? " " : "",
                 what.list[k].name);
    assert_string_equal(found, expected);
}

/* Without names; the requested spacing if it varies, attributes but where the curvature is defined, and what a
 * frame of a sequence has. */
static void test_default_columns(void **state)
{
    (void)state;
    static const double numbers[6] = {0}, defined[3] = {1, 0, 1};
    static const vec3 vectors[3];
    static const uint32_t ids[3] = {7, 8, 9};
    static const point_attribute carried[] = {{"Cd", POINT_ATTRIBUTE_COLOR, 3, &vectors->x, false},
                                              {"uv", POINT_ATTRIBUTE_UV, 2, numbers, false},
                                              {"kappa_defined", POINT_ATTRIBUTE_INT, 1, defined, false}};
    static const char *const word[] = {"default"}, *const more[] = {"kappa_defined", "default", "energy"};
    point_set s = point_set_sphere(3, vec3_make(0, 0, 0), 1);
    check_names(&s.points, NULL, 0, "x y z nx ny nz spacing_local");
    s.points.is_graded = true;
    check_names(&s.points, NULL, 0, "x y z nx ny nz spacing spacing_local");
    s.points.is_graded = false;
    s.points.attribute_count = 3;
    s.points.attributes = carried;
    s.points.color = vectors;
    s.points.uv = numbers;
    s.points.kappa_defined = defined;
    for (int k = 0; k < 2; k++)
        check_names(&s.points, k ? word : NULL, (size_t)k,
                    "x y z nx ny nz spacing_local red green blue s t Cd_r Cd_g Cd_b uv_s uv_t");
    check_names(
        &s.points, more, 3,
        "x y z kappa_defined nx ny nz spacing_local red green blue s t Cd_r Cd_g Cd_b uv_s uv_t energy");
    s.points.attribute_count = 0;
    s.points.uv = NULL;
    s.points.id = ids;
    s.points.velocity = vectors;
    check_names(&s.points, NULL, 0, "x y z nx ny nz spacing_local id velocity_x velocity_y velocity_z");
    assert_true(columns_have_all((const char *const[]){"energy", "all"}, 2));
    assert_true(!columns_have_all(more, 3) && !columns_have_all(NULL, 0));
    assert_true(!columns_have_curvature(NULL, 0) && !columns_have_curvature(word, 1));
    assert_true(columns_have_curvature(more, 3) && columns_have_curvature((const char *const[]){"all"}, 1));
    point_set_free(&s);
}

/* Triangles are written; a file with them is no points.ply. */
static void test_triangles(void **state)
{
    (void)state;
    static const uint32_t corner[2][3] = {{0, 1, 2}, {0, 2, 3}};
    static const int64_t labels[2][2] = {{0, 1}, {2, 70000}};
    static const char text[] = "3 0 1 2 0 1\n3 0 2 3 2 70000\n";
    point_set s = point_set_sphere(4, vec3_make(0, 0, 0), 1);
    s.points.triangle_count = 2;
    s.points.triangle = corner;
    s.points.triangle_labels = labels;
    bytes b = write_set(&s.points, PLY_ASCII, PLY_FLOAT);
    assert_non_null(strstr(b.data, "element face 2\nproperty list uchar int vertex_indices\n"
                                   "property int label_a\nproperty int label_b\nend_header\n"));
    assert_memory_equal(b.data + b.length - strlen(text), text, strlen(text));
    refuse(b.data, b.length, "more than points");
    free(b.data);
    s.points.triangle_labels = NULL;
    b = write_set(&s.points, PLY_BINARY_LITTLE_ENDIAN, PLY_FLOAT);
    for (size_t k = 0; k < 2; k++) {
        const char *face = b.data + b.length - 13 * (2 - k);
        assert_int_equal(face[0], 3);
        assert_memory_equal(face + 1, corner[k], sizeof corner[k]); /* as this processor stores them */
    }
    free(b.data);
    point_set_free(&s);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_columns),
        cmocka_unit_test(test_default_columns),
        cmocka_unit_test(test_triangles),
        cmocka_unit_test(test_ids_and_velocities),
        cmocka_unit_test(test_round_trips),
        cmocka_unit_test(test_header),
        cmocka_unit_test(test_every_truncation_is_refused),
        cmocka_unit_test(test_hostile_headers),
        cmocka_unit_test(test_values_that_cannot_be_written),
        cmocka_unit_test(test_bytes_do_not_depend_on_threads),
        cmocka_unit_test(test_full_disk),
    };
    return cmocka_run_group_tests_name("ply", tests, NULL, NULL);
}
