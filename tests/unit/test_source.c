// SPDX-License-Identifier: Apache-2.0
/* Surfaces that are opened from a spec: files, regions, combinations, offsets and transforms, and the
 * projection of points from the level set of a mesh onto its triangles.
 */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include <cmocka.h>

#include "base/core/memory.h"
#include "close.h"
#include "geometry/space/triangle.h"
#include "mesh_fixture.h"
#include "io/meshes/mesh_reader.h"
#include "job/source/mesh_projection.h"
#include "job/source/source.h"
#include "volume_fixture.h"

enum { MEMORY = 1 << 30, PLACES = 400 };

typedef struct opened {
    spec *spec;
    source source;
} opened;

static spec *read_spec(const char *member, const char *more)
{
    char text[4096];
    error e = {0};
    snprintf(text, sizeof text, "{\"version\": 1, \"surface\": %s, \"sampling\": {\"count\": 1000}%s}",
             member, more);
    json *document = json_parse(text, strlen(text), &e);
    if (!document) fail_msg("%s", e.message);
    spec *s = spec_parse(document, NULL, &e);
    if (!s) fail_msg("%s", e.message);
    json_free(document);
    return s;
}

/* Opens a surface; `member` and `more` (further members of the spec) are JSON. */
static bool try_open(const char *member, const char *more, opened *out, error *e)
{
    out->spec = read_spec(member, more);
    const source_memory_limits limits = {MEMORY, 0};
    return source_open(out->spec, NULL, NULL, &limits, isa_best(), mesh_fixture_pool(), &out->source, e);
}

static void open_surface(const char *member, const char *more, opened *out)
{
    error e = {0};
    if (!try_open(member, more, out, &e)) fail_msg("%s", e.message);
}

static void close_surface(opened *x)
{
    source_close(&x->source);
    assert_int_equal(source_memory(&x->source), 0);
    spec_free(x->spec);
}

/* Checks that the surface is refused with a message that contains `text`. */
static void assert_refused(const char *member, const char *more, error_code code, const char *text)
{
    opened x;
    error e = {0};
    assert_false(try_open(member, more, &x, &e));
    if (e.code != code || !strstr(e.message, text)) fail_msg("%d: %s", e.code, e.message);
    close_surface(&x);
}

static double distance_at(const source *s, vec3 x)
{
    field_sample at;
    assert_true(field_sample_at(source_world(s), x, FIELD_GRADIENT, &at));
    return at.value / vec3_norm(at.gradient);
}

/* Checks that F is 0 at x and that x is inside when moved against `out`. */
static void assert_on_surface(const char *member, vec3 x, vec3 out)
{
    opened o;
    open_surface(member, "", &o);
    assert_close(distance_at(&o.source, x), 0, 1e-9);
    assert_true(distance_at(&o.source, vec3_axpy(0.01, vec3_unit(out), x)) > 0);
    assert_true(distance_at(&o.source, vec3_axpy(-0.01, vec3_unit(out), x)) < 0);
    close_surface(&o);
}

/* ---- formulas */

#define SPHERE(x, r) "{\"analytic\": {\"shape\": \"sphere\", \"center\": [" #x ", 0, 0], \"radius\": " #r "}}"
#define OFFSET(by, of) "{\"offset\": {\"distance\": " #by ", \"surface\": " of "}}"
#define ANALYTIC(members) "{\"analytic\": {" members "}}"
#define BOX \
    ANALYTIC("\"shape\": \"box\", \"center\": [0, 0, 0], \"half_size\": [1, 2, 3], \"rounding\": 0.25")
#define TORUS \
    ANALYTIC("\"shape\": \"torus\", \"center\": [0, 0, 0], \"major_radius\": 2, \"minor_radius\": 0.5")
#define CYLINDER \
    ANALYTIC(    \
        "\"shape\": \"cylinder\", \"center\": [0, 0, 0], \"radius\": 1, \"height\": 4, \"rounding\": 0.1")
