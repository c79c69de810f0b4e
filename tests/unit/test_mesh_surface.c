// SPDX-License-Identifier: Apache-2.0
/* Meshes as fields of patches: zero on their triangles, with the normals and curvatures of the
 * approximated surface. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "surface/triangles/mesh_refinement.h"
#include "geometry/mesh/mesh_weld.h"
#include "surface/triangles/mesh_surface.h"
#include "geometry/space/triangle.h"
#include "mesh_fixture.h"
#include "sampling/sizing/elements.h"
#include "sampling/sizing/feature_size.h"
#include "volume_fixture.h"

enum { PLACES = 300, MEMORY = 1 << 30 };

static mesh_surface *try_to_make(mesh m, double angle, double longest, size_t memory, error *e)
{
    mesh_patches patches = {0};
    mesh_notes notes = {0};
    const mesh_patches_params params = {.weld = 1e-6, .feature_angle = angle};
    assert_true(mesh_patches_make(&m, &params, &notes, &patches, e));
    return mesh_surface_new(&patches, longest, memory, NULL, e);
}

static mesh_surface *make(mesh m, double angle, double longest)
{
    error e = {0};
    mesh_surface *s = try_to_make(m, angle, longest, MEMORY, &e);
    assert_non_null(s);
    return s;
}

/* The squared distance from some triangles. */
static double distance2_from(const mesh *m, size_t first, size_t end, vec3 x)
{
    double best = INFINITY;
    for (size_t n = first; n < end; n++) {
        const uint32_t *t = m->triangle[n];
        const triangle at = {m->vertex[t[0]], m->vertex[t[1]], m->vertex[t[2]]};
        best = fmin(best, triangle_distance2(&at, x));
    }
    return best;
}

static double distance_from(const mesh_surface *s, vec3 x)
{
    const mesh *m = &mesh_surface_patches(s)->m;
    return sqrt(distance2_from(m, 0, m->triangle_count, x));
}

/* A place in a random cell, displaced by up to `off` along each axis. */
static vec3 place_near(const field *f, double off, uint64_t *seed, size_t *cell)
{
    vec3 t[FIELD_CELL_TRIANGLES][3];
    *cell = (size_t)(fixture_random(seed) * (double)f->ops->cell_count(f));
    assert_int_equal(f->ops->cell_triangles(f, *cell, t), 1);
    double u = fixture_random(seed), v = fixture_random(seed) * (1 - u);
    vec3 x = vec3_axpy(u, vec3_sub(t[0][1], t[0][0]), vec3_axpy(v, vec3_sub(t[0][2], t[0][0]), t[0][0]));
    for (int axis = 0; axis < 3; axis++)
        vec3_set(&x, axis, vec3_get(x, axis) + off * (2 * fixture_random(seed) - 1));
    return x;
}

/* Newton's method from a place near the mesh converges to it in few steps. */
static void assert_newton_ends_on_mesh(mesh_surface *s, double off)
{
    const field *f = mesh_surface_field(s);
    uint64_t seed = 20261121;
    for (int k = 0; k < PLACES; k++) {
        size_t cell;
        vec3 x = place_near(f, off, &seed, &cell);
        const field *patch = field_of_patch(f, f->ops->patch_at(f, cell, x));
        field_sample at;
        for (int step = 0; step < 8; step++) {
            assert_true(field_sample_at(patch, x, FIELD_GRADIENT, &at));
            assert_float_equal(vec3_norm(at.gradient), 1, 1e-12);
            x = vec3_axpy(-at.value, at.gradient, x);
        }
        if (field_is_within(patch, x)) assert_true(distance_from(s, x) <= 2e-7 * f->extent);
    }
}

