// SPDX-License-Identifier: Apache-2.0
/* preview: pixels against geometry, files against pixels, colours, legend, degenerate sets. */
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

#include "io/points/half.h"
#include "io/pictures/legend.h"
#include "io/pictures/preview.h"
#include "io/pictures/preview_exr.h"
#include "io/points/quantity.h"
#include "io/pictures/picture_png.h"
#include "picture_readers.h"
#include "point_set.h"

/* The contents at the centre of a pixel. */
typedef struct preview_sample {
    /* index of the point plus one; 0: background, then the rest is 0 and depth is PREVIEW_FAR */
    uint32_t id;
    float depth;           /* along the camera's axis, world units */
    vec3 position;         /* on the disc, world space */
    vec3 normal;           /* of the disc */
    double kappa, spacing; /* kappa and achieved spacing of the point */
} preview_sample;

static preview_sample preview_at(const image *m, int x, int y)
{
    preview_span s = preview_span_at(m, x, y);
    if (s.id == 0) return (preview_sample){.depth = PREVIEW_FAR};
    vec3 p = preview_place(m, &s, x, y);
    return (preview_sample){s.id, (float)p.z, camera_to_world(&m->camera, p), s.normal, s.kappa, s.spacing};
}

static image *render_options(const points *set, const preview_options *options, int workers)
{
    error e = {0};
    image *m = NULL;
    threads *pool = threads_new(workers, NULL, &e);
    if (!pool || !preview_render(set, options, pool, &m, &e)) fail_msg("%s", e.message);
    threads_free(pool);
    return m;
}

static image *render_with(const points *set, int width, int height, quantity which, int workers)
{
    const preview_options options = {.width = width, .height = height, .color = {.which = which}};
    return render_options(set, &options, workers);
}

static image *render(const points *set, int width, int height, quantity which)
{
    return render_with(set, width, height, which, 1);
}

static void refuse(const points *set, int width, int height, const char *words)
{
    error e = {0};
    image *m = NULL;
    preview_options options = {.width = width, .height = height, .color = {.which = QUANTITY_CURVATURE}};
    threads *pool = threads_new(1, NULL, &e);
    assert_false(preview_render(set, &options, pool, &m, &e));
    threads_free(pool);
    assert_null(m);
    if (!strstr(e.message, words)) fail_msg("'%s' does not say '%s'", e.message, words);
}

static vec3 eye_of(const camera *c)
{
    return camera_to_world(c, vec3_make(0, 0, 0));
}

static size_t count_covered(const image *m)
{
    size_t n = 0;
    for (int y = 0; y < m->height; y++)
        for (int x = 0; x < m->width; x++) n += preview_at(m, x, y).id != 0;
    return n;
}

/* Checks the centres of visible discs: their positions, depths and all members. Returns their number. */
static int check_discs(const point_set *s, const image *m)
{
    vec3 eye = eye_of(&m->camera);
    int checked = 0;
    for (size_t i = 0; i < s->points.count; i++) {
        vec3 q = camera_point(&m->camera, s->position[i]), towards = vec3_unit(vec3_sub(eye, s->position[i]));
        if (m->camera.parallel) towards = vec3_scale(m->camera.forward, -1);
        double at_x, at_y;
        camera_project(&m->camera, q, &at_x, &at_y);
        bool within = at_x >= 0 && at_x < m->width && at_y >= 0 && at_y < m->height;
        if (vec3_dot(towards, s->normal[i]) < 0.3 || !within || q.z < 2 * m->radius_max) continue;
        int x = (int)floor(at_x), y = (int)floor(at_y);
        preview_sample p = preview_at(m, x, y);
        assert_int_equal(p.id, i + 1);
        vec3 from_center = vec3_sub(p.position, s->position[i]), ray = vec3_sub(p.position, eye);
        assert_true(fabs(vec3_dot(from_center, s->normal[i])) < 1e-9);
        assert_true(vec3_norm(from_center) < 0.5 * s->points.spacing_local[i]);
        assert_true(vec3_norm(vec3_sub(p.normal, s->normal[i])) == 0);
        assert_true(fabs((double)p.depth - vec3_dot(ray, m->camera.forward)) < 1e-5);
        camera_project(&m->camera, camera_point(&m->camera, p.position), &at_x, &at_y);
        assert_true(fabs(at_x - x - 0.5) < 1e-6 && fabs(at_y - y - 0.5) < 1e-6);
        assert_true(p.kappa == s->points.kappa[i] && p.spacing == s->points.spacing_local[i]);
        checked++;
    }
    return checked;
}