#define CAPSULE ANALYTIC("\"shape\": \"capsule\", \"center\": [0, 0, 0], \"radius\": 1, \"height\": 4")
#define CONE \
    ANALYTIC("\"shape\": \"cone\", \"center\": [0, 0, 0], \"radius\": 1, \"top_radius\": 0.5, \"height\": 4")

static void formulas_have_their_dimensions(void **state)
{
    (void)state;
    const vec3 x = {1, 0, 0}, z = {0, 0, 1};
    assert_on_surface(SPHERE(1, 2), vec3_make(3, 0, 0), x);
    assert_on_surface(TORUS, vec3_make(2.5, 0, 0), x);
    assert_on_surface(BOX, vec3_make(1, 0, 0), x);
    assert_on_surface(BOX, vec3_make(0, 0, 3), z);
    assert_on_surface(CYLINDER, vec3_make(1, 0, 0), x);
    assert_on_surface(CYLINDER, vec3_make(0, 0, 2), z);
    assert_on_surface(CAPSULE, vec3_make(1, 0, 0), x);
    assert_on_surface(CAPSULE, vec3_make(0, 0, 3), z);
    assert_on_surface(CONE, vec3_make(0.9, 0, -2), vec3_make(0, 0, -1));
}

static void offset_moves_formulas_outwards(void **state)
{
    (void)state;
    const vec3 x = {1, 0, 0}, z = {0, 0, 1};
    assert_on_surface(OFFSET(0.5, SPHERE(1, 2)), vec3_make(3.5, 0, 0), x);
    assert_on_surface(OFFSET(-0.5, SPHERE(1, 2)), vec3_make(2.5, 0, 0), x);
    assert_on_surface(OFFSET(0.25, TORUS), vec3_make(2.75, 0, 0), x);
    assert_on_surface(OFFSET(0.5, BOX), vec3_make(0, 0, 3.5), z);
    /* rounding increases with the offset: the sphere of radius 0.75 at the corner is centred at (0.75,
     * 1.75, 2.75) */
    assert_on_surface(OFFSET(0.5, BOX),
                      vec3_axpy(0.75 / sqrt(3), vec3_make(1, 1, 1), vec3_make(0.75, 1.75, 2.75)),
                      vec3_make(1, 1, 1));
    assert_on_surface(OFFSET(0.5, CYLINDER), vec3_make(0, 0, 2.5), z);
    assert_on_surface(OFFSET(-0.5, CYLINDER), vec3_make(0.5, 0, 0), x);
    assert_on_surface(OFFSET(-0.5, CYLINDER), vec3_make(0, 0, 1.5), z);
    assert_on_surface(OFFSET(0.5, OFFSET(-0.25, SPHERE(0, 1))), vec3_make(1.25, 0, 0), x);
}

static void offset_is_refused_where_nothing_is_left_or_there_is_no_distance(void **state)
{
    (void)state;
    assert_refused(OFFSET(-1, SPHERE(0, 1)), "", ERROR_NO_SURFACE, "removes the whole shape");
    assert_refused(OFFSET(-1, BOX), "", ERROR_NO_SURFACE, "removes the whole shape");
    assert_refused(OFFSET(-1.5, CYLINDER), "", ERROR_NO_SURFACE, "removes the whole shape");
    assert_refused(OFFSET(1.5, TORUS), "", ERROR_NOT_SUPPORTED, "closes the hole");
    assert_refused(OFFSET(0.1, ANALYTIC("\"shape\": \"ellipsoid\", \"radii\": [1, 2, 3]")), "",
                   ERROR_NOT_SUPPORTED, "offset requires distances");
    assert_refused(
        OFFSET(0.1, "{\"transform\": {\"matrix\": [2,0,0,0, 0,1,0,0, 0,0,1,0, 0,0,0,1], \"surface\": " SPHERE(
                        0, 1) "}}"),
        "", ERROR_NOT_SUPPORTED, "does not preserve");
}

