// SPDX-License-Identifier: Apache-2.0
/* Own readers of meshes: exact numbers, polygons, values of vertices, ends of the content, and the positions in
 * refusals.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/rng.h"
#include "io/meshes/plain_mesh.h"

static bool read_bytes(const char *ending, const char *data, size_t size, plain_mesh *m)
{
    *m = (plain_mesh){0};
    return plain_mesh_read(file_format_of_name(ending), data, size, m);
}

static bool read_text(const char *ending, const char *text, plain_mesh *m)
{
    return read_bytes(ending, text, strlen(text), m);
}

static void assert_triangles(const plain_mesh *m, size_t count, const uint32_t (*triangle)[3])
{
    assert_int_equal(m->triangles, count);
    assert_memory_equal(m->triangle, triangle, count * sizeof *triangle);
}

/* Every number is the nearest double, like that of strtod. */
static void numbers_are_exact(void **state)
{
    (void)state;
    const uint64_t seed = 20260101;
    print_message("# seed %llu\n", (unsigned long long)seed);
    rng r = rng_seed(seed, 0);
    for (int n = 0; n < 200000; n++) {
        char text[64];
        const double value = ldexp(rng_uniform(&r) - 0.5, (int)(rng_uniform(&r) * 160) - 80);
        snprintf(text, sizeof text, n % 3 ? "%.*g" : "%.*f", (int)(rng_uniform(&r) * 20), value);
        const char *at = text;
        double got;
        assert_true(plain_mesh_number(&at, &got));
        const double wanted = strtod(text, NULL);
        if (memcmp(&got, &wanted, sizeof got) != 0) fail_msg("%s became %.17g", text, got);
        assert_int_equal(*at, 0);
    }
    static const char *const good[] = {".5",    "-.5e2",    "+1.", "1e22", "1E-22", "12345678901234567890",
                                       "1e400", "4.9e-324", "inf", "-Inf"},
                             *const bad[] = {"",    "-",  ".",  "nanx",  "in", "0x10",
                                             "1,5", "1e", "e5", "1.2.3", "--1"};
    for (size_t k = 0; k < sizeof good / sizeof *good; k++) {
        const char *at = good[k];
        double got;
        assert_true(plain_mesh_number(&at, &got));
        assert_true(got == strtod(good[k], NULL));
    }
    for (size_t k = 0; k < sizeof bad / sizeof *bad; k++) {
        const char *at = bad[k];
        double got;
        if (plain_mesh_number(&at, &got)) fail_msg("%s became %g", bad[k], got);
    }
}

/* Equal indices, or indices of equal vertices, at any corner of a polygon: the triangles are those of the distinct
 * corners. A quadrangle with one pair of equal corners is a triangle, and one with two pairs is none. */
static void polygons_with_equal_corners_are_those_of_their_distinct_corners(void **state)
{
    (void)state;
    static const char vertices[] = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 0\nv 2 .5 0\n";
    static const struct {
        const char *face;
        size_t triangles;
        double area;
    } cases[] = {{"1 1 2 3", 1, 0.5}, {"1 2 2 3", 1, 0.5},   {"1 2 3 3", 1, 0.5},     {"1 2 3 1", 1, 0.5},
                 {"1 2 3 5", 1, 0.5}, {"5 1 2 3", 1, 0.5},   {"1 2 6 3 3 4", 3, 1.5}, {"1 1 2 3 4", 2, 1},
                 {"1 1 2 2", 0, 0},   {"1 1 1 2 3", 1, 0.5}, {"1 5 1 5", 0, 0}};
    for (size_t k = 0; k < sizeof cases / sizeof *cases; k++) {
        char text[256];
        plain_mesh m = {0};
        snprintf(text, sizeof text, "%sf %s\n", vertices, cases[k].face);
        assert_true(read_text("obj", text, &m));
        double area = 0;
        for (size_t n = 0; n < m.triangles; n++) {
            const double *p = m.vertex[m.triangle[n][0]], *q = m.vertex[m.triangle[n][1]],
                         *r = m.vertex[m.triangle[n][2]];
            area += 0.5 * ((q[0] - p[0]) * (r[1] - p[1]) - (r[0] - p[0]) * (q[1] - p[1]));
        }
        if (m.triangles != cases[k].triangles || fabs(area - cases[k].area) > 1e-15 || m.crossed > 0)
            fail_msg("f %s: %zu triangles, area %g, %zu crossed", cases[k].face, m.triangles, area,
                     m.crossed);
        plain_mesh_free(&m);
    }
}