static void test_pixels_are_the_discs(void **state)
{
    (void)state;
    static const camera_place places[] = {
        {.position = {17, -25, 32}, .target = {10, -20, 30}, .up = {0, 0, 1}, .fov = 0.7},
        {.position = {17, -25, 32}, .target = {10, -20, 30}, .up = {0, 1, 1}, .span = 4.5},
        {.position = {11.5, -20, 30}, .target = {10, -20.5, 30}, .up = {0, 0, 1}, .fov = 2}, /* inside */
        {.position = {10, -20, 30}, .target = {10, -20.5, 40}, .up = {0, 1, 0}, .span = 1},
    };
    point_set s = point_set_sphere(400, vec3_make(10, -20, 30), 2);
    for (int k = -1; k < 4; k++) {
        if (k == 2) /* the view is from inside the sphere */
            for (size_t i = 0; i < s.points.count; i++) s.normal[i] = vec3_scale(s.normal[i], -1);
        const preview_options options = {.width = 640,
                                         .height = 480,
                                         .color = {.which = QUANTITY_CURVATURE},
                                         .camera = k < 0 ? NULL : &places[k]};
        image *m = render_options(&s.points, &options, 1);
        int checked = check_discs(&s, m);
        if (checked < (k < 2 ? 100 : 4)) fail_msg("camera %d sees %d discs", k, checked);
        if (k < 2) {
            preview_sample none = preview_at(m, 0, 0);
            assert_true(none.id == 0 && none.depth == PREVIEW_FAR && none.kappa == 0 &&
                        vec3_norm(none.position) == 0);
        }
        preview_free(m);
    }
    preview_free(NULL);
    point_set_free(&s);
}

/* A camera that looks away has an empty picture. */
static void test_points_behind_the_camera_are_not_drawn(void **state)
{
    (void)state;
    point_set s = point_set_sphere(400, vec3_make(0, 0, 0), 1);
    for (int k = 0; k < 2; k++) {
        const camera_place away = {{0, -3, 0}, {0, -4, 0}, {0, 0, 1}, 0, k};
        const preview_options options = {
            .width = 100, .height = 100, .color = {.which = QUANTITY_ENERGY}, .camera = &away};
        image *m = render_options(&s.points, &options, 1);
        assert_int_equal(count_covered(m), 0);
        preview_free(m);
    }
    point_set_free(&s);
}

/* A rotated set with up = y gives the same picture as the original set with up = z. */
static void test_up_axis_y_equals_a_rotated_set(void **state)
{
    (void)state;
    point_set stands = point_set_sphere(800, vec3_make(0, 0, 0), 1),
              lies = point_set_sphere(800, vec3_make(0, 0, 0), 1);
    for (size_t i = 0; i < stands.points.count; i++) {
        vec3 x = stands.position[i], n = stands.normal[i];
        x.z *= 3;
        stands.position[i] = x;
        lies.position[i] = vec3_make(x.x, x.z, -x.y);
        lies.normal[i] = vec3_make(n.x, n.z, -n.y);
    }
    preview_options options = {.width = 200, .height = 200, .color = {.which = QUANTITY_CURVATURE}};
    image *one = render_options(&stands.points, &options, 1);
    options.y_up = true;
    image *other = render_options(&lies.points, &options, 1);
    int differ = 0;
    for (size_t k = 0; k < 3 * 200 * 200; k++) differ += abs(one->rgb[k] - other->rgb[k]) > 2;
    assert_in_range(differ, 0, 200); /* rounding at outlines */
    preview_free(one);
    preview_free(other);
    point_set_free(&stands);
    point_set_free(&lies);
}

/* Points that do not resolve the surface have discs of half the size. */
static void test_discs_of_thin_walls_are_smaller(void **state)
{
    (void)state;
    point_set s = point_set_sphere(400, vec3_make(0, 0, 0), 1);
    preview_options options = {.width = 300, .height = 300, .color = {.which = QUANTITY_CURVATURE}};
    image *whole = render_options(&s.points, &options, 1);
    options.thin = true;
    image *loose = render_options(&s.points, &options, 1);
    assert_true(count_covered(loose) < count_covered(whole) * 3 / 4);
    preview_free(whole);
    preview_free(loose);
    point_set_free(&s);
}

/* The fraction of the pixels of a sphere, seen from the front, that show the bodies below the discs. */
static double share_of_gaps(size_t count)
{
    point_set s = point_set_sphere(count, vec3_make(0, 0, 0), 1);
    image *m = render(&s.points, 256, 256, QUANTITY_CURVATURE);
    const vec3 towards = vec3_unit(eye_of(&m->camera));
    size_t discs = 0, gaps = 0;
    for (int y = 0; y < m->height; y++)
        for (int x = 0; x < m->width; x++) {
            preview_sample p = preview_at(m, x, y);
            if (p.id == 0 || vec3_dot(vec3_unit(p.position), towards) < 0.8) continue;
            const vec3 off = vec3_sub(p.position, s.position[p.id - 1]);
            (*(fabs(vec3_dot(off, p.normal)) < 1e-9 ? &discs : &gaps))++;
        }
    preview_free(m);
    point_set_free(&s);
    assert_true(discs + gaps > 1000);
    return (double)gaps / (double)(discs + gaps);
}