/* A difference of solids: the offset enlarges the first and shrinks the second. */
static void offset_of_a_difference_shrinks_what_is_subtracted(void **state)
{
    (void)state;
    const char *cut =
        OFFSET(0.25, "{\"difference\": [" SPHERE(0, 2) ", " ANALYTIC(
                         "\"shape\": \"halfspace\", \"center\": [0, 0, 0], \"axis\": [-1, 0, 0]") "]}");
    opened x;
    open_surface(cut, "", &x);
    assert_close(distance_at(&x.source, vec3_make(-2.25, 0, 0)), 0, 1e-9);
    assert_close(distance_at(&x.source, vec3_make(0.25, 0, 0)), 0, 1e-9);
    assert_true(distance_at(&x.source, vec3_make(0.2, 0, 0)) < 0 &&
                distance_at(&x.source, vec3_make(0.3, 0, 0)) > 0);
    close_surface(&x);
}

#define TWICE "{\"transform\": {\"matrix\": [0,-2,0,5, 2,0,0,0, 0,0,2,0, 0,0,0,1], \"surface\": "

static void transform_moves_and_scales_a_surface_and_its_offset(void **state)
{
    (void)state;
    /* a rotation about z by a right angle, a scale of two, and a translation of 5 along x */
    assert_on_surface(TWICE SPHERE(1, 0.5) "}}", vec3_make(5, 3, 0), vec3_make(0, 1, 0));
    assert_on_surface(OFFSET(0.5, TWICE SPHERE(1, 0.5) "}}"), vec3_make(5, 3.5, 0), vec3_make(0, 1, 0));
}

static void empty_operands_are_left_out_where_the_rest_is_defined(void **state)
{
    (void)state;
    opened x;
    const char *empty = OFFSET(-1, SPHERE(0, 1));
    char text[1024];
    snprintf(text, sizeof text, "{\"union\": [%s, " SPHERE(3, 1) "]}", empty);
    open_surface(text, "", &x);
    assert_close(distance_at(&x.source, vec3_make(4, 0, 0)), 0, 1e-9);
    assert_non_null(x.source.whole.parts[0].nothing);
    assert_non_null(strstr(x.source.whole.parts[0].nothing, "/surface/union/0"));
    assert_null(x.source.whole.parts[1].nothing);
    assert_int_equal(source_part_at(&x.source, vec3_make(4, 0, 0)), 1);
    close_surface(&x);
    snprintf(text, sizeof text, "{\"difference\": [%s, " SPHERE(3, 1) "]}", empty);
    assert_refused(text, "", ERROR_NO_SURFACE, "/surface/difference/0");
    snprintf(text, sizeof text, "{\"intersection\": [" SPHERE(3, 1) ", %s]}", empty);
    assert_refused(text, "", ERROR_NO_SURFACE, "/surface/intersection/1");
}

static void points_belong_to_the_nearest_part(void **state)
{
    (void)state;
    opened x;
    open_surface("{\"union\": [" SPHERE(0, 1) ", " SPHERE(4, 1) ", " SPHERE(8, 1) "]}", "", &x);
    assert_int_equal(source_part_count(&x.source), 3);
    assert_int_equal(source_part_at(&x.source, vec3_make(-1, 0, 0)), 0);
    assert_int_equal(source_part_at(&x.source, vec3_make(4, 1, 0)), 1);
    assert_int_equal(source_part_at(&x.source, vec3_make(9, 0, 0)), 2);
    assert_false(mesh_projection_find(&x.source, &(mesh_projection){{0}, NULL}));
    assert_null(source_mesh(&x.source));
    assert_true(source_memory(&x.source) > 0);
    close_surface(&x);
    /* a transform of a union has its components, in its space */
    open_surface(TWICE "{\"union\": [" SPHERE(0, 1) ", " SPHERE(3, 1) "]}}}", "", &x);
    assert_int_equal(source_part_count(&x.source), 2);
    assert_int_equal(source_part_at(&x.source, vec3_make(5, -2, 0)), 0);
    assert_int_equal(source_part_at(&x.source, vec3_make(5, 8, 0)), 1);
    close_surface(&x);
    open_surface(SPHERE(0, 1), "", &x);
    assert_int_equal(source_part_count(&x.source), 1);
    assert_int_equal(source_part_at(&x.source, vec3_make(1, 0, 0)), 0);
    assert_false(source_starts_in_cells(&x.source));
    close_surface(&x);
}

