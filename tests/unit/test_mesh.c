// SPDX-License-Identifier: Apache-2.0
/* Mesh files: through the reading process to a volume. The test program is its own reader. For a file with
 * the extension "fakeN" it returns an invalid answer of kind N.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <fcntl.h>
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/core/memory.h"
#include "geometry/mesh/mesh_weld.h"
#include "surface/levelset/fidelity.h"
#include "surface/levelset/mesh_faces.h"
#include "geometry/space/triangle.h"
#include "mesh_fixture.h"
#include "io/meshes/mesh_file.h"
#include "io/meshes/mesh_reader.h"
#include "geometry/mesh/flat_triangles.h"
#include "volume_fixture.h"

enum { SEED = 20260721, FAKES = 15 };

/* Opens a closed mesh like a job that samples its level set. */
static volume *open_file(const volume_mesh_request *request, int fd, const char *program, error *e)
{
    mesh whole = {0};
    mesh_notes notes = {0};
    volume *v = NULL;
    const mesh_file file = {fd, request->path, program, request->resolution.memory_limit};
    if (!mesh_file_read(&file, &whole, &notes, e)) {
        error_prefix(e, "%s", request->path);
        return NULL;
    }
    if (flat_triangles_remove(&whole, request->pool, &notes, e))
        v = volume_of_mesh(request, &whole, &notes, e);
    mesh_free(&whole);
    return v;
}

static volume *open_bytes(const void *bytes, size_t count, const char *path, int voxels, size_t memory,
                          error *e)
{
    int fd = fixture_bytes(bytes, count);
    const volume_mesh_request request = {
        .path = path,
        .resolution = {.resolution = voxels, .max_resolution = 8191, .memory_limit = memory},
        .band_vox = 4,
        .pool = mesh_fixture_pool(),
        .isa = isa_best()};
    volume *v = open_file(&request, fd, NULL, e);
    close(fd);
    return v;
}

static volume *open_mesh(const mesh *m, const char *format, int voxels, error *e)
{
    size_t count;
    char *bytes = mesh_fixture_print(m, format, &count),
         *path = mem_printf("x/ball.%s", strcmp(format, "bstl") ? format : "STL");
    volume *v = open_bytes(bytes, count, path, voxels, FIXTURE_MEMORY, e);
    free(path);
    free(bytes);
    return v;
}

static vec3 random_direction(uint64_t *seed)
{
    double u = 2 * fixture_random(seed) - 1, angle = 2 * M_PI * fixture_random(seed), r = sqrt(1 - u * u);
    return (vec3){r * cos(angle), r * sin(angle), u};
}

/* Points of the zero set are on the ball, with outward normals. The ball of triangles is up to 8e-4 of the
 * radius inside the sphere, a fiftieth of a voxel at this resolution. */
static void assert_ball(const volume *v, vec3 center, double radius, double side)
{
    const field *f = volume_field(v);
    const double voxel = volume_describe(v)->voxel_size;
    uint64_t seed = SEED;
    for (int k = 0; k < 500; k++) {
        vec3 out = random_direction(&seed), p;
        field_sample s;
        if (!fixture_project(f, vec3_axpy(radius + side * 0.3 * voxel, out, center), &p))
            fail_msg("no surface in direction %d", k);
        assert_true(field_sample_at(f, p, FIELD_GRADIENT, &s));
        double off = (vec3_norm(vec3_sub(p, center)) - radius) / voxel;
        if (!(fabs(off) < 0.05)) fail_msg("%g voxel off the sphere", off);
        double turn = side * vec3_dot(vec3_unit(s.gradient), out);
        if (!(turn > 0.999)) fail_msg("a normal is off by %g", turn);
    }
}