/* Circles of diameter 0.94 in a hexagonal packing of step 1 leave a fifth of the area. */
static void test_large_discs_show_the_packing_and_small_ones_grow_together(void **state)
{
    (void)state;
    const double large = share_of_gaps(200), small = share_of_gaps(20000);
    if (!(large > 0.12 && large < 0.35 && small < 0.03)) fail_msg("gaps: %g and %g", large, small);
}

/* A turntable around a long set that is not centred at the origin: the whole set stays in the frame at a
 * constant distance. The first picture is that of the still camera. A given camera rotates around its
 * target. */
static void test_turntables(void **state)
{
    (void)state;
    enum { FRAMES = 7 };
    static const camera_place place = {{5, 1, 2}, {1, 1, 1}, {0, 1, 0}, 0.8, 0};
    point_set s = point_set_sphere(500, vec3_make(100, 5, -7), 1);
    for (size_t i = 0; i < s.points.count; i++) s.position[i].x = 100 + 4 * (s.position[i].x - 100);
    preview_options options = {.width = 300, .height = 200, .color = {.which = QUANTITY_SPACING}};
    camera still = camera_fit(s.position, s.points.count, 0.1, (camera_frame){0, 0, 300, 200, false}),
           from[FRAMES];
    preview_orbit(&s.points, &options, FRAMES, from);
    assert_true(vec3_norm(vec3_sub(from[0].forward, still.forward)) < 1e-12);
    for (int k = 0; k < FRAMES; k++) {
        vec3 middle = camera_point(&from[k], vec3_make(100, 5, -7)),
             before = from[k > 0 ? k - 1 : FRAMES - 1].forward;
        assert_true(fabs(middle.x) < 0.05 && fabs(middle.y) < 0.05);
        assert_true(fabs(middle.z - camera_point(&from[0], vec3_make(100, 5, -7)).z) < 0.05);
        double turned = atan2(from[k].forward.y, from[k].forward.x) - atan2(before.y, before.x);
        assert_true(fabs(sin(0.5 * (turned - 2 * M_PI / FRAMES))) < 1e-9);
        for (size_t i = 0; i < s.points.count; i++) {
            double x, y;
            camera_project(&from[k], camera_point(&from[k], s.position[i]), &x, &y);
            assert_true(x > 0 && x < 300 && y > 0 && y < 200);
        }
    }
    options.camera = &place;
    preview_orbit(&s.points, &options, FRAMES, from);
    for (int k = 0; k < FRAMES; k++) {
        vec3 eye = eye_of(&from[k]), target = camera_point(&from[k], place.target);
        assert_true(fabs(eye.y - 1) < 1e-12 && fabs(hypot(eye.x - 1, eye.z - 1) - hypot(4, 1)) < 1e-12);
        assert_true(fabs(target.x) < 1e-12 && fabs(target.y) < 1e-12);
    }
    point_set_free(&s);
}

/* A pipe along the line of sight is shown from its side, whatever the up axis and its direction. A set as
 * deep as wide is not rotated. */
static void test_pipes_are_shown_from_the_side(void **state)
{
    (void)state;
    point_set s = point_set_sphere(500, vec3_make(100, 5, -7), 1);
    for (int y_up = 0; y_up < 2; y_up++) {
        const camera_frame frame = {0, 0, 300, 200, y_up};
        const camera round = camera_fit(s.position, s.points.count, 0.1, frame);
        for (int level = 0; level < 2; level++) { /* along the line of sight, and horizontal below it */
            vec3 along = round.forward, *pipe = calloc(s.points.count, sizeof *pipe);
            if (level)
                along = vec3_unit(y_up ? vec3_make(along.x, 0, along.z) : vec3_make(along.x, along.y, 0));
            for (size_t i = 0; i < s.points.count; i++)
                pipe[i] = vec3_axpy(9 * vec3_dot(vec3_sub(s.position[i], vec3_make(100, 5, -7)), along),
                                    along, s.position[i]);
            const camera side = camera_fit(pipe, s.points.count, 0.1, frame);
            assert_true(fabs(vec3_dot(side.forward, along)) < 0.5);
            free(pipe);
        }
        vec3 *bar = calloc(s.points.count, sizeof *bar);
        for (size_t i = 0; i < s.points.count; i++)
            bar[i] = vec3_axpy(9 * vec3_dot(s.position[i], round.right), round.right, s.position[i]);
        const camera same = camera_fit(bar, s.points.count, 0.1, frame);
        assert_true(vec3_norm(vec3_sub(same.forward, round.forward)) < 1e-12);
        free(bar);
    }
    point_set_free(&s);
}

