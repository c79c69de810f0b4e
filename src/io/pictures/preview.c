// SPDX-License-Identifier: Apache-2.0
#include "io/pictures/preview.h"

#include <float.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/compare.h"
#include "base/core/isa.h"
#include "base/core/memory.h"
#include "io/pictures/disc.h"
#include "io/points/half.h"
#include "io/pictures/legend.h"
#include "geometry/space/bbox.h"

/* Samples of one band of rows, which a thread draws at a time, within its cache. */
enum { BAND_SAMPLES = 1 << 16 };
/* Points in a chunk of work. */
enum { POINTS_GRAIN = 4096 };

/* Radii in units of the local spacing. Neighbours in a hexagonal packing touch at 0.5, and 1/sqrt(3) closes
 * the gap between three; the body is larger, for packings that are not ideal. */
static const double disc_share = 0.47, body_share = 0.70;
/* Factor of all radii if the points do not resolve the surface: opposite walls are closer than neighbours. */
static const double thin_scale = 0.5;

/* Radii in pixels: between merge_pixels and single_pixels discs change from covering everything to separate
 * discs; from ring_from_pixels they have an outline, which would be noise on smaller discs. */
static const double merge_pixels = 1.5, single_pixels = 5, ring_from_pixels = 4;

/* Offset of the body below its disc, as a fraction of the radius: bodies of neighbours hide no disc where the
 * radius of curvature is at least 1.75 spacings. */
static const double offset_share = 0.2;

/* Increase of depth towards the rim, as a fraction of the radius: where discs overlap the closer centre wins.
 * Otherwise coplanar discs would mix at random. */
static const double cone_share = 0.1;

/* Maximum of size_of over the requested spacing. */
static const double stretch_max = 1.5;

/* Maximum distance by which a body extends in front of its point, in radii; half of it is for the offset. */
static const double reach_share = 1.5;

/* The colour of plain shading, sRGB: light, so that the shade has the whole range of brightness. */
static const double shading_color[3] = {0.86, 0.84, 0.80};

static const double line_pixels = 1; /* half the width */

/* Maximum radius as a fraction of the half diagonal of the set: an isolated point may have a huge Voronoi
 * cell. */
static const double radius_max_share = 0.35;

/* Maximum of coordinates: depths remain below PREVIEW_FAR and within the range of float. */
static const double world_max = 1e-5 * PREVIEW_FAR;

static const double margin_share = 0.05; /* margin around the set, as a fraction of the shorter side */

/* ---- discs ---- */

/* The requested spacing at a point; 0: it is not known. */
static double requested(const points *set, size_t i)
{
    return set->spacing ? set->spacing[i] : 0;
}

/* The spacing that scales the discs of a point: the achieved spacing, limited by the requested one (a point
 * at the end of a thin part has a huge Voronoi cell). */
static double size_of(const points *set, size_t i)
{
    double wanted = requested(set, i), size = set->spacing_local[i] > 0 ? set->spacing_local[i] : wanted;
    if (wanted > 0) size = compare_smaller(size, stretch_max * wanted);
    return compare_larger(size, 0);
}

/* The cosine of the angle between the normal of a disc and the direction to the eye. */
static double facing_of(const camera *c, const disc *d)
{
    vec3 sight = camera_sight(c, d->center);
    return -vec3_dot(sight, d->normal) / vec3_norm(sight);
}

static disc body_of(const image *m, size_t i)
{
    disc d;
    d.center = camera_point(&m->camera, m->points.position[i]);
    d.normal = camera_direction(&m->camera, m->points.normal[i]);
    d.radius = compare_smaller(m->scale_of_discs * body_share * size_of(&m->points, i), m->radius_max);
    d.center = vec3_axpy(-offset_share * d.radius, d.normal, d.center);
    d.cone = cone_share * d.radius;
    d.code = (uint32_t)(i + 1) | DISC_BODY;
    d.ring = false;
    return d;
}