static void test_newton_ends_on_mesh(void **state)
{
    (void)state;
    mesh_surface *s = make(mesh_fixture_ball(vec3_make(1, 2, 3), 2, 2), 0, 0.2);
    assert_newton_ends_on_mesh(s, 0.1);
    mesh_surface_free(s);
    s = make(mesh_fixture_box(vec3_make(1, 2, 3), vec3_make(1, 2, 3), 0.3), MESH_PATCHES_AUTOMATIC, 0.2);
    assert_newton_ends_on_mesh(s, 0.1);
    mesh_surface_free(s);
    s = make(mesh_fixture_box(vec3_make(1, 2, 3), vec3_make(1, 2, 3), 0.3), 0, 0.2);
    assert_newton_ends_on_mesh(s, 0.02);
    mesh_surface_free(s);
    s = make(mesh_fixture_sheet(60, 6, mesh_fixture_moebius), 0, 0.2);
    assert_true(mesh_surface_field(s)->patches->patch[0].one_sided);
    assert_newton_ends_on_mesh(s, 0.05);
    mesh_surface_free(s);
}

/* Places in lanes, with the hint of the previous one or without a hint, give the results of single
 * samples. */
static void test_lanes_of_patches_equal_single_samples(void **state)
{
    (void)state;
    mesh_surface *s = make(mesh_fixture_ball(vec3_make(1, 2, 3), 2, 4), 0, 0.2);
    const field *f = mesh_surface_field(s), *patch = f->patches->patch[0].field;
    uint32_t hint[VEC3_LANES], which[VEC3_LANES] = {0};
    uint64_t seed = 8;
    size_t cell;
    vec3 x[VEC3_LANES];
    for (int l = 0; l < VEC3_LANES; l++) {
        hint[l] = l % 3 ? 0 : FIELD_NO_HINT;
        x[l] = place_near(f, 0.1, &seed, &cell);
    }
    for (int k = 0; k < PLACES; k++) {
        vec3_lanes at, gradient;
        bool defined[VEC3_LANES];
        double value[VEC3_LANES];
        for (int l = 0; l < VEC3_LANES; l++) {
            for (int axis = 0; axis < 3; axis++)
                vec3_set(&x[l], axis, vec3_get(x[l], axis) + 0.05 * (2 * fixture_random(&seed) - 1));
            at.x[l] = x[l].x;
            at.y[l] = x[l].y;
            at.z[l] = x[l].z;
            defined[l] = l > 0;
        }
        f->ops->sample_patch_lanes(f, which, &at, defined, hint, value, &gradient);
        for (int l = 1; l < VEC3_LANES; l++) {
            field_sample one;
            assert_true(field_sample_at(patch, x[l], FIELD_GRADIENT, &one));
            assert_float_equal(value[l], one.value, 1e-9);
            assert_float_equal(gradient.x[l], one.gradient.x, 1e-9);
            assert_float_equal(gradient.y[l], one.gradient.y, 1e-9);
            assert_float_equal(gradient.z[l], one.gradient.z, 1e-9);
            x[l] = vec3_axpy(-one.value, one.gradient, x[l]);
        }
    }
    assert_int_equal(hint[0], FIELD_NO_HINT); /* its place is undefined */
    mesh_surface_free(s);
}

/* Rays from one face of a box into it end at one of the others, with its normal; those out of it do not end. */
static void test_rays_end_at_the_opposite_face(void **state)
{
    (void)state;
    const vec3 low = {1, 2, 3}, high = {2, 4, 3.1};
    mesh_surface *s =
        make(mesh_fixture_box(vec3_scale(vec3_add(low, high), 0.5), vec3_scale(vec3_sub(high, low), 0.5), 0),
             MESH_PATCHES_AUTOMATIC, 0.2);
    const field *f = mesh_surface_field(s);
    assert_int_equal(f->patches->count, 6);
    uint64_t seed = 9;
    for (int k = 0; k < PLACES; k++) {
        size_t cell;
        const vec3 x = place_near(f, 0, &seed, &cell);
        field_sample at;
        uint32_t hint = FIELD_NO_HINT;
        assert_true(field_sample_near(f, x, FIELD_GRADIENT, &hint, &at));
        vec3 along = vec3_unit(vec3_make(fixture_random(&seed) - 0.5, fixture_random(&seed) - 0.5,
                                         fixture_random(&seed) - 0.5)),
             normal = {0};
        const bool inwards = vec3_dot(along, at.gradient) < 0;
        double wanted = INFINITY, found = -1;
        int axis = 0;
        for (int a = 0; a < 3; a++) {
            const double way = vec3_get(along, a), end = vec3_get(way > 0 ? high : low, a),
                         to = (end - vec3_get(x, a)) / way;
            if (to < wanted) axis = a;
            wanted = fmin(wanted, to);
        }
        const bool is_found = f->ops->first_crossing(f, x, along, INFINITY, hint, &found, &normal);
        assert_int_equal(is_found, inwards);
        if (!inwards) continue;
        assert_float_equal(found, wanted, 1e-9);
        assert_float_equal(vec3_get(normal, axis), vec3_get(along, axis) > 0 ? 1 : -1, 1e-9);
        assert_false(f->ops->first_crossing(f, x, along, 0.99 * wanted, hint, &found, &normal));
    }
    mesh_surface_free(s);
}