static void balls_of_every_format(void **state)
{
    (void)state;
    static const char *const formats[] = {"obj", "off", "ply", "stl", "bstl"};
    const vec3 center = {10, -20, 5};
    for (size_t k = 0; k < sizeof formats / sizeof *formats; k++)
        for (int turned = 0; turned < (k == 0 ? 2 : 1); turned++) {
            error e = {0};
            mesh m = mesh_fixture_ball(center, 3, 4);
            for (size_t n = 0; turned && n < m.triangle_count; n++) mesh_fixture_turn(&m, n);
            volume *v = open_mesh(&m, formats[k], 64, &e);
            if (!v) fail_msg("%s: %s", formats[k], e.message);
            const volume_info *info = volume_describe(v);
            assert_ball(v, center, 3, 1);
            assert_int_equal(info->triangles, m.triangle_count);
            assert_int_equal(info->warning_count, turned);
            if (turned) assert_non_null(strstr(info->warning[0], "inside out"));
            assert_true(fabs(info->fidelity.area / mesh_fixture_area(&m) - 1) < 1e-6);
            assert_true(info->fidelity.close > 0.999 && info->fidelity.rms_vox < 0.01);
            assert_true(info->fidelity.unresolved == 0);
            assert_true(info->level_set && strcmp(info->grid, "") == 0);
            volume_close(v);
            mesh_free(&m);
        }
}

/* Maps and machines have coordinates of millions: in single precision this ball has a diameter of 24
 * steps. */
static void positions_far_from_the_origin_keep_their_precision(void **state)
{
    (void)state;
    static const char *const formats[] = {"obj", "stl"};
    const vec3 center = {2e6, -1e6, 5e5};
    for (size_t k = 0; k < sizeof formats / sizeof *formats; k++) {
        error e = {0};
        mesh m = mesh_fixture_ball((vec3){0, 0, 0}, 3, 4);
        for (size_t n = 0; n < m.vertex_count; n++) m.vertex[n] = vec3_add(m.vertex[n], center);
        volume *v = open_mesh(&m, formats[k], 64, &e);
        if (!v) fail_msg("%s: %s", formats[k], e.message);
        assert_ball(v, center, 3, 1);
        volume_close(v);
        mesh_free(&m);
    }
}

static void assert_warned(const volume *v, const char *text)
{
    const volume_info *info = volume_describe(v);
    for (size_t k = 0; k < info->warning_count; k++)
        if (strstr(info->warning[k], text)) return;
    fail_msg("no warning '%s'", text);
}

static void cavities_and_hidden_shells(void **state)
{
    (void)state;
    error e = {0};
    const vec3 center = {0, 0, 0};
    mesh m = mesh_fixture_ball(center, 2, 4), inner = mesh_fixture_ball(center, 1, 4);
    for (size_t n = 0; n < inner.triangle_count; n++) mesh_fixture_turn(&inner, n);
    mesh_fixture_append(&m, inner);
    volume *v = open_mesh(&m, "ply", 64, &e);
    assert_non_null(v);
    assert_ball(v, center, 2, 1);
    assert_ball(v, center, 1, -1);
    assert_int_equal(volume_describe(v)->warning_count, 0);
    volume_close(v);
    for (size_t n = m.triangle_count / 2; n < m.triangle_count; n++) mesh_fixture_turn(&m, n);
    v = open_mesh(&m, "ply", 64, &e);
    assert_non_null(v);
    assert_ball(v, center, 2, 1);
    field_sample s;
    if (field_sample_at(volume_field(v), (vec3){1.02, 0, 0}, FIELD_GRADIENT, &s)) assert_true(s.value < -0.9);
    assert_warned(v, "inside the union of its shells");
    assert_warned(v, "20 % of the mesh area is inside the union");
    volume_close(v);
    mesh_free(&m);
}

static void thin_walls_are_reported(void **state)
{
    (void)state;
    error e = {0};
    mesh m = mesh_fixture_box((vec3){0, 0, 0}, (vec3){1, 1, 0.05}, 0);
    mesh_fixture_append(&m, mesh_fixture_box((vec3){0, 0, 0.5}, (vec3){1, 1, 0.002}, 0));
    volume *v = open_mesh(&m, "off", 64, &e);
    assert_non_null(v);
    assert_warned(v, "thinner than a voxel and is not sampled: set voxel_size to at most 0.0032");
    assert_true(volume_describe(v)->fidelity.thin > 0.45 && volume_describe(v)->fidelity.hidden == 0);
    volume_close(v);
    mesh_free(&m);
    m = mesh_fixture_box((vec3){0, 0, 0}, (vec3){1, 1, 0.002}, 0);
    assert_null(open_mesh(&m, "off", 64, &e));
    assert_int_equal(e.code, ERROR_NO_SURFACE);
    assert_non_null(
        strstr(e.message, "thinner than a voxel of 0.03125 everywhere: set voxel_size to at most 0.0032"));
    mesh_free(&m);
}