static disc face_of(const image *m, size_t i)
{
    disc d;
    d.center = camera_point(&m->camera, m->points.position[i]);
    d.normal = camera_direction(&m->camera, m->points.normal[i]);
    double size = m->scale_of_discs * size_of(&m->points, i);
    double pixels = disc_share * size * camera_scale(&m->camera, d.center.z);
    double t =
        compare_smaller(compare_larger((pixels - merge_pixels) / (single_pixels - merge_pixels), 0), 1);
    double share = body_share + t * (disc_share - body_share);
    d.radius = compare_smaller(share * size, m->radius_max);
    d.cone = cone_share * d.radius;
    d.code = (uint32_t)(i + 1);
    d.ring = pixels > ring_from_pixels;
    return d;
}

/* Whether the disc is so thin that only some of the samples along it would meet it. */
static bool is_line(const image *m, const disc *d)
{
    double pixels = d->radius * camera_scale(&m->camera, d->center.z);
    return pixels > single_pixels && pixels * fabs(facing_of(&m->camera, d)) < line_pixels;
}

/* The discs drawn for a point, up to two. From behind: the body only. From the front: the face, and the body
 * if it extends beyond the face. None if it contains the eye or is a line. */
static int discs_of(const image *m, size_t i, disc out[2])
{
    out[0] = face_of(m, i);
    if (!(out[0].center.z > reach_share * m->radius_max)) return 0;
    if (facing_of(&m->camera, &out[0]) <= 0) {
        out[0] = body_of(m, i);
        return !is_line(m, &out[0]);
    }
    if (is_line(m, &out[0])) return 0;
    out[1] = body_of(m, i);
    return out[1].radius > out[0].radius ? 2 : 1;
}

/* A bounding ball of the discs of a point: the face is at most as large as the body, whose offset is
 * bounded. */
static disc_ball ball_of(const image *m, size_t i)
{
    const double body = m->scale_of_discs * body_share * size_of(&m->points, i);
    return (disc_ball){camera_point(&m->camera, m->points.position[i]),
                       (1 + offset_share) * compare_smaller(body, m->radius_max)};
}

/* Whether a point is seen from behind. */
static bool is_turned(const image *m, size_t i)
{
    const vec3 normal = camera_direction(&m->camera, m->points.normal[i]),
               sight = camera_sight(&m->camera, camera_point(&m->camera, m->points.position[i]));
    return vec3_dot(sight, normal) >= 0;
}

/* The points that may be visible in each band, in the order of the set. */
typedef struct bins {
    int rows; /* rows of samples per band */
    size_t bands;
    uint16_t (*reach)[2]; /* per point: its first and last band; 1 and 0 if it is not drawn */
    size_t *begin;        /* bands + 1 entries: range of each band in `point` */
    uint32_t *point;
} bins;

static void bins_free(bins *b)
{
    free(b->reach);
    free(b->begin);
    free(b->point);
}

/* Linear light. */
typedef struct color {
    float r, g, b;
} color;

typedef struct drawing {
    image *image;
    threads *pool;
    const color *colors;
    const unsigned char *table;
    bins bins;
    disc_band *band; /* one per thread */
} drawing;

static void reach_chunk(void *context, int worker, size_t begin, size_t end)
{
    const drawing *job = context;
    const image *m = job->image;
    (void)worker;
    for (size_t i = begin; i < end; i++) {
        const disc_ball ball = ball_of(m, i);
        int low = 1, high = 0;
        if (ball.center.z > reach_share * m->radius_max)
            disc_ball_rows(&m->camera, &ball, m->height * DISC_SAMPLES, &low, &high);
        job->bins.reach[i][0] = (uint16_t)(low > high ? 1 : low / job->bins.rows);
        job->bins.reach[i][1] = (uint16_t)(low > high ? 0 : high / job->bins.rows);
    }
}