/* A ball of triangles: F is the distance from it, and normals and curvatures are those of the sphere, to the
 * size of the triangles. */
static void test_ball(void **state)
{
    (void)state;
    const vec3 center = {1, 2, 3};
    mesh_surface *s = make(mesh_fixture_ball(center, 2, 4), 0, 0.2);
    const field *f = mesh_surface_field(s);
    uint64_t seed = 5;
    assert_int_equal(f->patches->curve_count, 0);
    assert_float_equal(f->patches->patch[0].area, 16 * M_PI, 0.1);
    for (int k = 0; k < PLACES; k++) {
        size_t cell;
        vec3 x = place_near(f, 0.1, &seed, &cell), out = vec3_unit(vec3_sub(x, center));
        field_sample at;
        double k1, k2;
        assert_true(field_sample_at(f, x, FIELD_HESSIAN, &at));
        assert_float_equal(at.value, vec3_norm(vec3_sub(x, center)) - 2, 5e-3);
        assert_true(vec3_dot(at.gradient, out) > 0.9999);
        field_curvature(&at, &k1, &k2);
        assert_float_equal(k1, 0.5, 0.02);
        assert_float_equal(k2, 0.5, 0.02);
        assert_true(field_is_within(f->patches->patch[0].field, x));
    }
    mesh_surface_free(s);
}

/* Touching blocks, so that many places have the same distance from two patches: the whole field equals the
 * first of the nearest patches. */
static void test_the_whole_field_equals_the_nearest_patch(void **state)
{
    (void)state;
    enum { SIDE = 6, ALL = SIDE * SIDE * SIDE };
    mesh m = {0};
    for (int k = 0; k < ALL; k++) {
        const vec3 at = {k % SIDE, k / SIDE % SIDE, k / SIDE / SIDE};
        mesh one = mesh_fixture_box(at, vec3_make(0.5, 0.5, 0.5), 1);
        m.vertex = realloc(m.vertex, (m.vertex_count + one.vertex_count) * sizeof *m.vertex);
        memcpy(m.vertex + m.vertex_count, one.vertex, one.vertex_count * sizeof *m.vertex);
        m.vertex_count += one.vertex_count;
        for (size_t n = 0; n < one.triangle_count; n++) {
            const uint32_t first = (uint32_t)(m.vertex_count - one.vertex_count), *t = one.triangle[n];
            mesh_fixture_add(&m, first + t[0], first + t[1], first + t[2]);
        }
        mesh_free(&one);
    }
    mesh_surface *s = make(m, MESH_PATCHES_AUTOMATIC, 0.5);
    const field *f = mesh_surface_field(s);
    uint64_t seed = 9;
    assert_true(f->patches->count > ALL);
    for (int k = 0; k < PLACES; k++) {
        vec3 x;
        for (int axis = 0; axis < 3; axis++) { /* on a lattice of quarters, which many triangles share */
            const double on = SIDE * fixture_random(&seed) - 0.5;
            vec3_set(&x, axis, k % 2 ? on : round(4 * on) / 4);
        }
        double nearest = INFINITY;
        field_sample whole, first = {0};
        for (size_t p = 0; p < f->patches->count; p++) {
            const mesh_patches *all = mesh_surface_patches(s);
            const double distance2 = distance2_from(&all->m, all->first[p], all->first[p + 1], x);
            if (!(distance2 < nearest)) continue;
            nearest = distance2;
            assert_true(field_sample_at(f->patches->patch[p].field, x, FIELD_GRADIENT, &first));
        }
        assert_true(field_sample_at(f, x, FIELD_GRADIENT, &whole));
        assert_memory_equal(&whole.value, &first.value, sizeof whole.value);
        assert_memory_equal(&whole.gradient, &first.gradient, sizeof whole.gradient);
    }
    mesh_surface_free(s);
}