static void region_cuts_the_surface(void **state)
{
    (void)state;
    opened x;
    error e = {0};
    open_surface(SPHERE(0, 1), ", \"region\": {\"min\": [0, -2, -2], \"max\": [2, 2, 2]}", &x);
    assert_true(x.source.field->open && x.source.region);
    assert_close(x.source.field->boundary_box.min.x, 0, 0);
    surface *scan = surface_scan(x.source.field, mesh_fixture_pool(), &e);
    assert_non_null(scan);
    assert_close(scan->area, 2 * M_PI, 1e-3);
    const bbox box = source_box(&x.source, scan);
    assert_close(box.min.x, 0, 1e-6);
    assert_close(box.max.x, 1, 1e-3);
    assert_true(source_world(&x.source) == x.source.field);
    surface_free(scan);
    close_surface(&x);
}

/* ---- meshes */

static const vec3 CENTER = {0.3, -0.2, 0.1};

static void write_mesh(const char *name, const mesh *m)
{
    size_t bytes;
    char *text = mesh_fixture_print(m, "obj", &bytes);
    FILE *file = fopen(name, "w");
    assert_non_null(file);
    assert_int_equal(fwrite(text, 1, bytes, file), bytes);
    assert_int_equal(fclose(file), 0);
    free(text);
}

static const char *mesh_json(const char *name, const char *more)
{
    static char text[2][640];
    static int turn;
    turn = !turn;
    snprintf(text[turn], sizeof text[turn], "{\"mesh\": {\"path\": \"%s\"%s}}", name, more);
    return text[turn];
}

static const char VOXELS[] = ", \"resolution\": 32";

static opened level_set_of_ball; /* shared by tests: a mesh is read in a separate process */

static mesh make_ball(void)
{
    return mesh_fixture_ball(CENTER, 1, 2);
}

static double distance_from(const mesh *m, vec3 x)
{
    double best = INFINITY;
    for (size_t k = 0; k < m->triangle_count; k++) {
        const uint32_t *t = m->triangle[k];
        const triangle at = {m->vertex[t[0]], m->vertex[t[1]], m->vertex[t[2]]};
        best = fmin(best, triangle_distance2(&at, x));
    }
    return sqrt(best);
}

static vec3 random_direction(uint64_t *seed)
{
    for (;;) {
        const vec3 v = {2 * fixture_random(seed) - 1, 2 * fixture_random(seed) - 1,
                        2 * fixture_random(seed) - 1};
        if (vec3_norm(v) < 1 && vec3_norm(v) > 0.1) return vec3_unit(v);
    }
}

static void move(const opened *x, vec3 *place, double spacing, size_t count, double *largest)
{
    error e = {0};
    mesh_projection l;
    double *spacings = malloc(count * sizeof *spacings);
    for (size_t i = 0; i < count; i++) spacings[i] = spacing;
    assert_true(mesh_projection_find(&x->source, &l));
    if (!mesh_projection_apply(&l, place, spacings, count, mesh_fixture_pool(), largest, &e))
        fail_msg("%s", e.message);
    free(spacings);
}

static void places_go_onto_the_nearest_triangles(void **state)
{
    (void)state;
    enum { MANY = 2500 }; /* more than one chunk of work */
    const opened x = level_set_of_ball;
    mesh ball = make_ball();
    vec3 place[MANY], before[MANY];
    uint64_t seed = 3;
    double largest = -1, moved = 0;
    for (int i = 0; i < MANY; i++) {
        const double off = i == 77 ? 0.03 : 0.02 * (2 * fixture_random(&seed) - 1);
        before[i] = place[i] = vec3_axpy(1 + off, random_direction(&seed), CENTER);
    }
    move(&x, place, 1e-4, MANY, &largest);
    for (int i = 0; i < MANY; i++) {
        const double way = vec3_norm(vec3_sub(place[i], before[i]));
        moved = fmax(moved, way);
        if (i % 5 > 0) continue;
        assert_true(distance_from(&ball, place[i]) < 1e-9);
        assert_true(way < distance_from(&ball, before[i]) + 1e-9);
    }
    assert_close(largest, moved, 1e-12);
    mesh_free(&ball);
}