/* A blade that 256 voxels do not resolve, and another one that they resolve. */
static void voxels_follow_the_thickness(void **state)
{
    (void)state;
    error e = {0};
    mesh m = mesh_fixture_box((vec3){0, 0, 0}, (vec3){1, 0.02, 0.002}, 0.4);
    volume *v = open_mesh(&m, "off", 0, &e);
    assert_non_null(v);
    const volume_info *info = volume_describe(v);
    assert_string_equal(info->resolution.chosen_by, "thickness");
    assert_true(info->fidelity.thin <= FIDELITY_MAX_THIN);
    assert_true(info->voxel_size > 0.0025 && info->voxel_size < 0.0035);
    assert_int_equal(info->warning_count, 0);
    volume_close(v);
    mesh_free(&m);
    m = mesh_fixture_box((vec3){0, 0, 0}, (vec3){1, 0.1, 0.02}, 0.4);
    v = open_mesh(&m, "off", 0, &e);
    assert_non_null(v);
    assert_string_equal(volume_describe(v)->resolution.chosen_by, "default");
    volume_close(v);
    mesh_free(&m);
}

static void expect_error(const char *path, const void *bytes, size_t count, error_code code, const char *text)
{
    error e = {0};
    assert_null(open_bytes(bytes, count, path, 64, FIXTURE_MEMORY, &e));
    if (e.code != code || !strstr(e.message, text) || strncmp(e.message, path, strlen(path)) != 0)
        fail_msg("%s: %s instead of %s with '%s'", path, e.message, error_code_name(code), text);
}

static void open_meshes_are_refused(void **state)
{
    (void)state;
    mesh m = mesh_fixture_ball((vec3){0, 0, 0}, 1, 2);
    mesh_fixture_remove(&m, 0);
    size_t count;
    char *bytes = mesh_fixture_print(&m, "obj", &count);
    expect_error("dir/open.obj", bytes, count, ERROR_INPUT_UNSUPPORTED,
                 "3 boundary edges around 1 hole: \"holes");
    free(bytes);
    mesh_free(&m);
}

static void files_that_are_no_meshes_are_refused(void **state)
{
    (void)state;
    static const struct {
        const char *path, *text;
        error_code code;
        const char *message;
    } cases[] = {
        {"a.obj", "", ERROR_INPUT_DAMAGED, "is empty"},
        {"a.ply", "version https://git-lfs.github.com/spec/v1\noid sha256:12\n", ERROR_INPUT_DAMAGED,
         "Git LFS"},
        {"a.xyz", "nothing that anybody knows", ERROR_INPUT_UNSUPPORTED,
         "its format is not known, by its name and first bytes"},
        {"a", "nothing that anybody knows", ERROR_INPUT_UNSUPPORTED,
         "its format is not known, by its name and first bytes"},
        {"a.json", "{\"comment\": \"ply solid OFF\"}", ERROR_INPUT_UNSUPPORTED,
         "is a JSON document, which is neither a mesh nor a volume"},
        {"a.jpg", "\xff\xd8\xff\xe0", ERROR_INPUT_UNSUPPORTED, "is a JPEG image"},
        {"a.obj", "# vertices and no face at all\nv 0 0 0\nv 1 0 0\nv 0 1 0\n", ERROR_NO_SURFACE,
         "has no triangles"},
        {"a.obj", "v 0 0 0\nv 1 0 0\nv nan 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n",
         ERROR_INPUT_DAMAGED, "not finite"},
        {"a.obj", "v 0 0 0\nv 1 0 0\nv 0 1e38 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n",
         ERROR_INPUT_DAMAGED, "exceeds"},
        {"a.off", "OFF\n2000000000 2000000000 0\n0 0 0\n", ERROR_INPUT_DAMAGED, ""},
    };
    for (size_t k = 0; k < sizeof cases / sizeof *cases; k++)
        expect_error(cases[k].path, cases[k].text, strlen(cases[k].text), cases[k].code, cases[k].message);
}

/* A file that is truncated anywhere, or has any bytes changed, gives an error or a mesh, and the program does
 * not fail. A fuzzer tests many more such files. */