static vec3 flat(double u, double v)
{
    return vec3_make(u, v, 0);
}

/* A surface is extrapolated beyond its boundary, but not within. */
static void test_a_patch_is_extrapolated_beyond_its_boundary(void **state)
{
    (void)state;
    mesh_surface *s = make(mesh_fixture_sheet(3, 3, flat), MESH_PATCHES_AUTOMATIC, 0.2);
    const field *patch = mesh_surface_field(s)->patches->patch[0].field;
    static const vec3 outside[] = {{-0.1, 0.4, 0.05}, {1.2, 0.5, 0}, {-0.1, -0.2, 0.1}, {0.3, 1.0001, 0}};
    static const vec3 inside[] = {{0, 0.4, 0}, {0.5, 0.5, 0.3}, {1, 1, 0}, {0.2, 1, 0.1}};
    for (int k = 0; k < 4; k++) {
        field_sample at;
        assert_true(field_sample_at(patch, outside[k], FIELD_HESSIAN, &at));
        assert_float_equal(fabs(at.value), outside[k].z, 1e-12);
        assert_float_equal(fabs(at.gradient.z), 1, 1e-12);
        assert_float_equal(at.hessian.xx, 0, 1e-12);
        assert_true(field_is_within(patch, inside[k]));
        assert_false(field_is_within(patch, outside[k]));
    }
    mesh_surface_free(s);
}

/* The cells add up to the mesh, do not exceed their size, and belong to the patch of their triangle. */
static void test_cells(void **state)
{
    (void)state;
    const vec3 half = {1, 2, 3}, center = {4, 5, 6};
    mesh_surface *s = make(mesh_fixture_box(center, half, 0.4), MESH_PATCHES_AUTOMATIC, 0.37);
    const field *f = mesh_surface_field(s);
    double area = 0, of_patch[6] = {0};
    assert_int_equal(f->patches->count, 6);
    for (size_t k = 0; k < f->ops->cell_count(f); k++) {
        vec3 t[FIELD_CELL_TRIANGLES][3];
        field_cell cell;
        assert_int_equal(f->ops->cell_triangles(f, k, t), 1);
        f->ops->cell(f, k, &cell);
        for (int i = 0; i < 3; i++) {
            assert_true(vec3_norm(vec3_sub(t[0][i], t[0][(i + 1) % 3])) <= f->cell_size);
            assert_true(bbox_contains((bbox){cell.corner[0], cell.corner[7]}, t[0][i]));
        }
        double one = vec3_norm(vec3_cross(vec3_sub(t[0][1], t[0][0]), vec3_sub(t[0][2], t[0][0]))) / 2;
        of_patch[f->ops->patch_at(f, k, t[0][0])] += one;
        area += one;
    }
    assert_float_equal(area, 8 * (1 * 2 + 2 * 3 + 3 * 1), 1e-9);
    for (int p = 0; p < 6; p++) assert_float_equal(of_patch[p], f->patches->patch[p].area, 1e-9);
    mesh_surface_free(s);
}

/* A spacing that is far too small is refused before memory is exhausted. */
static void test_a_spacing_beyond_memory_is_refused(void **state)
{
    (void)state;
    const vec3 half = {1, 2, 3}, center = {4, 5, 6};
    const double spacing[] = {1e-3, 1e-6, 1e-20, 1e-60, 1e-300};
    for (size_t k = 0; k < sizeof spacing / sizeof *spacing; k++) {
        error e = {0};
        assert_null(try_to_make(mesh_fixture_box(center, half, 0.4), MESH_PATCHES_AUTOMATIC, spacing[k],
                                MEMORY / 64, &e));
        assert_int_equal(e.code, ERROR_LIMIT_MEMORY);
        print_message("# %s\n", e.message);
    }
}