/* The colours of points are those of the requested quantity, from the first to the last of the scale. */
static void test_every_quantity_is_shown(void **state)
{
    (void)state;
    point_set s = point_set_sphere(300, vec3_make(0, 0, 0), 1);
    double degree[300];
    s.points.degree = degree;
    for (quantity which = QUANTITY_ALPHA; which <= QUANTITY_DEGREE; which++) {
        for (size_t i = 0; i < 300; i++) degree[i] = 6;
        double *values = (double *)quantity_values(&s.points, &(quantity_look){.which = which}),
               even = values[0];
        for (size_t i = 0; i < 300; i++) values[i] = s.position[i].x > 0 ? 7 : 5;
        for (size_t i = 0; which == QUANTITY_SPACING && i < 300; i++)
            values[i] = s.position[i].x > 0 ? 0.15 : 0.12;
        image *m = render(&s.points, 256, 256, which);
        double light[2] = {0};
        for (int y = 0; y < 200; y++)
            for (int x = 0; x < 256; x++) {
                preview_sample p = preview_at(m, x, y);
                const unsigned char *c = m->rgb + 3 * (y * 256 + x);
                if (p.id > 0)
                    light[s.position[p.id - 1].x > 0] += c[1] - c[2]; /* from blue to green or yellow */
            }
        assert_true(light[1] > 0 && light[0] < light[1]);
        assert_true(m->scale.low < m->scale.high);
        for (size_t i = 0; i < 300; i++) values[i] = even;
        preview_free(m);
    }
    point_set_free(&s);
}

/* From few large discs to many small ones: inside the outline every pixel shows the near side. */
static void test_far_side_does_not_show_through(void **state)
{
    (void)state;
    static const size_t counts[] = {100, 3000, 60000};
    for (int k = 0; k < 3; k++) {
        point_set s = point_set_sphere(counts[k], vec3_make(0, 0, 0), 1);
        image *m = render(&s.points, 256, 256, QUANTITY_CURVATURE);
        vec3 eye = eye_of(&m->camera), axis = camera_point(&m->camera, vec3_make(0, 0, 0));
        double cx = m->camera.center_x + m->camera.focal * axis.x / axis.z;
        double cy = m->camera.center_y - m->camera.focal * axis.y / axis.z;
        double radius = m->camera.focal / sqrt(vec3_norm2(axis) - 1);
        for (int y = 0; y < m->height; y++)
            for (int x = 0; x < m->width; x++) {
                preview_sample p = preview_at(m, x, y);
                double r = hypot(x + 0.5 - cx, y + 0.5 - cy) / radius;
                if (r < 0.9 && (p.id == 0 || vec3_dot(vec3_sub(eye, p.position), p.normal) <= 0))
                    fail_msg("%zu points: pixel %d %d shows %u", counts[k], x, y, p.id);
                if (r > 1.25) assert_int_equal(p.id, 0);
            }
        preview_free(m);
        point_set_free(&s);
    }
}

static void test_camera_fits_tightly(void **state)
{
    (void)state;
    static const camera_frame frames[] = {
        {10, 20, 300, 200, false}, {5, 5, 100, 400, false}, {0, 0, 64, 64, true}};
    point_set s = point_set_sphere(2000, vec3_make(1e6, 5, -7), 3);
    for (size_t i = 0; i < s.points.count; i++) s.position[i].x = 1e6 + 4 * (s.position[i].x - 1e6);
    for (int k = 0; k < 3; k++) {
        camera_frame f = frames[k];
        camera c = camera_fit(s.position, s.points.count, 1e-6, f);
        double left = INFINITY, right = -INFINITY, top = INFINITY, bottom = -INFINITY;
        for (size_t i = 0; i < s.points.count; i++) {
            vec3 p = camera_point(&c, s.position[i]);
            assert_true(p.z > 0);
            left = fmin(left, c.center_x + c.focal * p.x / p.z);
            right = fmax(right, c.center_x + c.focal * p.x / p.z);
            top = fmin(top, c.center_y - c.focal * p.y / p.z);
            bottom = fmax(bottom, c.center_y - c.focal * p.y / p.z);
        }
        double slack = 1e-3;
        assert_true(left > f.left - slack && right < f.left + f.width + slack);
        assert_true(top > f.top - slack && bottom < f.top + f.height + slack);
        double free_x = f.width - (right - left), free_y = f.height - (bottom - top);
        assert_true(fmin(free_x, free_y) < 0.01 * f.width);
        assert_true(fabs((c.center_x - left) - (right - c.center_x)) < 0.15 * f.width);
    }
    point_set_free(&s);
}