static bool sort_into_bands(drawing *job, error *e)
{
    static const char what[] = "the preview's points";
    bins *b = &job->bins;
    size_t count = job->image->points.count;
    b->reach = mem_array(count, sizeof *b->reach, what, e);
    b->begin = mem_array(b->bands + 2, sizeof *b->begin, what, e);
    if (!b->reach || !b->begin) return false;
    threads_run(job->pool, count, POINTS_GRAIN, reach_chunk, job);
    if (!threads_may_go_on(job->pool, e)) return false;
    for (size_t i = 0; i < count; i++)
        for (int k = b->reach[i][0]; k <= b->reach[i][1]; k++) b->begin[k + 2]++;
    for (size_t k = 2; k < b->bands + 2; k++) b->begin[k] += b->begin[k - 1];
    b->point = mem_array(b->begin[b->bands + 1], sizeof *b->point, what, e);
    if (!b->point) return false;
    for (size_t i = 0; i < count; i++) /* begin[k + 1] advances from the start to the end of the band */
        for (int k = b->reach[i][0]; k <= b->reach[i][1]; k++) b->point[b->begin[k + 1]++] = (uint32_t)i;
    free(b->reach);
    b->reach = NULL;
    return true;
}

static void draw_point(const image *m, size_t i, const disc_band *b)
{
    disc all[2];
    const int count = discs_of(m, i, all);
    for (int d = 0; d < count; d++) disc_draw(&m->camera, m->far, &all[d], b);
    if (count > 0 && !(all[0].code & DISC_BODY) &&
        all[0].radius * camera_scale(&m->camera, all[0].center.z) < 1)
        disc_draw_dot(&m->camera, m->far, &all[0], b);
}

/* Draws an empty band. Points seen from behind come last: most of them are hidden by then. Their indices are
 * moved to the start of the band's list. */
static void draw_band(const image *m, const bins *sorted, size_t which, const disc_band *b)
{
    const size_t begin = sorted->begin[which];
    size_t turned = begin;
    disc_band_begin(b);
    for (size_t k = begin; k < sorted->begin[which + 1]; k++)
        if (is_turned(m, sorted->point[k]))
            sorted->point[turned++] = sorted->point[k];
        else
            draw_point(m, sorted->point[k], b);
    disc_band_note_tiles(b);
    for (size_t k = begin; k < turned; k++) {
        const disc_ball ball = ball_of(m, sorted->point[k]);
        if (!disc_ball_is_hidden(&m->camera, m->far, &ball, b)) draw_point(m, sorted->point[k], b);
    }
}

/* ---- shading ---- */

/* Key light over the left shoulder of the viewer, fill light from the right, and ambient light from the sky.
 * Directions point to the lights, in camera space. */
static double shade(vec3 n, vec3 up)
{
    static const vec3 key = {-0.40, 0.55, -0.73}, fill = {0.75, 0.05, -0.66};
    return 0.20 + 0.18 * (0.5 + 0.5 * vec3_dot(n, up)) + 0.62 * compare_larger(vec3_dot(n, key), 0) +
           0.26 * compare_larger(vec3_dot(n, fill), 0);
}

/* Entries of the colour scale, in linear light: more than 8 bits can distinguish. */
enum { SCALE_COLORS = 4096 };

static color light_of(const double *srgb)
{
    return (color){(float)colormap_linear(srgb[0]), (float)colormap_linear(srgb[1]),
                   (float)colormap_linear(srgb[2])};
}

typedef struct shading {
    const image *image;
    const quantity_look *look;
    const double *values;
    const color *scale; /* SCALE_COLORS entries; NULL: computed on demand */
    color *colors;
} shading;

static color scale_color(const quantity_look *look, int place)
{
    double srgb[3];
    colormap_color(look->map, (place + 0.5) / SCALE_COLORS, srgb);
    return light_of(srgb);
}

static void shade_chunk(void *context, int worker, size_t begin, size_t end)
{
    const shading *job = context;
    const image *m = job->image;
    (void)worker;
    for (size_t i = begin; i < end; i++) {
        const float light = (float)shade(camera_direction(&m->camera, m->points.normal[i]), m->up);
        color c;
        if (job->look->which == QUANTITY_COLOR)
            c = light_of(job->values + 3 * i);
        else if (!quantity_is_defined(&m->points, job->look, i))
            c = light_of(quantity_undefined_color);
        else if (job->look->which == QUANTITY_SHADING)
            c = light_of(shading_color);
        else {
            int place = (int)(colormap_scale_place(&m->scale, job->values[i]) * SCALE_COLORS);
            if (place >= SCALE_COLORS) place = SCALE_COLORS - 1;
            c = job->scale ? job->scale[place] : scale_color(job->look, place);
        }
        job->colors[i] = (color){light * c.r, light * c.g, light * c.b};
    }
}