/* The elements of one patch in cubes with several patches: those of a walk along all of them, in the same
 * order. */
static void test_elements_of_a_patch(void **state)
{
    (void)state;
    const vec3 half = {1, 2, 3}, center = {4, 5, 6};
    mesh_surface *s = make(mesh_fixture_box(center, half, 0.4), MESH_PATCHES_AUTOMATIC, 0.1);
    error e = {0};
    threads *pool = mesh_fixture_pool();
    surface *scan = surface_scan(mesh_surface_field(s), pool, &e);
    cell_samples sample;
    elements found;
    assert_non_null(scan);
    assert_true(cell_samples_take(scan, pool, &sample, &e) && elements_make(scan, &sample, 0.9, &found, &e));
    size_t shared = 0, seen = 0;
    for (uint32_t k = 0; k < found.count; k++) {
        const elements_cube at = elements_cube_of(&found, found.element[k].position);
        for (uint32_t patch = 0; patch < 6; patch++) {
            uint32_t n = elements_first_of(&found, at, 0, 0, 0, patch);
            for (uint32_t all = elements_first(&found, at, 0, 0, 0); all != BLOCK_MAP_NONE;
                 all = found.element[all].next) {
                shared += found.element[all].patch != found.element[k].patch;
                if (found.element[all].patch != patch) continue;
                assert_int_equal(n, all);
                n = found.element[n].next_of_patch;
                seen++;
            }
            assert_int_equal(n, BLOCK_MAP_NONE);
        }
    }
    assert_true(shared > 0 && seen >= found.count);
    elements_free(&found);
    cell_samples_free(&sample);
    surface_free(scan);
    mesh_surface_free(s);
}

/* Two flat pyramids with a common base, of eight triangles. Interpolated normals would rotate over whole
 * faces and be oblique near the edge. The medial axis is the common base. */
static void test_feature_sizes_use_face_normals(void **state)
{
    (void)state;
    static const vec3 corner[] = {{1, 0, 0}, {0, 1, 0}, {-1, 0, 0}, {0, -1, 0}, {0, 0, 0.3}, {0, 0, -0.3}};
    mesh m = {.vertex = malloc(sizeof corner), .vertex_count = 6};
    memcpy(m.vertex, corner, sizeof corner);
    for (uint32_t k = 0; k < 4; k++) {
        mesh_fixture_add(&m, k, (k + 1) % 4, 4);
        mesh_fixture_add(&m, (k + 1) % 4, k, 5);
    }
    mesh_surface *s = make(m, 0, 0.02);
    error e = {0};
    threads *pool = mesh_fixture_pool();
    surface *scan = surface_scan(mesh_surface_field(s), pool, &e);
    assert_non_null(scan);
    cell_samples sample;
    double *size = malloc(scan->cells * sizeof *size);
    assert_true(cell_samples_take(scan, pool, &sample, &e) &&
                feature_size_measure(scan, &sample, pool, size, &e));
    size_t wrong = 0, measured = 0;
    for (size_t k = 0; k < scan->cells; k++) {
        const double z = fabs(sample.position[k].z), upright = 1 / sqrt(1 + 2 * 0.09);
        if (z < 0.03 || z > 0.25) continue;
        measured++;
        wrong += !(fabs(size[k] * upright / z - 1) < 0.1);
    }
    print_message("# %zu of %zu sizes are wrong\n", wrong, measured);
    assert_true(measured > 1000 && wrong < measured / 50);
    free(size);
    cell_samples_free(&sample);
    surface_free(scan);
    mesh_surface_free(s);
}

/* A strip folded back over itself, so that its two sheets, which are one patch, almost touch. */
static vec3 folded(double u, double v)
{
    const double gap = 0.02, way = 2.2 * u - 1.1;
    if (fabs(way) > 0.1) return vec3_make(fabs(way), v, way < 0 ? 0 : gap);
    return vec3_make(0.1 * sin(0.5 * M_PI * fabs(way) / 0.1), v,
                     0.5 * gap * (1 + sin(0.5 * M_PI * way / 0.1)));
}