/* ---- files ---- */

typedef struct temporary {
    char path[64];
} temporary;

static temporary temporary_make(void)
{
    temporary t = {"test_preview_XXXXXX"};
    int fd = mkstemp(t.path);
    assert_true(fd >= 0);
    close(fd);
    return t;
}

static char *slurp(const char *path, size_t *length)
{
    FILE *file = fopen(path, "rb");
    assert_non_null(file);
    fseek(file, 0, SEEK_END);
    *length = (size_t)ftell(file);
    rewind(file);
    char *data = mem_alloc(*length);
    assert_int_equal(fread(data, 1, *length, file), *length);
    fclose(file);
    return data;
}

static void spit(const char *path, const char *data, size_t length)
{
    FILE *file = fopen(path, "wb");
    assert_non_null(file);
    assert_int_equal(fwrite(data, 1, length, file), length);
    fclose(file);
}

static preview_exr_options options = {PREVIEW_EXR_NONE, true};

static bool write_exr(const char *path, const image *m, error *e)
{
    FILE *file = fopen(path, "wb");
    assert_non_null(file);
    bool good = preview_exr_write(file, m, &options, e);
    fclose(file);
    return good;
}

static void test_png(void **state)
{
    (void)state;
    temporary t = temporary_make();
    point_set s = point_set_sphere(100, vec3_make(0, 0, 0), 1);
    image *m = render(&s.points, 200, 77, QUANTITY_ALPHA);
    error e = {0};
    FILE *file = fopen(t.path, "wb");
    assert_true(picture_png_write(file, &(canvas){m->rgb, m->width, m->height, 1}, &e));
    fclose(file);
    assert_true(png_shows(t.path, m));
    size_t length;
    char *data = slurp(t.path, &length);
    assert_memory_equal(data, "\x89PNG\r\n\x1a\n", 8);
    for (size_t n = 0; n < length; n += 7) {
        spit(t.path, data, n);
        if (png_shows(t.path, m)) fail_msg("accepted %zu of %zu bytes", n, length);
    }
    spit(t.path, data, length);
    m->rgb[3 * 200 * 50 + 17] ^= 1;
    assert_false(png_shows(t.path, m));
    FILE *full = fopen("/dev/full", "wb");
    if (full) {
        assert_false(picture_png_write(full, &(canvas){m->rgb, m->width, m->height, 1}, &e));
        fclose(full);
    }
    unlink(t.path);
    free(data);
    preview_free(m);
    point_set_free(&s);
}

static void test_exr(void **state)
{
    (void)state;
    temporary t = temporary_make();
    point_set s = point_set_sphere(300, vec3_make(5, 6, 7), 1);
    image *m = render(&s.points, 129, 67, QUANTITY_ALPHA);
    error e = {0};
    if (!write_exr(t.path, m, &e)) fail_msg("%s", e.message);
    assert_true(exr_shows(t.path, m, &options));
    size_t length;
    char *data = slurp(t.path, &length);
    assert_memory_equal(data, "\x76\x2f\x31\x01", 4);
    for (size_t n = 0; n < length; n += 211) {
        spit(t.path, data, n);
        if (exr_shows(t.path, m, &options)) fail_msg("accepted %zu of %zu bytes", n, length);
    }
    for (size_t n = length - 67 * 129 * 48; n < length; n += 4999) { /* within lines, not in the header */
        data[n] ^= 1;
        spit(t.path, data, length);
        if (exr_shows(t.path, m, &options)) fail_msg("byte %zu is not that of the picture", n);
        data[n] ^= 1;
    }
    spit(t.path, data, length);
    assert_true(exr_shows(t.path, m, &options));
    for (size_t i = 0; i < 300; i++) s.scalar[6][i] *= 1 + 1e-6; /* changes the borrowed arrays */
    assert_false(exr_shows(t.path, m, &options));
    image *other = render(&s.points, 128, 67, QUANTITY_ALPHA);
    assert_false(exr_shows(t.path, other, &options));
    if (access("/dev/full", W_OK) == 0) {
        assert_false(write_exr("/dev/full", m, &e));
        assert_int_equal(e.code, ERROR_STORAGE_FULL);
        assert_non_null(strstr(e.message, "No space left"));
    }
    unlink(t.path);
    free(data);
    preview_free(other);
    preview_free(m);
    point_set_free(&s);
}