static void positions_keep_their_precision(void **state)
{
    (void)state;
    static const char *const files[][2] = {
        {"obj", "v 2000000.123456789 -1e6 .25 0.5 0.5 0.5\r\nv 1 0 0\nv 0 1 0\n# end\nf -3/1 2//7 3/1/1\n"},
        {"OBJ", "mtllib a.mtl\no part\nv 2000000.123456789 -1e6 .25\nv 1 0 0\nv 0 1 0\nvn 0 0 1\nf 1 2 3"},
        {"stl",
         " solid a b\nfacet normal 0 0 1\nouter loop\nvertex 2000000.123456789 -1e6 .25\nvertex 1 0 0\n"
         "vertex 0 1 0\nendloop\nendfacet\nENDSOLID a b\n"},
        {"ply",
         "ply\r\nformat ascii 1.0\r\ncomment c\r\nelement vertex 3\r\nproperty double x\r\nproperty uchar red\r\n"
         "property double y\r\nproperty double z\r\nelement edge 1\r\nproperty int a\r\nelement face 1\r\n"
         "property list uchar float quality\r\nproperty list uchar int vertex_indices\r\nend_header\r\n"
         "2000000.123456789 7 -1e6 .25\r\n1 7 0 0\r\n0 7 1 0\r\n9\r\n1 .5 3 0 1 2\r\n"}};
    static const uint32_t triangle[1][3] = {{0, 1, 2}};
    for (size_t k = 0; k < sizeof files / sizeof *files; k++) {
        plain_mesh m;
        if (!read_text(files[k][0], files[k][1], &m)) fail_msg("left: %s", files[k][1]);
        assert_triangles(&m, 1, triangle);
        assert_true(m.vertex[0][0] == 2000000.123456789 && m.vertex[0][1] == -1e6 && m.vertex[0][2] == 0.25);
        plain_mesh_free(&m);
    }
}

/* Squares, one of them with a reflex corner, and a pentagon; a line and a point are counted. */
static void polygons_become_triangles(void **state)
{
    (void)state;
    static const char text[] =
        "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0.4 0.6 0\nv 2 0.5 0\nf 1 2 3 4\nf 1 5 3 4\nf 1 2 6 3 4\n"
        "f 1 2\nf 1\n";
    static const uint32_t wanted[7][3] = {{0, 1, 2}, {0, 2, 3}, {4, 2, 3}, {4, 3, 0},
                                          {0, 1, 5}, {0, 5, 2}, {0, 2, 3}};
    plain_mesh m;
    assert_true(read_text("obj", text, &m));
    assert_triangles(&m, 7, wanted);
    assert_int_equal(m.others, 2);
    plain_mesh_free(&m);
}

static size_t put(char *to, const void *from, size_t size, bool turned)
{
    for (size_t k = 0; k < size; k++) to[k] = ((const char *)from)[turned ? size - 1 - k : k];
    return size;
}

/* A binary PLY in this byte order, made on a little-endian machine. */
static size_t binary_ply(char *to, bool big)
{
    static const double vertex[3][3] = {{1e6 + 1.0 / 3, 0, 0}, {1, 0, 0}, {0, 1, 0}};
    static const uint16_t triangle[3] = {2, 0, 1};
    size_t at = (size_t)sprintf(
        to,
        "ply\nformat binary_%s_endian 1.0\nelement vertex 3\nproperty double x\nproperty double y\n"
        "property double z\nelement face 1\nproperty list uchar ushort vertex_index\nend_header\n",
        big ? "big" : "little");
    for (int k = 0; k < 9; k++) at += put(to + at, &vertex[k / 3][k % 3], sizeof(double), big);
    to[at++] = 3;
    for (int k = 0; k < 3; k++) at += put(to + at, &triangle[k], sizeof *triangle, big);
    to[at] = 0;
    return at;
}