static void assert_same_sample(const field_sample *a, const field_sample *b)
{
    const sym3 *p = &a->hessian, *q = &b->hessian;
    const double size = fmax(1, fabs(q->xx) + fabs(q->yy) + fabs(q->zz));
    assert_true(fabs(a->value - b->value) < 1e-12);
    assert_true(vec3_norm(vec3_sub(a->gradient, b->gradient)) < 1e-12);
    assert_true(fabs(p->xx - q->xx) + fabs(p->yy - q->yy) + fabs(p->zz - q->zz) + fabs(p->xy - q->xy) +
                    fabs(p->xz - q->xz) + fabs(p->yz - q->yz) <
                1e-12 * size);
}

/* The distance of a place from a triangle. */
static double distance_of(const mesh_surface *s, uint32_t n, vec3 x)
{
    const uint32_t *t = mesh_surface_patches(s)->m.triangle[n];
    const vec3 *v = mesh_surface_patches(s)->m.vertex;
    const triangle of = {v[t[0]], v[t[1]], v[t[2]]};
    return sqrt(triangle_distance2(&of, x));
}

/* On a surface whose sheets are far apart, a sample with a hint is of the nearest triangle. Exception: two
 * triangles at nearly the same distance. */
static void assert_hints_change_nothing(mesh_surface *s, double off)
{
    const field *f = mesh_surface_field(s);
    const size_t triangles = mesh_surface_patches(s)->m.triangle_count;
    size_t same = 0;
    uint64_t seed = 20261123;
    uint32_t of_patch = FIELD_NO_HINT, of_all = FIELD_NO_HINT;
    for (int k = 0; k < 20 * PLACES; k++) {
        size_t cell;
        const double far = fixture_random(&seed) < 0.5 ? off : 1e-6 * off;
        const vec3 x = place_near(f, far, &seed, &cell);
        const field *patch = field_of_patch(f, f->ops->patch_at(f, cell, x)), *fields[2] = {patch, f};
        if (k % 7 == 0) of_patch = (uint32_t)(fixture_random(&seed) * (double)triangles);
        uint32_t hints[2] = {of_patch, of_all}, none;
        for (int i = 0; i < 2; i++) {
            field_sample with = {0}, without = {0};
            none = FIELD_NO_HINT;
            assert_true(field_sample_near(fields[i], x, FIELD_HESSIAN, &hints[i], &with));
            assert_true(field_sample_near(fields[i], x, FIELD_HESSIAN, &none, &without));
            assert_true(distance_of(s, hints[i], x) - distance_of(s, none, x) < 0.01 * off);
            if (hints[i] != none) continue; /* two places of the patch at nearly the same distance */
            same++;
            assert_same_sample(&with, &without);
            assert_true(field_sample_at(fields[i], x, FIELD_HESSIAN, &without));
            assert_same_sample(&with, &without);
        }
        of_patch = hints[0];
        assert_int_equal(field_is_within_near(patch, x, &of_patch), field_is_within(patch, x));
        assert_int_equal(of_patch, hints[0]);
        of_all = hints[1];
        assert_true(distance_of(s, of_all, x) <= distance_from(s, x) + 1e-12);
    }
    assert_true(same > 39 * PLACES);
    mesh_surface_free(s);
}

static void test_hints_do_not_change_results(void **state)
{
    (void)state;
    assert_hints_change_nothing(make(mesh_fixture_ball(vec3_make(1, 2, 3), 2, 3), 0, 0.2), 0.1);
    mesh box = mesh_fixture_box(vec3_make(1, 2, 3), vec3_make(1, 2, 3), 0.3);
    assert_hints_change_nothing(make(box, MESH_PATCHES_AUTOMATIC, 0.2), 0.1);
    assert_hints_change_nothing(make(mesh_fixture_sheet(60, 6, mesh_fixture_moebius), 0, 0.2), 0.05);
}

