// SPDX-License-Identifier: Apache-2.0
#include "io/pictures/disc.h"

#include <math.h>
#include <string.h>

#include "base/core/compare.h"
#include "base/core/isa.h"

static const double ring_share = 0.88; /* the outline starts at this fraction of the radius */

void disc_band_begin(const disc_band *b)
{
    for (int row = 0; row < b->rows; row++) {
        b->drawn[row][0] = b->width;
        b->drawn[row][1] = 0;
    }
}

void disc_band_empty(const disc_band *b)
{
    for (int row = 0; row < b->rows; row++) {
        const int *drawn = b->drawn[row];
        if (drawn[0] >= drawn[1]) continue;
        size_t at = (size_t)row * (size_t)b->width + (size_t)drawn[0], count = (size_t)(drawn[1] - drawn[0]);
        memset(b->key + at, 0, count * sizeof *b->key);
        memset(b->code + at, 0, count * sizeof *b->code);
    }
}

ISA_INLINE void note_drawn(const disc_band *b, int row, int first, int end)
{
    int *drawn = b->drawn[row];
    if (first < drawn[0]) drawn[0] = first;
    if (end > drawn[1]) drawn[1] = end;
}

/* Converts to int, clamped to [low, high]; NaN gives low. */
ISA_INLINE int whole(double value, int low, int high)
{
    if (!(value > low)) return low;
    return value < high ? (int)value : high;
}

/* The range of samples that the bounding box of a disc may cover. The extents of a disc along each axis are
 * exact, and the perspective image of a box lies between the images of its corners. */
static bool range_of(const camera *c, const disc *d, const disc_band *b, int range[4])
{
    vec3 n = d->normal, p = d->center;
    double rx = d->radius * sqrt(compare_larger(1 - n.x * n.x, 0)),
           ry = d->radius * sqrt(compare_larger(1 - n.y * n.y, 0));
    double rz = d->radius * sqrt(compare_larger(1 - n.z * n.z, 0));
    double near = camera_scale(c, p.z - rz), far = camera_scale(c, p.z + rz);
    double left = c->center_x + compare_smaller((p.x - rx) * near, (p.x - rx) * far);
    double right = c->center_x + compare_larger((p.x + rx) * near, (p.x + rx) * far);
    double top = c->center_y - compare_larger((p.y + ry) * near, (p.y + ry) * far);
    double bottom = c->center_y - compare_smaller((p.y - ry) * near, (p.y - ry) * far);
    range[0] = whole(ceil(left * DISC_SAMPLES - 0.5), 0, b->width);
    range[1] = whole(floor(right * DISC_SAMPLES - 0.5), -1, b->width - 1);
    range[2] = whole(ceil(top * DISC_SAMPLES - 0.5), b->top, b->top + b->rows);
    range[3] = whole(floor(bottom * DISC_SAMPLES - 0.5), b->top - 1, b->top + b->rows - 1);
    return range[0] <= range[1] && range[2] <= range[3];
}

/* The range of a length from low to high multiplied by one of two scales. */
static void span_of(double middle, double radius, double near, double far, double out[2])
{
    out[0] = compare_smaller((middle - radius) * near, (middle - radius) * far);
    out[1] = compare_larger((middle + radius) * near, (middle + radius) * far);
}

/* A dot is drawn in the row of its centre; the range of rows includes it. */
void disc_ball_rows(const camera *c, const disc_ball *ball, int rows, int *first, int *last)
{
    double up[2], r = ball->radius, z = ball->center.z;
    span_of(ball->center.y, r, camera_scale(c, z - r), camera_scale(c, z + r), up);
    *first = whole(floor((c->center_y - up[1]) * DISC_SAMPLES), 0, rows);
    *last = whole(floor((c->center_y - up[0]) * DISC_SAMPLES), -1, rows - 1);
}

/* Size of a tile in samples. */
enum { TILE_WIDTH = 16, TILE_ROWS = 8 };
_Static_assert((int)TILE_WIDTH <= (int)DISC_BLOCK, "the keys of a tile in the last row are there");

static size_t tiles_along(int length, int tile)
{
    return (size_t)((length + tile - 1) / tile);
}

size_t disc_band_tiles(int width, int rows)
{
    return tiles_along(width, TILE_WIDTH) * tiles_along(rows, TILE_ROWS);
}

/* The minimum of `least` and the keys of a tile in a row. Keys are not negative: their bits, as integers,
 * have the same order. */
ISA_INLINE float least_key(const float *key, float least)
{
    uint32_t bits[TILE_WIDTH], low;
    memcpy(bits, key, sizeof bits);
    memcpy(&low, &least, sizeof low);
    for (int k = 0; k < TILE_WIDTH; k++) low = bits[k] < low ? bits[k] : low;
    memcpy(&least, &low, sizeof least);
    return least;
}

/* Samples beyond the band are ignored. A tile that extends beyond the end of a row also reads the start of
 * the next row; this can only make the bound smaller. */