static void damaged_files(void **state)
{
    (void)state;
    enum { CUTS = 2, CHANGES = 2 };
    static const char *const formats[] = {"obj", "off", "ply", "stl", "bstl"};
    mesh m = mesh_fixture_ball((vec3){0, 0, 0}, 1, 1);
    uint64_t seed = SEED;
    int refused = 0;
    for (size_t k = 0; k < sizeof formats / sizeof *formats; k++) {
        size_t count;
        char *bytes = mesh_fixture_print(&m, formats[k], &count), *copy = mem_alloc(count);
        char *path = mem_printf("x.%s", formats[k][0] == 'b' ? "stl" : formats[k]);
        for (int i = 0; i < CUTS + CHANGES; i++) {
            error e = {0};
            memcpy(copy, bytes, count);
            for (int n = 0; i >= CUTS && n < 4 * (i - CUTS + 2); n++)
                copy[(size_t)(fixture_random(&seed) * (double)count)] = (char)(256 * fixture_random(&seed));
            volume *v = open_bytes(copy, i < CUTS ? 1 + count * (size_t)(3 * i + 1) / 8 : count, path, 16,
                                   FIXTURE_MEMORY, &e);
            refused += !v;
            if (!v && e.code != ERROR_INPUT_DAMAGED && e.code != ERROR_INPUT_UNSUPPORTED &&
                e.code != ERROR_NO_SURFACE && e.code != ERROR_SPEC_INVALID)
                fail_msg("%s %d (seed %d): %s", formats[k], i, SEED, e.message);
            volume_close(v);
        }
        free(path);
        free(copy);
        free(bytes);
    }
    assert_true(refused > 10);
    mesh_free(&m);
}

/* Opening a pipe without a writer would block forever. */
static void other_files_are_not_opened(void **state)
{
    (void)state;
    char directory[] = "/tmp/test_mesh.XXXXXX", here[4096];
    assert_non_null(getcwd(here, sizeof here));
    assert_non_null(mkdtemp(directory));
    assert_int_equal(chdir(directory), 0);
    assert_int_equal(mkfifo("other.mtl", 0600), 0);
    error e = {0};
    mesh m = mesh_fixture_ball((vec3){0, 0, 0}, 1, 2);
    size_t count;
    char *bytes = mesh_fixture_print(&m, "obj", &count),
         *text = mem_printf("mtllib other.mtl\nusemtl a\n%s", bytes);
    volume *v = open_bytes(text, strlen(text), "mesh.obj", 32, FIXTURE_MEMORY, &e);
    if (!v) fail_msg("%s", e.message);
    volume_close(v);
    unlink("other.mtl");
    assert_int_equal(chdir(here), 0);
    rmdir(directory);
    free(text);
    free(bytes);
    mesh_free(&m);
}

static void limits_hold(void **state)
{
    (void)state;
    mesh m = mesh_fixture_ball((vec3){0, 0, 0}, 1, 5);
    size_t count;
    char *bytes = mesh_fixture_print(&m, "bstl", &count);
    for (size_t memory = 1 << 16; memory <= 1 << 24; memory *= 16) {
        error e = {0};
        assert_null(open_bytes(bytes, count, "ball.stl", 256, memory, &e));
        if (e.code != ERROR_LIMIT_MEMORY) fail_msg("%zu bytes: %s", memory, e.message);
    }
    free(bytes);
    mesh_free(&m);
}

/* ---- readers that return invalid answers */

static int fake(int kind)
{
    static const double corners[4][3] = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}}, bad[3] = {0, NAN, 0};
    static const uint32_t faces[4][3] = {{0, 2, 1}, {0, 1, 3}, {1, 2, 3}, {2, 0, 3}}, none[3] = {0, 4, 1};
    mesh_reader_header h = {.vertices = 4, .triangles = 4};
    reader_head head = {.magic = READER_MAGIC, .size = sizeof h};
    if (kind == 1) head.magic++;
    if (kind == 2) h.vertices = 5;
    if (kind == 3) h.triangles = 5;
    if (kind == 4) h.triangles = UINT64_MAX;
    if (kind == 5) h.vertices = (uint64_t)1 << 31;
    if (kind == 6) head.code = ERROR_CODE_COUNT;
    if (kind == 7) head.text_length = UINT32_MAX;
    if (kind == 13 || kind == 14) head = (reader_head){READER_MAGIC, ERROR_INPUT_DAMAGED, 2, 0};
    if (kind == 15) head.size--;
    fwrite(&head, sizeof head, 1, stdout);
    if (kind == 13 || kind == 14) fwrite(kind == 13 ? "\0a" : "a\n", 2, 1, stdout);
    if (kind == 13 || kind == 14) return fflush(stdout);
    fwrite(&h, kind == 8 ? 20 : sizeof h, 1, stdout);
    if (kind == 8) return fflush(stdout);
    fwrite(corners, sizeof corners - sizeof bad, 1, stdout);
    fwrite(kind == 9 ? bad : corners[3], sizeof bad, 1, stdout);
    fwrite(faces, sizeof faces - sizeof none, 1, stdout);
    fwrite(kind == 10 ? none : faces[3], sizeof none, 1, stdout);
    if (kind == 11) putchar('x');
    fflush(stdout);
    if (kind == 12) raise(SIGKILL); /* a sanitizer does not catch it */
    return 0;
}