/* The colour of every point's disc, in linear light. */
static color *shade_points(const image *m, const quantity_look *look, threads *pool, error *e)
{
    const size_t count = m->points.count;
    color scale[SCALE_COLORS], *colors = mem_array(count, sizeof *colors, "the preview's colours", e);
    const bool whole = count >= SCALE_COLORS && quantity_has_scale(look->which);
    shading job = {m, look, quantity_values(&m->points, look), whole ? scale : NULL, colors};
    for (int k = 0; whole && k < SCALE_COLORS; k++) scale[k] = scale_color(look, k);
    if (colors) threads_run(pool, count, POINTS_GRAIN, shade_chunk, &job);
    return colors;
}

/* Body and outline have a darker colour of the disc; so does the far side of an open surface, which is lit
 * from behind. */
static color sample_color(const image *m, const color *colors, uint32_t code, vec3 up)
{
    static const float body_dark = 0.22f, ring_dark = 0.55f, back_dark = 0.30f;
    size_t i = (code & DISC_INDEX) - 1;
    float dark = code & DISC_BODY ? body_dark : code & DISC_RING ? ring_dark : 1;
    if (code & DISC_BODY) {
        vec3 n = camera_direction(&m->camera, m->points.normal[i]);
        if (vec3_dot(camera_sight(&m->camera, camera_point(&m->camera, m->points.position[i])), n) >= 0)
            dark = back_dark * (float)(shade(vec3_scale(n, -1), up) / shade(n, up));
    }
    return (color){dark * colors[i].r, dark * colors[i].g, dark * colors[i].b};
}

/* Table from linear light to sRGB bytes: near black, where sRGB is steepest, a step is a fifth of a byte. */
enum { TABLE_SIZE = 1 << 14 };

static void make_table(unsigned char table[TABLE_SIZE])
{
    int i = 0;
    for (int byte = 0; byte < 256; byte++) {
        /* end of the range of this byte */
        const double end = byte < 255 ? colormap_linear((byte + 0.5) / 255) : 1;
        for (; i < TABLE_SIZE && (i + 0.5) / TABLE_SIZE < end; i++) table[i] = (unsigned char)byte;
    }
}

static unsigned char to_byte(const unsigned char *table, float v)
{
    int i = (int)(v * TABLE_SIZE);
    return table[i < 0 ? 0 : i >= TABLE_SIZE ? TABLE_SIZE - 1 : i];
}

/* Background: neutral, slightly darker at the bottom, in linear light. */
static float background(const image *m, int y)
{
    static const float top = 0.80f, bottom = 0.56f;
    return top + (bottom - top) * ((float)y + 0.5f) / (float)m->height;
}

/* A pixel of the picture. */
typedef struct pixel {
    uint16_t rgba[4];
    unsigned char rgb[3];
} pixel;

/* Size of the cache of colours. A pixel shows the face, outline and body of a point, and a neighbour. */
enum { KEPT = 8 };

/* Computes pixels from samples, with a cache of colours of codes and of the last uniform pixel. */
typedef struct resolver {
    image *image;
    const disc_band *band;
    const color *colors;
    const unsigned char *table;
    vec3 up;
    uint32_t code[KEPT], full_code;
    color color[KEPT];
    pixel full;
} resolver;

static color color_of(resolver *r, uint32_t code)
{
    const uint32_t k = (code + (code >> 30)) % KEPT; /* flags are the highest bits */
    if (code != r->code[k]) r->color[k] = sample_color(r->image, r->colors, code, r->up);
    r->code[k] = code;
    return r->color[k];
}