static void binary_files(void **state)
{
    (void)state;
    static const uint32_t triangle[1][3] = {{2, 0, 1}}, first[1][3] = {{0, 1, 2}};
    char data[1024];
    for (int big = 0; big < 2; big++) {
        plain_mesh m;
        const size_t size = binary_ply(data, big);
        assert_true(read_bytes("ply", data, size, &m));
        assert_triangles(&m, 1, triangle);
        assert_true(m.vertex[0][0] == 1e6 + 1.0 / 3);
        plain_mesh_free(&m);
        for (size_t cut = 0; cut < size; cut++) {
            char *part = malloc(cut + 1); /* so that sanitizers detect reads beyond the end */
            assert_non_null(part);
            memcpy(part, data, cut);
            part[cut] = 0;
            assert_false(read_bytes("ply", part, cut, &m));
            free(part);
        }
    }
    static const float corner[9] = {0, 0, 0, 0.1f, 0, 0, 0, 1, 0};
    memset(data, 's', 80);
    memcpy(data + 80, (const uint32_t[]){1}, 4);
    memset(data + 84, 0, 50);
    memcpy(data + 96, corner, sizeof corner);
    plain_mesh m;
    assert_true(read_bytes("stl", data, 134, &m));
    assert_triangles(&m, 1, first);
    assert_true(m.vertex[1][0] == (double)0.1f);
    plain_mesh_free(&m);
    assert_false(read_bytes("stl", data, 133, &m));
}

/* Rows in the usual form, with an exceptional one among them. */
static void rows_of_triangles_and_polygons_are_read(void **state)
{
    (void)state;
    static const float vertex[12] = {0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0};
    static const int32_t face[3][5] = {{3, 0, 1, 2}, {4, 0, 1, 2, 3}, {3, 3, 1, 0}};
    static const uint32_t triangle[4][3] = {{0, 1, 2}, {0, 1, 2}, {0, 2, 3}, {3, 1, 0}};
    char data[1024];
    size_t size = (size_t)sprintf(
        data, "ply\nformat binary_little_endian 1.0\nelement vertex 4\nproperty float x\nproperty float y\n"
              "property float z\nelement face 3\nproperty list uchar int vertex_indices\nend_header\n");
    memcpy(data + size, vertex, sizeof vertex);
    size += sizeof vertex;
    for (int k = 0; k < 3; k++) {
        data[size++] = (char)face[k][0];
        memcpy(data + size, face[k] + 1, (size_t)face[k][0] * 4);
        size += (size_t)face[k][0] * 4;
    }
    data[size] = 0;
    plain_mesh m;
    assert_true(read_bytes("ply", data, size, &m));
    assert_triangles(&m, 4, triangle);
    plain_mesh_free(&m);
    for (size_t cut = size - 14; cut < size; cut++) {
        char *part = malloc(cut + 1);
        assert_non_null(part);
        memcpy(part, data, cut);
        part[cut] = 0;
        assert_false(read_bytes("ply", part, cut, &m));
        free(part);
    }
    for (int32_t wrong = -1; wrong <= 4; wrong += 5) {
        memcpy(data + size - 4, &wrong, sizeof wrong);
        assert_false(read_bytes("ply", data, size, &m));
    }
}

/* Other lines of an OBJ file do not change the polygons. */
static void other_lines_of_obj_are_ignored(void **state)
{
    (void)state;
    static const char *const files[][2] = {
        {"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 \\\n3\n", ""},
        {"v 0 0 0\nv 1 0 0\nv 0 1 0\n# \\\nf 1 2 3#\n", ""},
        {"v 0 0 0 2\nv 2 0 0 2\nv 0 2 0 2\nf 1 2 3\n", "3 vertices"},
        {"v 0 0 0\nv 1 0 0\nv 0 1 0\ncurv 0 1 1 2\nodd\nf 1 2 3", "1 free-form"}};
    static const uint32_t triangle[1][3] = {{0, 1, 2}};
    for (size_t k = 0; k < sizeof files / sizeof *files; k++) {
        plain_mesh m;
        if (!read_text("obj", files[k][0], &m)) fail_msg("left: %s", files[k][0]);
        assert_triangles(&m, 1, triangle);
        assert_true(m.vertex[1][0] == 1 && m.vertex[2][1] == 1);
        assert_true(*files[k][1] ? strstr(m.text, files[k][1]) != NULL : !*m.text);
        plain_mesh_free(&m);
    }
}