/* F of the mesh projection is the distance from the triangles, and its gradient a unit vector away from
 * them. */
static void mesh_projection_field_is_the_distance_from_the_triangles(void **state)
{
    (void)state;
    const opened x = level_set_of_ball;
    mesh_projection l;
    mesh ball = make_ball();
    uint64_t seed = 4;
    assert_true(mesh_projection_find(&x.source, &l));
    for (int i = 0; i < 50; i++) {
        const double off = 0.05 * (2 * fixture_random(&seed) - 1);
        const vec3 at = vec3_axpy(1 + off, random_direction(&seed), CENTER);
        field_sample s;
        assert_true(field_sample_at(&l.base, at, FIELD_GRADIENT, &s));
        assert_close(s.value, distance_from(&ball, at), 1e-9);
        assert_close(vec3_norm(s.gradient), 1, 1e-9);
        assert_true(distance_from(&ball, vec3_axpy(-s.value, s.gradient, at)) < 1e-9);
    }
    mesh_free(&ball);
}

static void places_that_coincide_are_moved_apart(void **state)
{
    (void)state;
    const opened x = level_set_of_ball;
    mesh ball = make_ball();
    uint64_t seed = 5;
    double largest;
    const double spacing = 0.1;
    /* pairs on one ray, at different distances from the triangles */
    vec3 place[12];
    for (int i = 0; i < 12; i += 2) {
        const vec3 out = random_direction(&seed);
        place[i] = vec3_axpy(1.03, out, CENTER);
        place[i + 1] = i < 6 ? place[i] : vec3_axpy(0.97, out, CENTER);
    }
    move(&x, place, spacing, 12, &largest);
    assert_true(largest < 0.05); /* of the projections onto the triangles only */
    for (int i = 0; i < 12; i++) {
        assert_true(distance_from(&ball, place[i]) < 1e-9);
        for (int j = 0; j < i; j++) assert_true(vec3_norm(vec3_sub(place[i], place[j])) > 0.5 * spacing);
    }
    for (int i = 0; i < 12; i += 2) assert_true(vec3_norm(vec3_sub(place[i], place[i + 1])) < 0.7 * spacing);
    /* projected points more than 0.55 spacings apart are not moved further; nearer ones are */
    const vec3 out = random_direction(&seed), side = vec3_unit(vec3_cross(out, vec3_make(0.3, 0.8, -0.2)));
    for (int near = 0; near < 2; near++) {
        vec3 two[2], alone[2];
        for (int k = 0; k < 2; k++) {
            const vec3 way = vec3_unit(vec3_axpy((near ? 0.03 : 0.08) * k, side, out));
            alone[k] = two[k] = vec3_axpy(1.03, way, CENTER);
            move(&x, &alone[k], spacing, 1, &largest);
        }
        move(&x, two, spacing, 2, &largest);
        assert_true(vec3_norm(vec3_sub(two[0], two[1])) > 0.5 * spacing);
        for (int k = 0; k < 2; k++) assert_int_equal(vec3_norm(vec3_sub(two[k], alone[k])) > 1e-12, near);
        /* points that move by less than a tenth of their spacing are not moved further, either */
        two[1] = two[0];
        move(&x, two, spacing, 2, &largest);
        assert_true(largest < 1e-6);
        assert_true(vec3_norm(vec3_sub(two[0], two[1])) == 0);
    }
    mesh_free(&ball);
}