static pixel pixel_of(const resolver *r, color c, float coverage, float ground)
{
    const float rgba[4] = {c.r, c.g, c.b, coverage};
    float behind = (1 - coverage) * ground;
    pixel out;
    for (int k = 0; k < 4; k++) out.rgba[k] = half_from_float(rgba[k]);
    for (int k = 0; k < 3; k++) out.rgb[k] = to_byte(r->table, rgba[k] + behind);
    return out;
}

static void put_pixel(const resolver *r, size_t at, const pixel *p)
{
    memcpy(r->image->rgba + 4 * at, p->rgba, sizeof p->rgba);
    memcpy(r->image->rgb + 3 * at, p->rgb, sizeof p->rgb);
}

static void fill_pixel(resolver *r, size_t at, uint32_t code)
{
    if (code != r->full_code) r->full = pixel_of(r, color_of(r, code), 1, 0);
    r->full_code = code;
    put_pixel(r, at, &r->full);
}

static void mix_pixel(resolver *r, size_t at, const uint32_t *const line[DISC_SAMPLES], int x, float ground)
{
    static const float share = 1.0f / (DISC_SAMPLES * DISC_SAMPLES);
    color sum = {0, 0, 0};
    int covered = 0;
    for (int j = 0; j < DISC_SAMPLES; j++)
        for (int i = 0; i < DISC_SAMPLES; i++) {
            uint32_t code = line[j][x * DISC_SAMPLES + i];
            if (code == 0) continue;
            color c = color_of(r, code);
            sum = (color){sum.r + c.r, sum.g + c.g, sum.b + c.b};
            covered++;
        }
    color mean = {sum.r * share, sum.g * share, sum.b * share};
    pixel mixed = pixel_of(r, mean, (float)covered * share, ground);
    put_pixel(r, at, &mixed);
}

/* The range of pixels of a row that may show something, from three rows of samples. */
static void drawn_pixels(const disc_band *b, int row, int out[2])
{
    out[0] = b->width / DISC_SAMPLES;
    out[1] = 0;
    for (int j = 0; j < DISC_SAMPLES; j++) {
        const int *drawn = b->drawn[row + j];
        if (drawn[0] >= drawn[1]) continue;
        if (drawn[0] / DISC_SAMPLES < out[0]) out[0] = drawn[0] / DISC_SAMPLES;
        if ((drawn[1] - 1) / DISC_SAMPLES >= out[1]) out[1] = (drawn[1] - 1) / DISC_SAMPLES + 1;
    }
}

/* Whether all samples of a pixel are `code`. A vector holds the samples of a row and one unused entry. */
static bool is_filled(const uint32_t *const line[DISC_SAMPLES], int x, uint32_t code)
{
    typedef uint32_t row __attribute__((vector_size(16)));
    _Static_assert(DISC_SAMPLES == 3, "a row's samples are the first three of four");
    row differs = {0};
    uint64_t halves[2];
    for (int j = 0; j < DISC_SAMPLES; j++) {
        row samples;
        memcpy(&samples, line[j] + x * DISC_SAMPLES, sizeof samples);
        differs |= samples ^ code;
    }
    differs &= (row){UINT32_MAX, UINT32_MAX, UINT32_MAX, 0};
    memcpy(halves, &differs, sizeof halves);
    return (halves[0] | halves[1]) == 0;
}

/* Fast for uniform pixels, which are the majority. */
static void resolve_row(resolver *r, int y)
{
    image *m = r->image;
    const uint32_t *line[DISC_SAMPLES];
    int row = y * DISC_SAMPLES - r->band->top, shown[2];
    for (int j = 0; j < DISC_SAMPLES; j++)
        line[j] = r->band->code + (size_t)(row + j) * (size_t)r->band->width;
    float ground = background(m, y);
    size_t first_pixel = (size_t)y * (size_t)m->width;
    memset(m->rgb + 3 * first_pixel, to_byte(r->table, ground), 3 * (size_t)m->width);
    drawn_pixels(r->band, row, shown);
    for (int x = shown[0]; x < shown[1]; x++) {
        size_t at = first_pixel + (size_t)x;
        uint32_t first = line[0][x * DISC_SAMPLES];
        if (!is_filled(line, x, first))
            mix_pixel(r, at, line, x, ground);
        else if (first)
            fill_pixel(r, at, first);
        m->hit[at] = line[DISC_SAMPLES / 2][x * DISC_SAMPLES + DISC_SAMPLES / 2];
    }
}