static void invalid_answers_of_a_reader_are_refused(void **state)
{
    (void)state;
    static const char *const words[] = {"",
                                        "invalid answer",
                                        "ended while it was read",
                                        "ended while it was read",
                                        "more than 32-bit indices allow",
                                        "raise limits.memory_mb",
                                        "invalid answer",
                                        "invalid answer",
                                        "ended while it was read",
                                        "not finite",
                                        "not among the 4 vertices",
                                        "more data than announced",
                                        "the library that reads this format crashed",
                                        "without a reason",
                                        "a ",
                                        "invalid answer"};
    volume *v = NULL;
    error e = {0};
    v = open_bytes("x", 1, "a.fake0", 32, FIXTURE_MEMORY, &e); /* a valid answer */
    if (!v) fail_msg("%s", e.message);
    volume_close(v);
    for (int kind = 1; kind <= FAKES; kind++) {
        char path[32];
        snprintf(path, sizeof path, "a.fake%d", kind);
        expect_error(path, "x", 1,
                     kind == 4   ? ERROR_INPUT_UNSUPPORTED
                     : kind == 5 ? ERROR_LIMIT_MEMORY
                                 : ERROR_INPUT_DAMAGED,
                     words[kind]);
    }
    const int fd = fixture_bytes("x", 1);
    const volume_mesh_request request = {
        .path = "a.obj", .resolution = {.resolution = 32, .memory_limit = FIXTURE_MEMORY}, .band_vox = 4};
    assert_null(open_file(&request, fd, "/nowhere/at/all", &e));
    assert_int_equal(e.code, ERROR_INTERNAL);
    close(fd);
}

static void assert_same_mesh(const mesh *a, const mesh *b)
{
    assert_int_equal(a->vertex_count, b->vertex_count);
    assert_int_equal(a->triangle_count, b->triangle_count);
    assert_memory_equal(a->vertex, b->vertex, a->vertex_count * sizeof *a->vertex);
    assert_memory_equal(a->triangle, b->triangle, a->triangle_count * sizeof *a->triangle);
}

/* If a mesh only needs joined vertices, it is welded once. Any other mesh is welded by its user, who also
 * gets the notes. */
static void clean_meshes_are_welded_once(void **state)
{
    (void)state;
    error e = {0};
    for (int kind = 0; kind < 5; kind++) {
        mesh m = mesh_fixture_ball((vec3){0, 0, 0}, 1, 3), usual;
        mesh_notes notes = {0}, weld_notes = {0};
        const uint32_t *t = m.triangle[7];
        if (kind == 1) mesh_fixture_add(&m, t[1], t[2], t[0]); /* a duplicate */
        if (kind == 2) mesh_fixture_add(&m, t[0], t[2], t[1]); /* with the opposite orientation */
        if (kind == 3) mesh_fixture_add(&m, t[0], t[0], t[1]);
        if (kind == 4) mesh_fixture_remove(&m, 5);
        assert_true(mesh_copy(&m, mesh_fixture_pool(), &usual, &e) &&
                    mesh_weld(&usual, MESH_KEEP_CANCELLED, &notes, &e));
        const size_t all = m.triangle_count;
        assert_true(mesh_weld_clean(&m, mesh_fixture_pool(), &e));
        assert_int_equal(m.welded, kind == 0 || kind == 4);
        assert_int_equal(m.triangle_count, all);
        assert_true(mesh_weld(&m, MESH_KEEP_CANCELLED, &weld_notes, &e));
        assert_true(m.welded && weld_notes.count == notes.count && notes.count == (kind > 0 && kind < 4));
        assert_same_mesh(&m, &usual);
        mesh_free(&m);
        mesh_free(&usual);
    }
}