/* The hint of a cell is its triangle. */
static void test_hints_of_cells_are_their_triangles(void **state)
{
    (void)state;
    mesh_surface *s = make(mesh_fixture_ball(vec3_make(1, 2, 3), 2, 3), 0, 0.2);
    const field *f = mesh_surface_field(s);
    for (size_t k = 0; k < f->ops->cell_count(f); k++) {
        vec3 corner[FIELD_CELL_TRIANGLES][3];
        field_sample sample;
        f->ops->cell_triangles(f, k, corner);
        const vec3 middle = field_triangle_middle(corner[0]);
        const uint32_t hint = f->ops->cell_hint(f, k);
        uint32_t found = hint;
        const field *patch = field_of_patch(f, f->ops->patch_at(f, k, middle));
        assert_true(field_sample_near(patch, middle, FIELD_GRADIENT, &found, &sample));
        assert_int_equal(found, hint);
        assert_true(fabs(sample.value) < 1e-12);
    }
    mesh_surface_free(s);
}

/* Between two sheets of a patch, a sample with a hint is of the sheet of the hint, also if the other one is
 * nearer; without a hint it is of the nearest sheet. */
static void test_a_hint_stays_on_its_side_of_a_fold(void **state)
{
    (void)state;
    mesh_surface *s = make(mesh_fixture_sheet(22, 6, folded), 0, 0.2);
    const field *patch = field_of_patch(mesh_surface_field(s), 0);
    uint32_t hint = FIELD_NO_HINT, none = FIELD_NO_HINT;
    field_sample on, with, without;
    const vec3 below = {2.0 / 3, 11.0 / 18, 0}, between = {2.0 / 3, 11.0 / 18, 0.011};
    assert_true(field_sample_near(patch, below, FIELD_GRADIENT, &hint, &on));
    assert_true(field_sample_near(patch, between, FIELD_GRADIENT, &hint, &with));
    assert_true(field_sample_near(patch, between, FIELD_GRADIENT, &none, &without));
    assert_true(fabs(fabs(with.value) - 0.011) < 1e-12);
    assert_true(fabs(fabs(without.value) - 0.009) < 1e-12);
    mesh_surface_free(s);
}

static vec3 level(double u, double v)
{
    return vec3_make(u, v, 0);
}

/* A vertex of a level sheet is moved beyond its neighbours, which reverses triangles. The normals at these
 * triangles remain those of the sheet around them. */
static void test_normals_in_a_small_fold_equal_those_around_it(void **state)
{
    (void)state;
    mesh m = mesh_fixture_sheet(10, 10, level);
    size_t middle = 0, folded = 0;
    for (size_t v = 0; v < m.vertex_count; v++)
        if (vec3_norm(vec3_sub(m.vertex[v], vec3_make(0.5, 0.5, 0))) <
            vec3_norm(vec3_sub(m.vertex[middle], vec3_make(0.5, 0.5, 0))))
            middle = v;
    m.vertex[middle] = vec3_axpy(0.13, vec3_make(1, 0.2, 0.02), m.vertex[middle]);
    mesh_surface *s = make(m, 0, 0.2);
    const mesh *made = &mesh_surface_patches(s)->m;
    for (uint32_t n = 0; n < made->triangle_count; n++) {
        const vec3 *v = made->vertex, a = v[made->triangle[n][0]], b = v[made->triangle[n][1]],
                   c = v[made->triangle[n][2]], at = vec3_scale(vec3_add(a, vec3_add(b, c)), 1.0 / 3);
        if (vec3_cross(vec3_sub(b, a), vec3_sub(c, a)).z >= 0) continue;
        uint32_t hint = n;
        field_sample sample;
        assert_true(
            field_sample_near(field_of_patch(mesh_surface_field(s), 0), at, FIELD_GRADIENT, &hint, &sample));
        assert_true(fabs(sample.value) < 1e-12 && sample.gradient.z > 0.5);
        folded++;
    }
    assert_true(folded > 0);
    mesh_surface_free(s);
}

/* Patches are refined where they are curved. They still share the same sides along their curves, and the area
 * is unchanged. */