static void places_on_a_face_of_the_region_stay_on_it(void **state)
{
    (void)state;
    opened x;
    mesh ball = make_ball();
    double largest;
    vec3 place[PLACES];
    uint64_t seed = 6;
    open_surface(mesh_json("ball.obj", VOXELS),
                 ", \"region\": {\"min\": [0.2, -3, -3], \"max\": [0.9, 3, 3]}", &x);
    for (int i = 0; i < PLACES; i++) {
        const double at = i % 3 == 0   ? 0.2
                          : i % 3 == 1 ? 0.9
                                       : 0.21 + 0.68 * fixture_random(&seed),
                     turn = 2 * M_PI * fixture_random(&seed), off = at - CENTER.x,
                     ring = sqrt(1 - off * off) + 0.01 * (2 * fixture_random(&seed) - 1);
        place[i] = vec3_make(at, CENTER.y + ring * cos(turn), CENTER.z + ring * sin(turn));
    }
    move(&x, place, 1e-4, PLACES, &largest);
    for (int i = 0; i < PLACES; i++) {
        assert_true(distance_from(&ball, place[i]) < 1e-8);
        if (i % 3 < 2) assert_close(place[i].x, i % 3 == 0 ? 0.2 : 0.9, 0);
        assert_true(place[i].x >= 0.2 && place[i].x <= 0.9);
    }
    mesh_free(&ball);
    close_surface(&x);
}

static void places_of_a_transformed_mesh_go_onto_its_triangles(void **state)
{
    (void)state;
    opened x;
    mesh ball = make_ball();
    double largest;
    vec3 place[PLACES];
    uint64_t seed = 7;
    char text[1024];
    snprintf(text, sizeof text, TWICE "%s}}", mesh_json("ball.obj", VOXELS));
    open_surface(text, "", &x);
    for (size_t k = 0; k < ball.vertex_count; k++) {
        const vec3 v = ball.vertex[k];
        ball.vertex[k] = vec3_make(5 - 2 * v.y, 2 * v.x, 2 * v.z);
    }
    const vec3 center = {5 - 2 * CENTER.y, 2 * CENTER.x, 2 * CENTER.z};
    for (int i = 0; i < PLACES; i++)
        place[i] = vec3_axpy(2 + 0.04 * (2 * fixture_random(&seed) - 1), random_direction(&seed), center);
    move(&x, place, 1e-4, PLACES, &largest);
    for (int i = 0; i < PLACES; i++) assert_true(distance_from(&ball, place[i]) < 1e-8);
    mesh_free(&ball);
    close_surface(&x);
}

/* In a union the points of the mesh are projected onto its triangles, and points of the formula keep their
 * positions, also beside the edge where both meet. */
static void places_of_other_parts_stay(void **state)
{
    (void)state;
    opened x;
    mesh_projection l;
    mesh ball = make_ball();
    double largest;
    uint64_t seed = 8;
    char text[1024];
    const vec3 center = {2, 0, 0};
    snprintf(text, sizeof text, "{\"union\": [%s, " SPHERE(2, 1) "]}", mesh_json("ball.obj", VOXELS));
    open_surface(text, "", &x);
    assert_true(mesh_projection_find(&x.source, &l));
    vec3 place[20], before[20], out[20];
    for (int i = 0; i < 20; i++) {
        double clearance; /* from the other component */
        do {
            out[i] = random_direction(&seed);
            place[i] = i % 2 ? vec3_axpy(1.005, out[i], center) : vec3_axpy(1.005, out[i], CENTER);
            clearance =
                i % 2 ? vec3_norm(vec3_sub(place[i], CENTER)) - 1 : vec3_norm(vec3_sub(place[i], center)) - 1;
        } while (!(clearance > 0.03 && (i > 9 || clearance < 0.15)));
        before[i] = place[i];
    }
    move(&x, place, 1e-4, 20, &largest);
    for (int i = 0; i < 20; i++) {
        field_sample s;
        if (i % 2 == 0) {
            assert_true(distance_from(&ball, place[i]) < 1e-9);
            continue;
        }
        assert_true(vec3_norm(vec3_sub(place[i], before[i])) == 0);
        /* F of the mesh projection is the distance from the nearest of both */
        assert_true(field_sample_at(&l.base, place[i], FIELD_GRADIENT, &s));
        assert_close(s.value, 0.005, 1e-6);
        assert_close(vec3_dot(s.gradient, out[i]), 1, 1e-6);
    }
    mesh_free(&ball);
    close_surface(&x);
}