/* Each corner has its own vertex, in a separate order. Some vertices far away belong to no triangle. */
static mesh make_soup(int splits, uint64_t *seed)
{
    mesh m = mesh_fixture_ball((vec3){0, 0, 0}, 1, splits);
    const size_t corners = 3 * m.triangle_count, count = corners + 100;
    vec3 *vertex = mem_array(count, sizeof *vertex, "test", NULL);
    uint32_t *at = mem_array(count, sizeof *at, "test", NULL);
    for (uint32_t n = 0; n < count; n++) at[n] = n;
    for (size_t n = count - 1; n > 0; n--) {
        const size_t other = (size_t)(fixture_random(seed) * (double)(n + 1));
        const uint32_t swap = at[n];
        at[n] = at[other];
        at[other] = swap;
    }
    for (size_t n = 0; n < count; n++) vertex[n] = (vec3){9, 9, 9};
    for (size_t n = 0; n < corners; n++) {
        vertex[at[n]] = m.vertex[m.triangle[n / 3][n % 3]];
        m.triangle[n / 3][n % 3] = at[n];
    }
    free(at);
    free(m.vertex);
    m.vertex = vertex;
    m.vertex_count = count;
    return m;
}

/* Of equal vertices the one with the first corner is kept. Kept vertices keep their order. */
static void the_first_of_equal_vertices_is_kept(void **state)
{
    (void)state;
    enum { RUNS = 10 };
    uint64_t seed = SEED;
    for (int run = 0; run < RUNS; run++) {
        mesh m = make_soup(3, &seed), copy = {0};
        error e = {0};
        assert_true(mesh_copy(&m, NULL, &copy, &e));
        assert_true(mesh_weld_clean(&m, mesh_fixture_pool(), &e) && m.welded);
        assert_int_equal(m.vertex_count, 642);
        assert_int_equal(m.triangle_count, copy.triangle_count);
        const uint32_t *old = copy.triangle[0], *new = m.triangle[0];
        uint32_t kept[642];
        size_t found = 0;
        for (size_t n = 0; n < 3 * m.triangle_count; n++) {
            assert_memory_equal(&m.vertex[new[n]], &copy.vertex[old[n]], sizeof(vec3));
            size_t first = 0;
            while (memcmp(&copy.vertex[old[first]], &copy.vertex[old[n]], sizeof(vec3)) != 0) first++;
            if (first < n) continue;
            kept[new[n]] = old[n];
            found++;
        }
        assert_int_equal(found, 642);
        for (size_t v = 1; v < found; v++)
            if (kept[v] <= kept[v - 1]) fail_msg("run %d, seed %d: vertex %zu", run, SEED, v);
        mesh_free(&m);
        mesh_free(&copy);
    }
}

/* Vertices without triangles are outside of the box. The result does not depend on the number of threads. */
static void boxes_contain_the_vertices_of_triangles_only(void **state)
{
    (void)state;
    uint64_t seed = 1;
    error e = {0};
    mesh m = make_soup(5, &seed);
    for (int welded = 0; welded < 2; welded++) {
        const bbox one = mesh_box(&m, NULL), all = mesh_box(&m, mesh_fixture_pool());
        assert_memory_equal(&one, &all, sizeof one);
        assert_true(one.max.x <= 1 && one.max.x > 0.99 && one.min.z >= -1 && one.min.z < -0.99);
        assert_true(mesh_weld_clean(&m, mesh_fixture_pool(), &e));
    }
    mesh_free(&m);
}