static void test_exr_compressed(void **state)
{
    (void)state;
    temporary t = temporary_make();
    point_set s = point_set_sphere(300, vec3_make(5, 6, 7), 1);
    image *m = render(&s.points, 129, 67, QUANTITY_ALPHA);
    size_t length[4];
    error e = {0};
    for (preview_exr_packing k = PREVIEW_EXR_NONE; k <= PREVIEW_EXR_ZIP; k++) {
        options.packing = k;
        if (!write_exr(t.path, m, &e)) fail_msg("%s", e.message);
        assert_true(exr_shows(t.path, m, &options));
        char *data = slurp(t.path, &length[k]);
        spit(t.path, data, length[k] - 1);
        assert_false(exr_shows(t.path, m, &options));
        free(data);
    }
    options.packing = PREVIEW_EXR_NONE;
    assert_false(exr_shows(t.path, m, &options));
    assert_true(length[PREVIEW_EXR_RLE] < 0.7 * (double)length[PREVIEW_EXR_NONE]);
    assert_true(length[PREVIEW_EXR_ZIPS] < length[PREVIEW_EXR_RLE]);
    assert_true(length[PREVIEW_EXR_ZIP] < length[PREVIEW_EXR_ZIPS]);
    unlink(t.path);
    preview_free(m);
    point_set_free(&s);
}

/* A file with the picture, depth and id only is a valid file, and much smaller. */
static void test_exr_basic(void **state)
{
    (void)state;
    temporary t = temporary_make();
    point_set s = point_set_sphere(300, vec3_make(5, 6, 7), 1);
    image *m = render(&s.points, 129, 67, QUANTITY_ALPHA);
    error e = {0};
    size_t length[2];
    for (int k = 0; k < 2; k++) {
        options.all_channels = k == 0;
        if (!write_exr(t.path, m, &e)) fail_msg("%s", e.message);
        assert_true(exr_shows(t.path, m, &options));
        free(slurp(t.path, &length[k]));
    }
    assert_true(length[0] - length[1] > 67 * 129 * 32);
    options.all_channels = true;
    assert_false(exr_shows(t.path, m, &options));
    unlink(t.path);
    preview_free(m);
    point_set_free(&s);
}

static void test_determinism(void **state)
{
    (void)state;
    temporary t[4];
    point_set s = point_set_sphere(5000, vec3_make(0, 0, 0), 1);
    char *data[4];
    size_t length[4];
    for (int k = 0; k < 2; k++) {
        image *m = render_with(&s.points, 300, 300, QUANTITY_CURVATURE, 1 + 2 * k);
        t[k] = temporary_make();
        t[k + 2] = temporary_make();
        FILE *file = fopen(t[k].path, "wb");
        assert_true(picture_png_write(file, &(canvas){m->rgb, m->width, m->height, 1}, NULL));
        fclose(file);
        assert_true(write_exr(t[k + 2].path, m, NULL));
        data[k] = slurp(t[k].path, &length[k]);
        data[k + 2] = slurp(t[k + 2].path, &length[k + 2]);
        preview_free(m);
    }
    for (int k = 0; k < 4; k += 2) {
        assert_int_equal(length[k], length[k + 1]);
        assert_memory_equal(data[k], data[k + 1], length[k]);
    }
    for (int k = 0; k < 4; k++) {
        unlink(t[k].path);
        free(data[k]);
    }
    point_set_free(&s);
}

/* ---- colours ---- */

static void test_viridis(void **state)
{
    (void)state;
    static const double table[5][4] = {{0, 0.267, 0.005, 0.329},
                                       {0.25, 0.229, 0.322, 0.546},
                                       {0.5, 0.128, 0.567, 0.551},
                                       {0.75, 0.369, 0.789, 0.383},
                                       {1, 0.993, 0.906, 0.144}};
    for (int i = 0; i < 5; i++) {
        double c[3];
        colormap_viridis(table[i][0], c);
        for (int k = 0; k < 3; k++)
            if (fabs(c[k] - table[i][k + 1]) > 0.02) fail_msg("%g: %g", table[i][0], c[k]);
    }
    double previous = -1; /* brightness increases monotonically */
    for (int i = 0; i <= 100; i++) {
        double c[3];
        colormap_color(COLORMAP_VIRIDIS, i / 100.0, c);
        double light =
            0.2126 * colormap_linear(c[0]) + 0.7152 * colormap_linear(c[1]) + 0.0722 * colormap_linear(c[2]);
        assert_true(light > previous);
        previous = light;
    }
}