ISA_CLONES void disc_band_note_tiles(const disc_band *b)
{
    const size_t across = tiles_along(b->width, TILE_WIDTH);
    for (int top = 0; top < b->rows; top += TILE_ROWS)
        for (size_t at = 0; at < across; at++) {
            const int left = (int)at * TILE_WIDTH;
            float least = INFINITY;
            for (int row = top; row < top + TILE_ROWS && row < b->rows && least > 0; row++) {
                const bool drawn = left < b->drawn[row][1] && left + TILE_WIDTH > b->drawn[row][0];
                least = drawn ? least_key(b->key + (size_t)row * (size_t)b->width + left, least) : 0;
            }
            b->farthest[(size_t)(top / TILE_ROWS) * across + at] = least;
        }
}

/* Relative tolerance of keys, which are rounded. */
static const double key_tolerance = 1e-5;

bool disc_ball_is_hidden(const camera *c, double far, const disc_ball *ball, const disc_band *b)
{
    const size_t across = tiles_along(b->width, TILE_WIDTH);
    const double r = ball->radius, z = ball->center.z, key = c->parallel ? far - (z - r) : 1 / (z - r);
    double along[2];
    int first, last;
    disc_ball_rows(c, ball, b->top + b->rows, &first, &last);
    if (first < b->top) first = b->top;
    span_of(ball->center.x, r, camera_scale(c, z - r), camera_scale(c, z + r), along);
    const int left = whole(floor((c->center_x + along[0]) * DISC_SAMPLES), 0, b->width),
              right = whole(floor((c->center_x + along[1]) * DISC_SAMPLES), -1, b->width - 1);
    bool hidden = true;
    for (int y = first - b->top; hidden && y <= last - b->top; y += TILE_ROWS - y % TILE_ROWS)
        for (int x = left / TILE_WIDTH; hidden && x <= right / TILE_WIDTH && left <= right; x++)
            hidden =
                (double)b->farthest[(size_t)(y / TILE_ROWS) * across + (size_t)x] > (1 + key_tolerance) * key;
    return hidden;
}

ISA_INLINE double sample_place(int sample)
{
    return (sample + 0.5) / DISC_SAMPLES;
}

/* A disc along one row of samples. A ray (x, y, 1) from the eye meets its plane at 1/z = w / offset with w =
 * ray . normal, at v / w from its centre with v = offset ray - w centre. v and w are linear in x, so that the
 * places within a distance of the centre are the interval between the roots of a quadratic. Abscissae are
 * relative to the centre, where v is small. A parallel ray meets the plane at v / w with w = normal .
 * forward, at a depth that is linear in x. */
typedef struct section {
    double square, linear, constant; /* coefficients of |v|^2 as a polynomial of the abscissa */
    double slope, level;             /* coefficients of w */
} section;

ISA_INLINE section section_at_parallel(const disc *d, double ray_y)
{
    vec3 n = d->normal, turn = {n.z, 0, -n.x};
    double y = ray_y - d->center.y;
    vec3 start = {0, n.z * y, -n.y * y};
    return (section){vec3_norm2(turn), 2 * vec3_dot(turn, start), vec3_norm2(start), 0, n.z};
}

ISA_INLINE section section_at(const disc *d, double offset, double ray_y)
{
    vec3 p = d->center, n = d->normal;
    section s = {.slope = n.x, .level = n.x * p.x / p.z + ray_y * n.y + n.z};
    vec3 turn = vec3_axpy(-n.x, p, (vec3){offset, 0, 0});
    vec3 start = vec3_axpy(-s.level, p, vec3_scale((vec3){p.x / p.z, ray_y, 1}, offset));
    s.square = vec3_norm2(turn);
    s.linear = 2 * vec3_dot(turn, start);
    s.constant = vec3_norm2(start);
    return s;
}

/* The interval of abscissae within a distance of the centre; `limit` is the squared distance. False: it is
 * empty. */
ISA_INLINE bool section_within(const section *s, double limit, double out[2])
{
    double a = s->square - limit * s->slope * s->slope, b = s->linear - 2 * limit * s->slope * s->level;
    double c = s->constant - limit * s->level * s->level, root2 = b * b - 4 * a * c;
    if (!(a > 0) || !(root2 >= 0)) return false; /* a <= 0 only if the plane contains the eye */
    double root = sqrt(root2), half = 0.5 / a;
    out[0] = (-b - root) * half;
    out[1] = (-b + root) * half;
    return true;
}

/* Inverse depths (orthographic: distance to `far`) as a polynomial of the sample index, and the code to store
 * where they are the maximum so far. */
typedef struct run {
    double square, linear, constant;
    uint32_t code;
} run;

/* The range of samples of a row that a disc covers, the range inside its outline, and the abscissa of
 * sample 0. */
typedef struct row_range {
    int all[2], plain[2];
    double first, step;
} row_range;

/* Draws DISC_BLOCK samples at a time, also beyond the end of the range, where nothing changes: without
 * branches the loop vectorises. Within a block the polynomial is evaluated relative to its start, in single
 * precision: this part is small. No multiplication and addition are fused, so that results are the same on
 * every machine. */