/* A fan with more triangles than are compared with each other is checked by the user that welds the mesh. */
static void fans_are_welded_too(void **state)
{
    (void)state;
    enum { SIDES = 200 };
    error e = {0};
    mesh m = mesh_fixture_box((vec3){0, 0, 0}, (vec3){1, 1, 1}, 0), fan = {0};
    mesh_notes notes = {0};
    fan.vertex = mem_alloc((SIDES + 1) * sizeof *fan.vertex);
    fan.triangle = mem_alloc(SIDES * sizeof *fan.triangle);
    fan.vertex_count = SIDES + 1;
    fan.triangle_count = SIDES;
    for (uint32_t k = 0; k < SIDES; k++) {
        fan.vertex[k + 1] = (vec3){cos(k), sin(k), 0};
        fan.triangle[k][1] = k + 1;
        fan.triangle[k][2] = 1 + (k + 1) % SIDES;
    }
    mesh_fixture_append(&m, fan);
    assert_true(mesh_weld_clean(&m, mesh_fixture_pool(), &e));
    assert_false(m.welded);
    assert_true(mesh_weld(&m, MESH_KEEP_CANCELLED, &notes, &e));
    assert_int_equal(m.triangle_count, 12 + SIDES);
    assert_int_equal(notes.count, 0);
    mesh_free(&m);
}

/* A box with every face twice, one of them reversed: the two cancel, but without both the box would have a
 * hole. */
static void faces_that_cancel_leave_no_hole(void **state)
{
    (void)state;
    for (size_t turned = 0; turned < 12 * 12; turned++) {
        mesh m = mesh_fixture_box((vec3){0, 0, 0}, (vec3){1, 2, 3}, 0.4);
        const double area = mesh_area(&m);
        mesh_fixture_append(&m, mesh_fixture_box((vec3){0, 0, 0}, (vec3){1, 2, 3}, 0.4));
        mesh_fixture_turn(&m, turned / 12);
        if (turned % 12 > turned / 12) mesh_fixture_turn(&m, turned % 12);
        mesh_notes notes = {0};
        mesh_edges edges = {0};
        error e = {0};
        assert_true(mesh_weld(&m, MESH_DROP_IF_CLOSED, &notes, &e) && mesh_edges_list(&m, NULL, &edges, &e));
        assert_int_equal(m.triangle_count, 12);
        assert_int_equal(edges.open, 0);
        assert_true(fabs(mesh_area(&m) - area) < 1e-12 * area);
        mesh_edges_free(&edges);
        mesh_free(&m);
    }
}

/* A box and its mirror image above it, also if a face is reversed elsewhere. */
static void a_contact_of_solids_is_dropped(void **state)
{
    (void)state;
    for (size_t turned = 0; turned < 24; turned++) {
        mesh m = mesh_fixture_box((vec3){0, 0, 0}, (vec3){1, 2, 3}, 0),
             above = mesh_fixture_box((vec3){0, 0, 0}, (vec3){1, 2, 3}, 0);
        for (size_t v = 0; v < above.vertex_count; v++) above.vertex[v].z = 6 - above.vertex[v].z;
        for (size_t t = 0; t < above.triangle_count; t++) mesh_fixture_turn(&above, t);
        mesh_fixture_append(&m, above);
        const uint32_t *t = m.triangle[turned];
        const bool touches = m.vertex[t[0]].z == 3 && m.vertex[t[1]].z == 3 && m.vertex[t[2]].z == 3;
        if (!touches) mesh_fixture_turn(&m, turned);
        mesh_notes notes = {0};
        error e = {0};
        assert_true(mesh_weld(&m, MESH_DROP_IF_CLOSED, &notes, &e));
        assert_int_equal(m.triangle_count, 20);
        assert_int_equal(notes.count, 1);
        assert_non_null(strstr(notes.text[0], "closed shells touch: an area of 8 "));
        mesh_free(&m);
    }
}

/* Two intersecting balls, and a thin plate, neither of which a level set represents. */
static void fidelity_by_any_number_of_threads(void **state)
{
    (void)state;
    error e = {0};
    const double unit[16] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};
    mesh m = mesh_fixture_ball((vec3){0, 0, 0}, 20, 4);
    mesh_fixture_append(&m, mesh_fixture_ball((vec3){0, 0, 0}, 10, 4));
    mesh_fixture_append(&m, mesh_fixture_box((vec3){50, 0, 0}, (vec3){10, 10, 0.5}, 0.3));
    fidelity alone = {0}, together = {0};
    assert_true(fidelity_measure(&m, unit, NULL, 0.1, NULL, &alone, &e));
    assert_true(fidelity_measure(&m, unit, NULL, 0.1, mesh_fixture_pool(), &together, &e));
    assert_true(alone.thin > 0.05 && alone.hidden > 0.1 && alone.unresolved == 1);
    assert_int_equal(alone.thin_places, together.thin_places);
    assert_memory_equal(alone.thin_place, together.thin_place, alone.thin_places * sizeof(vec3));
    assert_true(alone.thin == together.thin && alone.hidden == together.hidden);
    assert_true(alone.area == together.area && alone.thin_voxel == together.thin_voxel);
    fidelity_free(&alone);
    fidelity_free(&together);
    mesh_free(&m);
}