static void test_refined_patches_meet(void **state)
{
    (void)state;
    mesh dome = mesh_fixture_ball(vec3_make(0, 0, 0), 1, 1);
    for (size_t v = 0; v < dome.vertex_count; v++) dome.vertex[v].z = fmax(dome.vertex[v].z, 0.1);
    const double area = mesh_area(&dome);
    mesh_surface *s = make(dome, 0.6, 0.05);
    const mesh_patches *p = mesh_surface_patches(s);
    assert_true(p->count > 1 && p->m.triangle_count > 4 * mesh_surface_triangles(s));
    assert_true(fabs(mesh_area(&p->m) - area) < 1e-9);
    mesh joined = {0};
    mesh_edges edges = {0};
    error e = {0};
    assert_true(mesh_copy(&p->m, NULL, &joined, &e) && mesh_weld_vertices(&joined, NULL, &e));
    assert_true(mesh_edges_list(&joined, NULL, &edges, &e));
    assert_int_equal(edges.open + edges.odd, 0);
    mesh_edges_free(&edges);
    mesh_free(&joined);
    mesh_surface_free(s);
}

/* Two triangles, and between them one whose first and last vertex have the same position. */
static void a_triangle_with_two_equal_vertices_is_halved_with_its_neighbours(void **state)
{
    (void)state;
    static const vec3 vertex[] = {{0, 0, 0}, {2, 0, 0}, {1, 1, 0}, {0, 0, 0}, {1, -1, 0}};
    static const uint32_t corner[][3] = {{0, 1, 2}, {3, 1, 0}, {1, 3, 4}};
    error e = {0};
    mesh m = {5, 3, calloc(5, sizeof *m.vertex), calloc(3, sizeof *m.triangle), false};
    vec3 normal[5];
    size_t first[] = {0, 3};
    bool changed;
    uint32_t *whole = NULL;
    memcpy(m.vertex, vertex, sizeof vertex);
    memcpy(m.triangle, corner, sizeof corner);
    for (int v = 0; v < 5; v++) normal[v] = vec3_make(0.6, 0, 0.8);
    assert_true(mesh_refine(&m, normal, 1.9, 100, first, 1, &whole, &changed, NULL, &e));
    assert_true(changed);
    const uint32_t before[] = {0, 0, 1, 1, 1, 2, 2};
    assert_memory_equal(whole, before, sizeof before);
    free(whole);
    assert_int_equal(m.triangle_count, 7); /* each outer triangle has a halved side, the one between two */
    assert_int_equal(first[1], m.triangle_count);
    double area = 0;
    for (size_t n = 0; n < m.triangle_count; n++) {
        const uint32_t *t = m.triangle[n];
        for (int k = 0; k < 3; k++) assert_true(t[k] < m.vertex_count);
        area += 0.5 * vec3_norm(vec3_cross(vec3_sub(m.vertex[t[1]], m.vertex[t[0]]),
                                           vec3_sub(m.vertex[t[2]], m.vertex[t[0]])));
    }
    assert_true(fabs(area - 2) < 1e-12);
    mesh_free(&m);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_newton_ends_on_mesh),
        cmocka_unit_test(test_lanes_of_patches_equal_single_samples),
        cmocka_unit_test(test_hints_do_not_change_results),
        cmocka_unit_test(test_hints_of_cells_are_their_triangles),
        cmocka_unit_test(test_a_hint_stays_on_its_side_of_a_fold),
        cmocka_unit_test(test_normals_in_a_small_fold_equal_those_around_it),
        cmocka_unit_test(test_refined_patches_meet),
        cmocka_unit_test(test_rays_end_at_the_opposite_face),
        cmocka_unit_test(test_ball),
        cmocka_unit_test(test_a_patch_is_extrapolated_beyond_its_boundary),
        cmocka_unit_test(test_the_whole_field_equals_the_nearest_patch),
        cmocka_unit_test(test_cells),
        cmocka_unit_test(test_a_spacing_beyond_memory_is_refused),
        cmocka_unit_test(test_elements_of_a_patch),
        cmocka_unit_test(a_triangle_with_two_equal_vertices_is_halved_with_its_neighbours),
        cmocka_unit_test(test_feature_sizes_use_face_normals),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