ISA_INLINE void draw_run(const run *r, const row_range *t, float *key, uint32_t *code)
{
    float bend = (float)(r->square * t->step * t->step);
    uint32_t plain = r->code, ring = plain | DISC_RING;
    for (int from = t->all[0]; from < t->all[1]; from += DISC_BLOCK) {
        double x = t->first + from * t->step;
        float base = (float)((r->square * x + r->linear) * x + r->constant);
        float slope = (float)((2 * r->square * x + r->linear) * t->step);
        int end = t->all[1] - from, plain_begin = t->plain[0] - from, plain_end = t->plain[1] - from;
        float *restrict keys = key + from;
        uint32_t *restrict codes = code + from;
        for (int k = 0; k < DISC_BLOCK; k++) {
            float at = (float)k, here = base + (slope + bend * at) * at, before = keys[k];
            uint32_t shown = (k < plain_begin) | (k >= plain_end) ? ring : plain;
            bool wins = (here > before) & (k < end);
            keys[k] = wins ? here : before;
            codes[k] = wins ? shown : codes[k];
        }
    }
}

/* The abscissae of the samples of a row for the current disc. */
typedef struct abscissae {
    double first, step, per_step;
    int width;
} abscissae;

ISA_INLINE void to_samples(const abscissae *a, const double between[2], int out[2])
{
    out[0] = whole(ceil((between[0] - a->first) * a->per_step), 0, a->width);
    out[1] = whole(floor((between[1] - a->first) * a->per_step) + 1, out[0], a->width);
}

/* Draws the interval of the disc, its outline separately. */
ISA_INLINE void draw_section(const abscissae *a, const section *s, const run *r, double limit,
                             double ring_limit, const disc_band *b, int row)
{
    size_t start = (size_t)row * (size_t)b->width;
    row_range t = {.first = a->first, .step = a->step};
    double within[2];
    if (!section_within(s, limit, within)) return;
    to_samples(a, within, t.all);
    if (t.all[1] <= t.all[0]) return;
    note_drawn(b, row, t.all[0], t.all[1]);
    t.plain[0] = t.plain[1] = t.all[1];
    if (section_within(s, ring_limit, within)) to_samples(a, within, t.plain);
    draw_run(r, &t, b->key + start, b->code + start);
}

/* The run of a disc along the row through ray_y. Exact except for the cone, which is computed as for a
 * distant disc: it only breaks ties. */
ISA_INLINE run run_along(const camera *c, const disc *d, const section *s, double offset, double ray_y,
                         double far)
{
    double limit = d->radius * d->radius, inverse = 1 / offset, cone = d->cone / limit * inverse * inverse;
    run r = {-cone * s->square, -cone * s->linear, -cone * s->constant, d->code};
    if (c->parallel) {
        r.linear += d->normal.x * inverse;
        r.constant += far - d->center.z + d->normal.y * (ray_y - d->center.y) * inverse;
    } else {
        r.linear += s->slope * inverse;
        r.constant += s->level * inverse;
    }
    return r;
}

ISA_CLONES void disc_draw(const camera *c, double far, const disc *d, const disc_band *b)
{
    int range[4];
    double offset = vec3_dot(camera_sight(c, d->center), d->normal), limit = d->radius * d->radius;
    if (!range_of(c, d, b, range) || !(fabs(offset) > 0) || !(limit > 0)) return;
    double ring_limit = d->ring ? limit * ring_share * ring_share : limit;
    double middle = c->parallel ? d->center.x : d->center.x / d->center.z;
    const abscissae a = {(sample_place(0) - c->center_x) / c->focal - middle, 1 / (DISC_SAMPLES * c->focal),
                         DISC_SAMPLES * c->focal, b->width};
    const double top = camera_ray(c, 0, sample_place(0)).y;
    for (int y = range[2]; y <= range[3]; y++) {
        double ray_y = top - y * a.step;
        section s = c->parallel ? section_at_parallel(d, ray_y) : section_at(d, offset, ray_y);
        const run r = run_along(c, d, &s, offset, ray_y, far);
        draw_section(&a, &s, &r, limit, ring_limit, b, y - b->top);
    }
}

void disc_draw_dot(const camera *c, double far, const disc *d, const disc_band *b)
{
    double at_x, at_y;
    camera_project(c, d->center, &at_x, &at_y);
    int x = whole(floor(at_x * DISC_SAMPLES), -1, b->width),
        y = whole(floor(at_y * DISC_SAMPLES) - b->top, -1, b->rows);
    if (x < 0 || x >= b->width || y < 0 || y >= b->rows) return;
    size_t at = (size_t)y * (size_t)b->width + (size_t)x;
    float here = (float)(c->parallel ? far - d->center.z : 1 / d->center.z);
    if (here <= b->key[at]) return;
    note_drawn(b, y, x, x + 1);
    b->key[at] = here;
    b->code[at] = d->code;
}