/* The mesh has enough triangles that a tree is used to find the closest points. */
static void closest_points_on_many_triangles_are_found(void **state)
{
    (void)state;
    error e = {0};
    const double half[16] = {0.5, 0, 0, -3, 0, 0.5, 0, 0, 0, 0, 0.5, 0, 0, 0, 0, 1};
    mesh m = mesh_fixture_ball((vec3){6, 0, 0}, 20, 6), whole = {0};
    mesh_fixture_append(&m, mesh_fixture_box((vec3){300, 0, 0}, (vec3){3, 3, 3}, 0.3));
    assert_true(m.triangle_count > 65536 && mesh_copy(&m, mesh_fixture_pool(), &whole, &e));
    mesh_faces *f = mesh_faces_new(&m, half, true, mesh_fixture_pool(), &e);
    assert_non_null(f);
    uint64_t seed = SEED;
    for (int k = 0; k < 40; k++) {
        const vec3 out = random_direction(&seed), from = k % 8 == 7 ? (vec3){300, 0, 0} : (vec3){6, 0, 0},
                   at = vec3_axpy(k % 2 ? 19.5 : 25, out, from); /* in voxels */
        double nearest = INFINITY;
        for (size_t n = 0; n < whole.triangle_count; n++) {
            const uint32_t *t = whole.triangle[n];
            const triangle corners = {whole.vertex[t[0]], whole.vertex[t[1]], whole.vertex[t[2]]};
            nearest = fmin(nearest, sqrt(triangle_distance2(&corners, at)));
        }
        const vec3 x = {0.5 * at.x - 3, 0.5 * at.y, 0.5 * at.z};
        const double found = 2 * vec3_norm(vec3_sub(mesh_faces_nearest(f, x), x));
        if (!(fabs(found - nearest) < 1e-9)) fail_msg("%.17g voxels away, not %.17g", nearest, found);
        if (k % 8 == 7 || k % 2 == 0) continue;
        const double landed = 2 * vec3_norm(vec3_sub(mesh_faces_project(f, x, out), x));
        if (!(fabs(landed - nearest) < 1e-9)) fail_msg("%.17g voxels away, not %.17g", nearest, landed);
    }
    mesh_faces_free(f);
    mesh_free(&whole);
}

int main(int argc, char **argv)
{
    if (argc > 2 && strcmp(argv[1], MESH_READER_COMMAND) == 0)
        return strncmp(argv[2], "fake", 4) == 0 ? fake(atoi(argv[2] + 4))
                                                : mesh_reader_main(argc - 1, argv + 1);
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(balls_of_every_format),
        cmocka_unit_test(cavities_and_hidden_shells),
        cmocka_unit_test(thin_walls_are_reported),
        cmocka_unit_test(open_meshes_are_refused),
        cmocka_unit_test(files_that_are_no_meshes_are_refused),
        cmocka_unit_test(damaged_files),
        cmocka_unit_test(other_files_are_not_opened),
        cmocka_unit_test(limits_hold),
        cmocka_unit_test(invalid_answers_of_a_reader_are_refused),
        cmocka_unit_test(voxels_follow_the_thickness),
        cmocka_unit_test(closest_points_on_many_triangles_are_found),
        cmocka_unit_test(positions_far_from_the_origin_keep_their_precision),
        cmocka_unit_test(clean_meshes_are_welded_once),
        cmocka_unit_test(the_first_of_equal_vertices_is_kept),
        cmocka_unit_test(boxes_contain_the_vertices_of_triangles_only),
        cmocka_unit_test(fans_are_welded_too),
        cmocka_unit_test(faces_that_cancel_leave_no_hole),
        cmocka_unit_test(a_contact_of_solids_is_dropped),
        cmocka_unit_test(fidelity_by_any_number_of_threads),
    };
    return cmocka_run_group_tests_name("mesh", tests, NULL, NULL);
}