static void band_chunk(void *context, int worker, size_t begin, size_t end)
{
    const drawing *job = context;
    image *m = job->image;
    disc_band *b = &job->band[worker];
    for (size_t k = begin; k < end; k++) {
        int rows = job->bins.rows, all = m->height * DISC_SAMPLES;
        b->top = (int)k * rows;
        b->rows = all - b->top < rows ? all - b->top : rows;
        draw_band(m, &job->bins, k, b);
        resolver r = {.image = m, .band = b, .colors = job->colors, .table = job->table, .up = m->up};
        for (int y = b->top / DISC_SAMPLES; y < (b->top + b->rows) / DISC_SAMPLES; y++) resolve_row(&r, y);
        disc_band_empty(b);
    }
}

static bool make_bands(drawing *job, error *e)
{
    int width = job->image->width * DISC_SAMPLES, pixels = BAND_SAMPLES / (width * DISC_SAMPLES);
    job->bins.rows = (pixels < 1 ? 1 : pixels) * DISC_SAMPLES;
    job->bins.bands = (size_t)((job->image->height * DISC_SAMPLES + job->bins.rows - 1) / job->bins.rows);
    job->band = mem_alloc((size_t)threads_count(job->pool) * sizeof *job->band);
    for (int k = 0; k < threads_count(job->pool); k++) {
        disc_band *b = &job->band[k];
        size_t samples = (size_t)(width * job->bins.rows) + DISC_BLOCK;
        b->width = width;
        b->key = mem_array(samples, sizeof *b->key, "the preview's depths", e);
        b->code = mem_array(samples, sizeof *b->code, "the preview's samples", e);
        b->drawn = mem_array((size_t)job->bins.rows, sizeof *b->drawn, "the preview's samples", e);
        b->farthest = mem_array(disc_band_tiles(width, job->bins.rows), sizeof *b->farthest,
                                "the preview's samples", e);
        if (!b->key || !b->code || !b->drawn || !b->farthest) return false;
    }
    return true;
}

static bool draw(image *m, const quantity_look *look, threads *pool, error *e)
{
    unsigned char *table = mem_alloc(TABLE_SIZE);
    color *colors = shade_points(m, look, pool, e);
    drawing job = {.image = m, .pool = pool, .colors = colors, .table = table};
    bool ok = colors && make_bands(&job, e) && sort_into_bands(&job, e);
    if (ok) {
        make_table(table);
        threads_run(pool, job.bins.bands, 1, band_chunk, &job);
        if (!threads_may_go_on(pool, e)) ok = false;
    }
    for (int k = 0; job.band && k < threads_count(pool); k++) {
        free(job.band[k].key);
        free(job.band[k].code);
        free(job.band[k].drawn);
        free(job.band[k].farthest);
    }
    free(job.band);
    bins_free(&job.bins);
    free(colors);
    free(table);
    return ok;
}

/* ---- picture */

/* `shown`: the values that the colours show; or NULL. */
static bool is_drawable(const points *set, const double *shown, size_t i)
{
    const vec3 *p = &set->position[i], *n = &set->normal[i];
    double world =
        fabs(p->x) + fabs(p->y) + fabs(p->z) + fabs(requested(set, i)) + fabs(set->spacing_local[i]);
    double rest = fabs(n->x) + fabs(n->y) + fabs(n->z) + (shown ? fabs(shown[i]) : 0);
    return world < world_max && rest < (double)FLT_MAX;
}

typedef struct check_job {
    const points *set;
    const double *shown;
    atomic_size_t first; /* first point that cannot be drawn; or the count */
} check_job;