static void test_scale(void **state)
{
    (void)state;
    enum { N = 1001 };
    double values[N];
    colormap_scale s;
    for (int i = 0; i < N; i++) values[(i * 37) % N] = i;
    values[0] = 1e9; /* an outlier */
    for (int root = 0; root <= 1; root++) {
        assert_true(colormap_scale_of(values, N, root, 1e-3, &s, NULL));
        assert_true(fabs(s.low - 20) <= 1 && fabs(s.high - 980) <= 2);
        assert_true(colormap_scale_place(&s, -5) == 0 && colormap_scale_place(&s, 1e9) == 1);
        for (double t = 0; t <= 1; t += 0.125)
            assert_true(fabs(colormap_scale_place(&s, colormap_scale_value(&s, t)) - t) < 1e-12);
    }
    for (int i = 0; i < N; i++) values[i] = 0;
    assert_true(colormap_scale_of(values, N, true, 0.5, &s, NULL));
    assert_true(s.low == 0 && s.high == 0.5);
    for (int i = 0; i < N; i++) values[i] = 4 + 1e-9 * i;
    assert_true(colormap_scale_of(values, N, true, 1e-3, &s, NULL));
    assert_true(fabs(s.low - 3.9) < 1e-6 && fabs(s.high - 4.1) < 1e-6);
}

/* Curvatures have a square root scale from 0, also with given bounds. */
static void test_given_bounds_of_curvature(void **state)
{
    (void)state;
    const points set = {0};
    colormap_scale s;
    quantity_look look = {.which = QUANTITY_CURVATURE, .low = 0, .high = 4};
    assert_true(quantity_scale(&set, &look, 1, &s, NULL));
    assert_true(s.low == 0 && s.high == 4 && s.root);
    look.low = -1;
    assert_true(quantity_scale(&set, &look, 1, &s, NULL));
    assert_true(s.low == -1 && !s.root);
}

static void test_legend(void **state)
{
    (void)state;
    static const struct {
        double value;
        const char *text;
    } numbers[] = {{0, "0"},     {-0.0, "0"},           {1.0 / 3, "0.333"},
                   {2.5, "2.5"}, {1234567, "1.23e+06"}, {1.23456e-7, "1.23e-07"}};
    char text[32];
    for (size_t i = 0; i < sizeof numbers / sizeof *numbers; i++) {
        legend_number(numbers[i].value, text, sizeof text);
        assert_string_equal(text, numbers[i].text);
    }
    assert_int_equal(legend_height(199, 500), 0);
    assert_int_equal(legend_height(1024, 1024), 2 * legend_height(512, 512));
    point_set s = point_set_sphere(50, vec3_make(0, 0, 0), 1);
    image *m = render(&s.points, 512, 512, QUANTITY_CURVATURE);
    double first[3], last[3];
    colormap_color(COLORMAP_VIRIDIS, 0, first);
    colormap_color(COLORMAP_VIRIDIS, 1, last);
    int width = (int)(0.4 * 512), left = (512 - width) / 2, rows = 0;
    for (int y = 512 - legend_height(512, 512); y < 512; y++) {
        const unsigned char *a = m->rgb + 3 * (y * 512 + left),
                            *b = m->rgb + 3 * (y * 512 + left + width - 1);
        bool bar = true;
        for (int k = 0; k < 3; k++)
            bar = bar && a[k] == lround(255 * first[k]) && b[k] == lround(255 * last[k]);
        rows += bar;
        /* the set is not drawn here */
        for (int x = 0; x < 512; x++) assert_int_equal(preview_at(m, x, y).id, 0);
    }
    assert_int_equal(rows, 6);
    preview_free(m);
    point_set_free(&s);
}

/* Number of bytes of the legend's picture that are not black. */
static size_t ink(int side, const char *title, const char *note)
{
    unsigned char *rgb = calloc(3 * (size_t)side, (size_t)side);
    const colormap_scale scale = {.low = 0, .high = 1};
    size_t count = 0;
    legend_draw(rgb, side, side, &scale, title, note);
    for (size_t k = 0; k < 3 * (size_t)side * (size_t)side; k++) count += rgb[k] != 0;
    free(rgb);
    return count;
}

static void test_texts_of_a_legend_stand_side_by_side(void **state)
{
    (void)state;
    static const char title[] = "curvature", note[] = "1000000, thin walls";
    for (int side = 320; side <= 1024; side += 64) {
        size_t none = ink(side, "", "");
        assert_int_equal(ink(side, title, note) - none,
                         ink(side, title, "") - none + ink(side, "", note) - none);
        assert_true(ink(side, "", note) > none);
    }
}

static void test_halves(void **state)
{
    (void)state;
    for (uint32_t h = 0; h < 65536; h++) {
        float value = half_to_float((uint16_t)h);
        if (isnan(value))
            assert_true(isnan(half_to_float(half_from_float(value))));
        else
            assert_int_equal(half_from_float(value), h);
    }
    for (uint32_t h = 0; h < 0x7BFF; h++) { /* midpoints are rounded to the even one */
        double a = half_to_float((uint16_t)h), b = half_to_float((uint16_t)(h + 1));
        float middle = (float)(0.5 * (a + b));
        assert_int_equal(half_from_float(middle), h + (h & 1));
        assert_int_equal(half_from_float(nextafterf(middle, INFINITY)), h + 1);
        assert_int_equal(half_from_float(nextafterf(middle, 0)), h);
    }
    assert_int_equal(half_from_float(65520), 0x7C00);
    assert_int_equal(half_from_float(nextafterf(65520, 0)), 0x7BFF);
}