/* If two balls of one mesh overlap, the triangles inside are hidden and receive no points. F of the mesh
 * projection is the distance from all triangles. */
static void hidden_triangles_receive_no_places(void **state)
{
    (void)state;
    opened x;
    mesh_projection l;
    double largest;
    uint64_t seed = 9;
    field_sample s;
    mesh both = make_ball();
    const vec3 other = vec3_add(CENTER, vec3_make(1, 0, 0));
    mesh_fixture_append(&both, mesh_fixture_ball(other, 1, 2));
    open_surface(mesh_json("both.obj", VOXELS), "", &x);
    assert_true(mesh_projection_find(&x.source, &l));
    const vec3 hidden = vec3_add(CENTER, vec3_make(0.95, 0.02, 0));
    assert_true(field_sample_at(&l.base, hidden, FIELD_GRADIENT, &s));
    assert_close(s.value, distance_from(&both, hidden), 1e-9);
    assert_true(s.value < 0.06);
    vec3 place[100];
    for (int i = 0; i < 100; i++) /* beside the circle where the balls meet */
        do place[i] = vec3_axpy(1 + 0.02 * (fixture_random(&seed) - 0.5), random_direction(&seed), CENTER);
        while (!(fabs(vec3_norm(vec3_sub(place[i], other)) - 1.04) < 0.04));
    move(&x, place, 1e-4, 100, &largest);
    for (int i = 0; i < 100; i++) {
        assert_true(distance_from(&both, place[i]) < 1e-9);
        assert_true(vec3_norm(vec3_sub(place[i], other)) > 0.96 &&
                    vec3_norm(vec3_sub(place[i], CENTER)) > 0.96);
    }
    mesh_free(&both);
    close_surface(&x);
}

static void only_meshes_of_level_sets_have_a_mesh_projection(void **state)
{
    (void)state;
    opened x;
    mesh_projection l = {{0}, NULL};
    char text[512];
    snprintf(text, sizeof text, "%s, \"on_mesh\": false", VOXELS);
    open_surface(mesh_json("ball.obj", text), "", &x);
    assert_false(mesh_projection_find(&x.source, &l));
    assert_null(l.source);
    close_surface(&x);
    open_surface(mesh_json("box.obj", ", \"features\": {}"), "", &x); /* sampled on its triangles */
    assert_false(mesh_projection_find(&x.source, &l));
    assert_non_null(source_mesh(&x.source));
    assert_true(source_closed_mesh(&x.source) == source_mesh(&x.source));
    close_surface(&x);
    open_surface(mesh_json("sheet.obj", ""), "", &x);
    assert_non_null(source_mesh(&x.source));
    assert_null(source_closed_mesh(&x.source));
    close_surface(&x);
}

static void stopped_pool_cancels_the_mesh_projection(void **state)
{
    (void)state;
    const opened x = level_set_of_ball;
    mesh_projection l;
    error e = {0};
    volatile sig_atomic_t stop = 1;
    vec3 place = vec3_add(CENTER, vec3_make(1.01, 0, 0));
    double spacing = 1, largest;
    threads *pool = threads_new(1, &stop, &e);
    assert_true(mesh_projection_find(&x.source, &l));
    assert_false(mesh_projection_apply(&l, &place, &spacing, 1, pool, &largest, &e));
    assert_int_equal(e.code, ERROR_CANCELLED);
    threads_free(pool);
}

/* ---- files */