static void check_chunk(void *context, int worker, size_t begin, size_t end)
{
    check_job *job = context;
    (void)worker;
    for (size_t i = begin; i < end; i++) {
        if (is_drawable(job->set, job->shown, i)) continue;
        size_t first = atomic_load(&job->first);
        while (i < first && !atomic_compare_exchange_weak(&job->first, &first, i)) continue;
        return;
    }
}

static bool check_points(const points *set, const quantity_look *look, threads *pool, error *e)
{
    if (set->count == 0) return error_set(e, ERROR_INTERNAL, "a preview requires at least one point");
    if (set->count >= DISC_INDEX)
        return error_set(e, ERROR_INTERNAL,
                         "%zu points exceed the maximum of a preview: set output.preview to false",
                         set->count);
    check_job job = {set, quantity_has_scale(look->which) ? quantity_values(set, look) : NULL, set->count};
    threads_run(pool, set->count, POINTS_GRAIN, check_chunk, &job);
    const size_t first = atomic_load(&job.first);
    return first == set->count ||
           error_set(e, ERROR_INTERNAL, "point %zu has a value that is not finite or too large for a preview",
                     first);
}

/* Bounds of the sizes of discs, from the extent of the set; always > 0. */
typedef struct bounds {
    double radius_max, extent;
} bounds;

static bounds bound_set(const points *set)
{
    bbox box = bbox_empty();
    double largest = 0;
    for (size_t i = 0; i < set->count; i++) {
        box = bbox_include(box, set->position[i]);
        largest = compare_larger(largest, body_share * size_of(set, i));
    }
    double half_diagonal = 0.5 * vec3_norm(vec3_sub(box.max, box.min));
    double most = half_diagonal > 0 ? compare_smaller(largest, radius_max_share * half_diagonal) : largest;
    if (!(most > 0)) most = half_diagonal > 0 ? half_diagonal : 1; /* points without a size: dots */
    return (bounds){most, compare_larger(half_diagonal, most)};
}

/* The part of a picture that is available for the set. */
static camera_frame frame_of(const preview_options *o)
{
    double legend = legend_height(o->width, o->height),
           margin = margin_share * compare_smaller(o->width, o->height);
    return (camera_frame){margin, margin, o->width - 2 * margin, o->height - legend - 2 * margin, o->y_up};
}

void preview_orbit(const points *set, const preview_options *o, int frames, camera *out)
{
    if (!o->camera)
        camera_orbit(set->position, set->count, bound_set(set).radius_max, frame_of(o), frames, out);
    for (int k = 0; o->camera && k < frames; k++) {
        camera_place turned = camera_turn(o->camera, 2 * M_PI * k / frames);
        out[k] = camera_look(&turned, o->width, o->height);
    }
}

static double depth_beyond(const points *set, const camera *c, double radius)
{
    double far = 0;
    for (size_t i = 0; i < set->count; i++) far = compare_larger(far, camera_point(c, set->position[i]).z);
    return far + 2 * radius;
}

static image *new_image(const points *set, const preview_options *options, error *e)
{
    size_t pixels = (size_t)options->width * (size_t)options->height;
    image *m = mem_alloc(sizeof *m);
    m->width = options->width;
    m->height = options->height;
    m->points = *set;
    m->rgb = mem_array(pixels, 3, "the preview", e);
    m->rgba = mem_array(pixels, 4 * sizeof *m->rgba, "the preview", e);
    m->hit = mem_array(pixels, sizeof *m->hit, "the preview", e);
    if (m->rgb && m->rgba && m->hit) return m;
    preview_free(m);
    return NULL;
}