/* ---- degenerate sets ---- */

static void test_refused_sets(void **state)
{
    (void)state;
    point_set s = point_set_sphere(10, vec3_make(0, 0, 0), 1);
    points none = s.points;
    none.count = 0;
    refuse(&none, 100, 100, "at least one point");
    refuse(&s.points, 63, 100, "63 x 100");
    refuse(&s.points, 100, 8193, "100 x 8193");
    s.position[7].y = NAN;
    refuse(&s.points, 100, 100, "point 7");
    s.position[7].y = 1e26;
    refuse(&s.points, 100, 100, "point 7");
    s.position[7].y = 0;
    s.scalar[6][3] = INFINITY;
    refuse(&s.points, 100, 100, "point 3");
    point_set_free(&s);
}

static void test_degenerate_sets(void **state)
{
    (void)state;
    for (int what = 0; what < 8; what++) {
        size_t count = what == 0 ? 1 : what == 1 ? 4 : 500;
        double scale = what == 3 ? 1e24 : what == 4 ? 1e-30 : 1;
        point_set s =
            point_set_sphere(count, what == 5 ? vec3_make(1e12, -1e12, 1e12) : vec3_make(0, 0, 0), scale);
        for (size_t i = 0; i < count; i++) {
            if (what == 2) s.position[i] = vec3_make(1, 2, 3);                      /* all in one place */
            if (what == 6) s.scalar[5][i] = s.scalar[6][i] = 0;                     /* discs of no size */
            if (what == 7) s.normal[i] = vec3_make(0, 0, 0), s.scalar[6][i] = 1e20; /* no plane, vast cells */
        }
        image *m = render(&s.points, 128, 96, QUANTITY_CURVATURE);
        size_t covered = count_covered(m);
        if (covered == 0 && what != 7 && what != 0) fail_msg("set %d: nothing to be seen", what);
        preview_free(m);
        point_set_free(&s);
    }
}

/* One point that faces the camera is in the centre of the picture, and its disc has its radius. */
static void test_one_point(void **state)
{
    (void)state;
    point_set s = point_set_sphere(1, vec3_make(0, 0, 0), 1);
    s.normal[0] = vec3_unit(vec3_make(0.52, -0.74, 0.43));
    s.scalar[0][0] = s.scalar[1][0] = s.scalar[2][0] = 0; /* flat: the body is slightly below the disc */
    image *m = render(&s.points, 100, 100, QUANTITY_ALPHA);
    preview_sample p = preview_at(m, 50, 50);
    assert_int_equal(p.id, 1);
    assert_true(vec3_norm(vec3_sub(p.position, s.position[0])) < 0.1 * s.points.spacing_local[0]);
    double area = 0, pixel = (double)p.depth / m->camera.focal, radius = 0.70 * s.points.spacing_local[0];
    for (int i = 0; i < 100 * 100; i++) area += (double)half_to_float(m->rgba[4 * i + 3]);
    assert_true(fabs(area * pixel * pixel / (M_PI * radius * radius) - 1) < 0.1);
    preview_free(m);
    point_set_free(&s);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_pixels_are_the_discs),
        cmocka_unit_test(test_points_behind_the_camera_are_not_drawn),
        cmocka_unit_test(test_up_axis_y_equals_a_rotated_set),
        cmocka_unit_test(test_discs_of_thin_walls_are_smaller),
        cmocka_unit_test(test_large_discs_show_the_packing_and_small_ones_grow_together),
        cmocka_unit_test(test_turntables),
        cmocka_unit_test(test_every_quantity_is_shown),
        cmocka_unit_test(test_exr_compressed),
        cmocka_unit_test(test_exr_basic),
        cmocka_unit_test(test_far_side_does_not_show_through),
        cmocka_unit_test(test_camera_fits_tightly),
        cmocka_unit_test(test_pipes_are_shown_from_the_side),
        cmocka_unit_test(test_png),
        cmocka_unit_test(test_exr),
        cmocka_unit_test(test_determinism),
        cmocka_unit_test(test_viridis),
        cmocka_unit_test(test_scale),
        cmocka_unit_test(test_given_bounds_of_curvature),
        cmocka_unit_test(test_legend),
        cmocka_unit_test(test_texts_of_a_legend_stand_side_by_side),
        cmocka_unit_test(test_halves),
        cmocka_unit_test(test_refused_sets),
        cmocka_unit_test(test_degenerate_sets),
        cmocka_unit_test(test_one_point),
    };
    return cmocka_run_group_tests_name("preview", tests, NULL, NULL);
}