/* Each truncation of a file is left to the library or refused, and no byte beyond the end is read. */
static void truncated_files_are_refused(void **state)
{
    (void)state;
    static const char
        off[] = "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2",
        gltf[] = "{\"asset\":{\"version\":\"2.0\"},\"scene\":0,\"scenes\":[{\"nodes\":[0]}],"
                 "\"nodes\":[{\"mesh\":0}],\"meshes\":[{\"primitives\":[{\"attributes\":{\"POSITION\":0}}]}],"
                 "\"accessors\":[{\"bufferView\":0,\"componentType\":5121,\"count\":3,\"type\":\"VEC3\"}],"
                 "\"bufferViews\":[{\"buffer\":0,\"byteLength\":9}],\"buffers\":[{\"byteLength\":9,"
                 "\"uri\":\"data:;base64,AAAAAQAAAAEA\"}]}";
    const struct {
        const char *ending, *text;
    } files[] = {{"off", off}, {"gltf", gltf}};
    for (size_t k = 0; k < 2; k++) {
        plain_mesh m;
        const size_t size = strlen(files[k].text);
        assert_true(read_text(files[k].ending, files[k].text, &m));
        assert_int_equal(m.triangles, 1);
        assert_true(m.vertex[1][0] == 1 && m.vertex[2][1] == 1);
        plain_mesh_free(&m);
        for (size_t cut = 0; cut < size; cut++) {
            char *part = malloc(cut + 1); /* so that sanitizers detect reads beyond the end */
            assert_non_null(part);
            memcpy(part, files[k].text, cut);
            part[cut] = 0;
            if (read_bytes(files[k].ending, part, cut, &m)) fail_msg("taken: %s", part);
            free(part);
        }
    }
}

#define CORNERS "v 0 0 0\nv 1 0 0\nv 0 1 0\n"
#define PLY_HEAD(kind) \
    "ply\nformat " kind " 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
#define PLY_FACES "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
#define PLY_ASCII PLY_HEAD("ascii") PLY_FACES
#define FACET "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n"