static void each_input_is_listed_once_with_its_hash(void **state)
{
    (void)state;
    opened x;
    open_surface(mesh_json("ball.obj", VOXELS), "", &x);
    const char *names[] = {"ball.obj", "box.obj", "ball.obj", "box.obj"};
    for (int k = 0; k < 4; k++) {
        error e = {0};
        const int fd = source_open_file(&x.source, names[k], &e);
        assert_true(fd >= 0);
        close(fd);
    }
    assert_int_equal(x.source.input_count, 2);
    for (int k = 0; k < 2; k++) {
        char hex[STORE_HASH_SIZE];
        size_t count;
        error e = {0};
        char *bytes = store_file_read(names[k], 1 << 20, &count, &e);
        assert_non_null(bytes);
        store_hash(bytes, count, hex);
        assert_string_equal(x.source.inputs[k].path, names[k]);
        assert_string_equal(x.source.inputs[k].facts.sha256, hex);
        assert_int_equal(x.source.inputs[k].facts.bytes, count);
        free(bytes);
    }
    assert_true(source_starts_in_cells(&x.source));
    close_surface(&x);
    assert_refused(mesh_json("missing.obj", ""), "", ERROR_INPUT_MISSING, "missing.obj");
}

/* The tests run in a separate directory, whose path is their state. */
static int make_files(void **state)
{
    char *directory = mem_strdup("/tmp/hexad-test-source-XXXXXX");
    *state = directory;
    if (!mkdtemp(directory) || chdir(directory) != 0) return 1;
    mesh ball = make_ball(), box = mesh_fixture_box(vec3_make(3, 0, 0), vec3_make(0.5, 0.5, 0.5), 0.3),
         sheet = make_ball();
    mesh_fixture_remove(&sheet, 5);
    write_mesh("ball.obj", &ball);
    mesh both = make_ball();
    mesh_fixture_append(&both, mesh_fixture_ball(vec3_add(CENTER, vec3_make(1, 0, 0)), 1, 2));
    write_mesh("both.obj", &both);
    mesh_free(&both);
    write_mesh("box.obj", &box);
    write_mesh("sheet.obj", &sheet);
    mesh_free(&ball);
    mesh_free(&box);
    mesh_free(&sheet);
    open_surface(mesh_json("ball.obj", VOXELS), "", &level_set_of_ball);
    return 0;
}

static int remove_files(void **state)
{
    char *directory = *state;
    error e = {0};
    close_surface(&level_set_of_ball);
    const bool removed = store_remove(directory, &e);
    free(directory);
    return removed ? 0 : 1;
}

int main(int argc, char **argv)
{
    /* the program is its own reader of meshes */
    if (argc > 2 && strcmp(argv[1], MESH_READER_COMMAND) == 0) return mesh_reader_main(argc - 1, argv + 1);
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(formulas_have_their_dimensions),
        cmocka_unit_test(offset_moves_formulas_outwards),
        cmocka_unit_test(offset_is_refused_where_nothing_is_left_or_there_is_no_distance),
        cmocka_unit_test(offset_of_a_difference_shrinks_what_is_subtracted),
        cmocka_unit_test(transform_moves_and_scales_a_surface_and_its_offset),
        cmocka_unit_test(empty_operands_are_left_out_where_the_rest_is_defined),
        cmocka_unit_test(points_belong_to_the_nearest_part),
        cmocka_unit_test(region_cuts_the_surface),
        cmocka_unit_test(places_go_onto_the_nearest_triangles),
        cmocka_unit_test(mesh_projection_field_is_the_distance_from_the_triangles),
        cmocka_unit_test(places_that_coincide_are_moved_apart),
        cmocka_unit_test(places_on_a_face_of_the_region_stay_on_it),
        cmocka_unit_test(places_of_a_transformed_mesh_go_onto_its_triangles),
        cmocka_unit_test(places_of_other_parts_stay),
        cmocka_unit_test(hidden_triangles_receive_no_places),
        cmocka_unit_test(only_meshes_of_level_sets_have_a_mesh_projection),
        cmocka_unit_test(stopped_pool_cancels_the_mesh_projection),
        cmocka_unit_test(each_input_is_listed_once_with_its_hash),
    };
    return cmocka_run_group_tests_name("source", tests, make_files, remove_files);
}