static bool render(const points *set, const preview_options *options, const camera *from, bounds b,
                   threads *pool, image **out, error *e)
{
    image *m = new_image(set, options, e);
    if (!m) return false;
    const quantity_look *look = &options->color;
    char note[48];
    m->camera = *from;
    m->up = camera_direction(from, options->y_up ? vec3_make(0, 1, 0) : vec3_make(0, 0, 1));
    m->scale_of_discs = options->thin ? thin_scale : 1;
    m->radius_max = b.radius_max;
    m->extent = b.extent;
    m->far = from->parallel ? depth_beyond(set, from, b.radius_max) : 0;
    if (!quantity_scale(set, look, m->extent, &m->scale, e) || !draw(m, look, pool, e)) {
        preview_free(m);
        return false;
    }
    snprintf(note, sizeof note, "%zu%s", set->count, options->thin ? ", thin walls" : " points");
    legend_draw(m->rgb, m->width, m->height, quantity_has_scale(look->which) ? &m->scale : NULL,
                quantity_title(look), note);
    *out = m;
    return true;
}

bool preview_render_from(const points *set, const preview_options *options, const camera *from, threads *pool,
                         image **out, error *e)
{
    return render(set, options, from, bound_set(set), pool, out, e);
}

bool preview_render(const points *set, const preview_options *o, threads *pool, image **out, error *e)
{
    if (o->width < PREVIEW_SIZE_MIN || o->width > PREVIEW_SIZE_MAX || o->height < PREVIEW_SIZE_MIN ||
        o->height > PREVIEW_SIZE_MAX)
        return error_set(e, ERROR_INTERNAL, "a preview of %d x %d pixels is outside the allowed size",
                         o->width, o->height);
    if (!check_points(set, &o->color, pool, e)) return false;
    const bounds b = bound_set(set);
    const camera c = o->camera ? camera_look(o->camera, o->width, o->height)
                               : camera_fit(set->position, set->count, b.radius_max, frame_of(o));
    return render(set, o, &c, b, pool, out, e);
}

void preview_free(image *m)
{
    if (!m) return;
    free(m->rgb);
    free(m->rgba);
    free(m->hit);
    free(m);
}

preview_span preview_span_at(const image *m, int x, int y)
{
    const uint32_t *hit = m->hit + (size_t)y * (size_t)m->width;
    uint32_t code = hit[x] & ~DISC_RING; /* the outline is only a darker shade */
    preview_span s = {.end = x + 1};
    while (s.end < m->width && (hit[s.end] & ~DISC_RING) == code) s.end++;
    if (code == 0) return s;
    size_t i = (code & DISC_INDEX) - 1;
    disc d = code & DISC_BODY ? body_of(m, i) : face_of(m, i);
    s.id = (uint32_t)(i + 1);
    s.normal = m->points.normal[i];
    s.kappa = m->points.kappa ? m->points.kappa[i] : 0;
    s.spacing = m->points.spacing_local[i];
    s.center = d.center;
    s.plane = d.normal;
    s.radius = d.radius;
    return s;
}

/* The intersection of the ray through a pixel with the disc. If the ray misses it, since the disc was drawn
 * as a dot: its centre. */
ISA_INLINE vec3 place_at(const camera *c, bool parallel, const preview_span *s, int x, int y)
{
    vec3 p = camera_ray(c, x + 0.5, y + 0.5), n = s->plane;
    if (parallel)
        p.z = s->center.z - (n.x * (p.x - s->center.x) + n.y * (p.y - s->center.y)) / n.z;
    else
        p = vec3_scale(p, vec3_dot(s->center, n) / vec3_dot(p, n));
    bool meets = vec3_norm2(vec3_sub(p, s->center)) <= s->radius * s->radius;
    return (vec3){meets ? p.x : s->center.x, meets ? p.y : s->center.y, meets ? p.z : s->center.z};
}

vec3 preview_place(const image *m, const preview_span *s, int x, int y)
{
    return place_at(&m->camera, m->camera.parallel, s, x, y);
}

ISA_CLONES void preview_depths(const image *m, const preview_span *s, int x, int y, float *restrict depth)
{
    const camera c = m->camera;
    const preview_span along = *s;
    if (c.parallel)
        for (int k = 0; k < along.end - x; k++) depth[k] = (float)place_at(&c, true, &along, x + k, y).z;
    else
        for (int k = 0; k < along.end - x; k++) depth[k] = (float)place_at(&c, false, &along, x + k, y).z;
}