/* The message begins with the position, and no array is leaked. */
static void damaged_files_are_refused_with_the_place(void **state)
{
    (void)state;
    static const char *const files[][3] = {
        {"obj", CORNERS "f 1 2 4\n", "line 4 of the OBJ file has a face whose corner \"4\" is none of the 3"},
        {"obj", CORNERS "f 1 2 \\\n3\nf 1 2 9\n", "line 6 of the OBJ file has a face whose corner \"9\""},
        {"obj", CORNERS "f 1 2 0\n", "line 4 of the OBJ file has a face whose corner \"0\""},
        {"obj", CORNERS "f 1 2 -4\n", "line 4 of the OBJ file has a face whose corner \"-4\""},
        {"obj", "# a\r\n" CORNERS "\rf 1 2 3x\n", "line 6 of the OBJ file has a face whose corner \"3x\""},
        {"obj", "f 1 2 3\n" CORNERS, "line 1 of the OBJ file has a face whose corner \"1\" is none of the 0"},
        {"obj", "v 0 0 0\nv 1 \\\n0 0\nv nan 1 0\nf 1 2 3\n",
         "line 4 of the OBJ file is a vertex with a coordinate that is not finite"},
        {"obj", "v 0 nan 0\n" CORNERS "v 1e31 0 0\nf 2 3 5\n", "line 5 of the OBJ file is a vertex with"},
        {"off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 inf 0\n3 0 1 2\n", "line 5 of the OFF file is a vertex with"},
        {"ply",
         "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement face 1\n"
         "property list uchar int vertex_indices\nend_header\n0 0 0\n1 nan 0\n0 1 0\n3 0 1 2\n",
         "line 11 of the PLY file is a vertex with"},
        {"stl",
         "solid\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 nan\nvertex 0 1 0\nendloop\nendfacet\nendsolid\n",
         "line 5 of the STL file is a vertex with"},
        {"vtk",
         "# vtk DataFile Version 3.0\na\nASCII\nDATASET POLYDATA\nPOINTS 3 double\n0 0 0\n1 0 0\n0 nan 0\nPOLYGONS 1 4\n3 0 1 2\n",
         "line 8 of the VTK file is a vertex with"},
        {"obj", CORNERS "v 0 0\nf 1 2 3\n", "line 4 of the OBJ file is a vertex of 2 numbers"},
        {"obj", CORNERS "v 0 0 0 1 1\nf 1 2 3\n", "line 4 of the OBJ file is a vertex of 5 numbers"},
        {"obj", "v 0 1,5 0\n", "line 1 of the OBJ file has \"1,5\" in place of a number"},
        {"obj", PLY_ASCII "0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n",
         "the file has no line of OBJ, and begins with ply"},
        {"obj", "\xFF\xFEv", "the file is UTF-16 text"},
        {"stl",
         "solid\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nendloop\nendfacet\nendsolid\n",
         "line 6 of the STL file has \"endloop\" in place of vertex"},
        {"stl", "solid\n" FACET, "line 9 is where the STL file ends, in place of endsolid"},
        {"stl", "solid\n" FACET "endsolid\nsolid\nx",
         "line 11 of the STL file has \"x\" in place of endsolid"},
        {"stl", FACET, "the STL file does not begin with \"solid\", and as a binary file of"},
        {"ply", PLY_ASCII "0 0 0\n1 0 0\n0 1 0\n3 0 1 3\n",
         "line 13 of the PLY file, row 0 of its element \"face\", refers to a vertex that does not exist"},
        {"ply", PLY_ASCII "0 0 0\n1 0 0\n0 1\n3 0 1 2\n",
         "line 12 of the PLY file, row 2 of its element \"vertex\", ends before"},
        {"ply", PLY_ASCII "0 0 0 4\n1 0 0\n0 1 0\n3 0 1 2\n",
         "line 10 of the PLY file, row 0 of its element \"vertex\", has more values"},
        {"ply", PLY_ASCII "0 0 0\n1 0 0\n0 1 0\n-3 0 1 2\n",
         "line 13 of the PLY file, row 0 of its element \"face\", has a list whose length"},
        {"ply", PLY_ASCII "0 0 0\n1 0 0\n0 1 0\n3 0 1.5 2\n",
         "line 13 of the PLY file, row 0 of its element \"face\", refers to a vertex"},
        {"ply", PLY_ASCII "0 0 0\n1 a 0\n0 1 0\n3 0 1 2\n",
         "line 11 of the PLY file, row 1 of its element \"vertex\", has a word"},
        {"ply",
         PLY_HEAD(
             "ascii") "element tristrips 1\nproperty list int int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 3\n",
         "line 13 of the PLY file, row 0 of its element \"tristrips\", refers to a vertex that does not exist"},
        {"ply",
         PLY_HEAD(
             "ascii") "element face 1\nproperty list uchar int corners\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n",
         "the faces of the PLY file have no list \"vertex_indices\""},
        {"ply", PLY_HEAD("other") PLY_FACES "0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n",
         "line 2 of the header of the PLY file"},
        {"ply", "solid\n" FACET "endsolid\n", "the file does not begin with \"ply\""},
        {"off", "OFF\n", "line 2 (the header of the OFF file)"}};
    for (size_t k = 0; k < sizeof files / sizeof *files; k++) {
        plain_mesh m;
        if (read_text(files[k][0], files[k][1], &m)) fail_msg("taken: %s", files[k][1]);
        assert_int_not_equal(m.refused, ERROR_NONE);
        if (strncmp(m.text, files[k][2], strlen(files[k][2])) != 0) fail_msg("%s\n%s", files[k][1], m.text);
        assert_int_equal(m.vertices + m.triangles + m.vertex_room, 0);
    }
}

/* Each file has the triangle 0 1 2, as different programs write it. */
static void ways_to_write_a_triangle_are_read(void **state)
{
    (void)state;
    static const char *const files[][3] = {
        {"obj", "\xEF\xBB\xBF" CORNERS "f 1 2 3\n", ""},
        {"obj", "v 0 0 0\rv 1 0 0\rv 0 1 0\rf 1 2 3\r", ""},
        {"obj", "v 0 0 0\nv 1 0 0 -1.#IND 0 0\nv 0 1 0\n\ff\t1 2 3\n",
         "1 vertices: a word after x y z is not a number"},
        {"obj", CORNERS "f 1 2 3\n7 8 9\n", "lines that begin with 7 are not known"},
        {"stl", "\xEF\xBB\xBFsolid\n" FACET "endsolid\n", ""},
        {"ply",
         "PLY\nformat ascii 1.0\n\nelement vertex 3\nproperty double64 x\nproperty float y\nelement face 1\n"
         "property list uchar float vertex_indices\nend_header \n\n0 0\n1 0\n0 1\n\n3 0 1 2\n",
         ""},
        {"ply",
         "ply\rformat ascii 1.0\relement vertex 3\rproperty float x\rproperty float y\rproperty float z\r"
         "element face 1\rproperty list uchar int vertex_index\rend_header\r0 0 0\r1 0 0\r0 1 0\r3 0 1 2\r",
         ""},
        {"ply",
         PLY_HEAD("ascii") "element face 0\nproperty list uchar int vertex_indices\n" PLY_FACES
                           "0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n",
         ""}};
    static const uint32_t triangle[1][3] = {{0, 1, 2}};
    for (size_t k = 0; k < sizeof files / sizeof *files; k++) {
        plain_mesh m;
        if (!read_text(files[k][0], files[k][1], &m)) fail_msg("%s: %s", files[k][1], m.text);
        assert_triangles(&m, 1, triangle);
        assert_true(m.vertex[1][0] == 1 && m.vertex[2][1] == 1 && m.vertex[2][2] == 0);
        assert_true(*files[k][2] ? strstr(m.text, files[k][2]) != NULL : !*m.text);
        plain_mesh_free(&m);
    }
}

/* A byte 0 ends a text only if nothing else follows. */
static void zeros_after_a_text_are_ignored(void **state)
{
    (void)state;
    static const char padded[] = CORNERS "f 1 2 3\n\0\0", within[] = CORNERS "# \0\nf 1 2 3\n";
    plain_mesh m;
    assert_true(read_bytes("obj", padded, sizeof padded - 1, &m));
    assert_int_equal(m.triangles, 1);
    plain_mesh_free(&m);
    assert_false(read_bytes("obj", within, sizeof within - 1, &m));
    assert_non_null(strstr(m.text, "byte 26 of the file is 0"));
}

/* Each polygon has its corners in the order of the file, also a polygon without a triangle, and one in a
 * mirrored part. */
static void polygons_are_kept_on_request(void **state)
{
    (void)state;
    static const char text[] = CORNERS "v 1 1 0\nv 2 0 0\nf 1 2 4 3\nf 2 5\nf 5 4 2\n";
    static const uint32_t size[] = {4, 2, 3, 3}, corner[] = {0, 1, 3, 2, 1, 4, 4, 3, 1, 0, 1, 2},
                          turned[1][3] = {{0, 2, 1}};
    plain_mesh m;
    m = (plain_mesh){.keeps_polygons = true};
    assert_true(plain_mesh_read(FILE_FORMAT_OBJ, text, sizeof text - 1, &m));
    assert_int_equal(m.triangles, 3);
    assert_true(plain_mesh_add_triangle(&m, 0, 1, 2, true));
    assert_memory_equal(m.triangle[3], turned, sizeof turned);
    assert_int_equal(m.polygons, 4);
    assert_int_equal(m.polygon_corners, sizeof corner / sizeof *corner);
    assert_memory_equal(m.polygon_size, size, sizeof size);
    assert_memory_equal(m.polygon_corner, corner, sizeof corner);
    plain_mesh_free(&m);
    assert_true(read_bytes("obj", text, sizeof text - 1, &m));
    assert_int_equal(m.polygons, 0);
    assert_null(m.polygon_size);
    plain_mesh_free(&m);
}

/* What a reader says of data behind the content that the file declares. */
static void data_behind_the_content_are_told(void **state)
{
    (void)state;
    static const char *const files[][2] = {{"stl", "solid\n" FACET "endsolid\n"},
                                           {"ply", PLY_ASCII "0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"},
                                           {"off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"}};
    for (size_t k = 0; k < sizeof files / sizeof *files; k++) {
        const size_t length = strlen(files[k][1]);
        for (int n = 0; n < 2; n++) {
            char data[1024];
            plain_mesh m;
            memset(data, 0, sizeof data);
            snprintf(data, sizeof data, "%s", files[k][1]);
            if (n) memcpy(data + length, "\0x", 2);
            if (!read_bytes(files[k][0], data, length + 4, &m)) fail_msg("%s: %s", files[k][0], m.text);
            assert_int_equal(m.triangles, 1);
            assert_int_equal(m.rest, n ? length : 0);
            plain_mesh_free(&m);
        }
    }
}

/* The triangle 0 1 2 with values of its vertices, in each format that has them as text. */
static void values_of_vertices_are_read(void **state)
{
    (void)state;
    static const struct {
        const char *ending, *text, *name;
        double value[3][4];
    } files[] = {
        {"obj",
         "v 0 0 0 1 0 0\nv 1 0 0 0 1 0\nv 0 1 0 0 0 0.1\nf 1 2 3\n",
         "color",
         {{1, 0, 0, 1}, {0, 1, 0, 1}, {0, 0, 0.1, 1}}},
        {"obj",
         CORNERS "vt 0.1 0.2\nvt 0.3 0.4\nf 1/1 2/2 3/-2\n",
         "uv",
         {{0.1, 0.2}, {0.3, 0.4}, {0.1, 0.2}}},
        {"obj",
         CORNERS "vn 0 0 1\nusemtl a\nusemtl b\ng c\nf 1//1 2//1 3\n",
         "normal",
         {{0, 0, 1}, {0, 0, 1}, {(double)NAN, (double)NAN, (double)NAN}}},
        {"obj", CORNERS "usemtl a\nusemtl b\nf 1 2 3\n", "material", {{2}, {2}, {2}}},
        {"ply",
         PLY_HEAD(
             "ascii") "property uchar red\nproperty uchar green\nproperty uchar blue\nproperty double heat\n" PLY_FACES
                      "0 0 0 255 0 51 0.1\n1 0 0 0 0 0 0.2\n0 1 0 0 0 0 0.3\n3 0 1 2\n",
         "color",
         {{1, 0, 0.2, 1}, {0, 0, 0, 1}, {0, 0, 0, 1}}},
        {"ply",
         PLY_HEAD("ascii") "property double heat\n" PLY_FACES "0 0 0 0.1\n1 0 0 0.2\n0 1 0 0.3\n3 0 1 2\n",
         "heat",
         {{0.1}, {0.2}, {0.3}}},
        {"off",
         "STCNOFF\n3 1 0\n0 0 0 0 0 1 255 0 0 .5 .6\n1 0 0 0 1 0 51 0 0 .1 .2\n0 1 0 1 0 0 0 0 0 0 0\n3 0 1 2\n",
         "color",
         {{1, 0, 0, 1}, {0.2, 0, 0, 1}, {0, 0, 0, 1}}},
        {"off",
         "STCNOFF\n3 1 0\n0 0 0 0 0 1 1 0 0 .5 .6\n1 0 0 0 1 0 1 0 0 1 .1 .2\n0 1 0 1 0 0 0 0 0 0 0\n3 0 1 2\n",
         "uv",
         {{0.5, 0.6}, {0.1, 0.2}, {0, 0}}},
        {"stl", "solid\n" FACET "endsolid\n", "normal", {{0, 0, 1}, {0, 0, 1}, {0, 0, 1}}}};
    for (size_t k = 0; k < sizeof files / sizeof *files; k++) {
        plain_mesh m = {.keeps_values = true};
        const plain_values *found = NULL;
        if (!plain_mesh_read(file_format_of_name(files[k].ending), files[k].text, strlen(files[k].text), &m))
            fail_msg("%s: %s", files[k].text, m.text);
        for (uint32_t n = 0; n < m.value_arrays; n++)
            if (strcmp(m.values[n].head.name, files[k].name) == 0) found = &m.values[n];
        if (!found) fail_msg("%s has no %s", files[k].text, files[k].name);
        assert_int_equal(m.triangles, 1);
        for (int n = 0; n < 3; n++)
            for (uint32_t c = 0; c < found->head.components; c++) {
                const double value = found->value[m.triangle[0][n] * found->head.components + c],
                             expected = files[k].value[n][c];
                if (value != expected && !(isnan(value) && isnan(expected)))
                    fail_msg("%s: %s of %d is %.17g", files[k].text, files[k].name, n, value);
            }
        plain_mesh_free(&m);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(data_behind_the_content_are_told),
        cmocka_unit_test(values_of_vertices_are_read),
        cmocka_unit_test(polygons_are_kept_on_request),
        cmocka_unit_test(numbers_are_exact),
        cmocka_unit_test(polygons_with_equal_corners_are_those_of_their_distinct_corners),
        cmocka_unit_test(positions_keep_their_precision),
        cmocka_unit_test(polygons_become_triangles),
        cmocka_unit_test(binary_files),
        cmocka_unit_test(rows_of_triangles_and_polygons_are_read),
        cmocka_unit_test(damaged_files_are_refused_with_the_place),
        cmocka_unit_test(ways_to_write_a_triangle_are_read),
        cmocka_unit_test(zeros_after_a_text_are_ignored),
        cmocka_unit_test(other_lines_of_obj_are_ignored),
        cmocka_unit_test(truncated_files_are_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
