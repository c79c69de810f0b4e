#include "volume/samples.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"

#define SIDE GRID_VIEW_SIDE
#define VOXELS GRID_VIEW_VOXELS

/* Beyond this sums of floats overflow; nothing that is meant comes near it. */
static const float largest_value = 1e30f;

/* See along_line. A ball of 10 voxels comes within 4e-5 voxel of the one with all data at 0.25 to 1;
 * at 0, straight lines, it is 5e-4. */
static const double bend_limit = 0.5;

static const int stride_of[3] = {64, 8, 1};

static int floor_div8(int v)
{
    return v >= 0 ? v / SIDE : -((SIDE - 1 - v) / SIDE);
}

bool samples_plan(const crossings *c, int reach, block_map *map, error *e)
{
    for (size_t i = 0; i < c->count; i++) {
        const crossing_block *b = &c->blocks[i];
        int first[3], last[3];
        for (int axis = 0; axis < 3; axis++) {
            first[axis] = floor_div8(b->low[axis] - reach);
            last[axis] = floor_div8(b->high[axis] + 1 + reach);
        }
        for (int x = first[0]; x <= last[0]; x++)
            for (int y = first[1]; y <= last[1]; y++)
                for (int z = first[2]; z <= last[2]; z++)
                    if (!block_map_find_or_add(map, b->block[0] + x, b->block[1] + y, b->block[2] + z, NULL,
                                               e))
                        return false;
    }
    return true;
}

size_t samples_bytes(size_t count)
{
    return count * (VOXELS * sizeof(float) + SIDE * sizeof(uint64_t) + 6 * sizeof(uint32_t)) +
           block_map_bytes(count);
}

void samples_free(samples *s)
{
    block_map_free(&s->map);
    free(s->f);
    free(s->known);
    free(s->near);
    memset(s, 0, sizeof *s);
}

static void link_neighbours(samples *s)
{
    for (uint32_t n = 0; n < s->map.count; n++)
        for (int k = 0; k < 6; k++) {
            int32_t b[3];
            memcpy(b, s->map.blocks[n], sizeof b);
            b[k / 2] += k % 2 ? 1 : -1;
            s->near[6 * (size_t)n + (size_t)k] = block_map_find(&s->map, b[0], b[1], b[2]);
        }
}

static bool check_finite(const samples *s, error *e)
{
    size_t bad = 0, first = 0, total = (size_t)s->map.count * VOXELS;
    for (size_t i = 0; i < total; i++)
        if (!(fabsf(s->f[i]) <= largest_value)) {
            if (bad++ == 0) first = i;
        }
    if (bad == 0) return true;
    const int32_t *b = s->map.blocks[first / VOXELS];
    size_t v = first % VOXELS;
    return error_set(
        e, ERROR_INPUT_DAMAGED,
        "the volume has %zu voxels near its surface whose values are not finite or beyond %g, the first at (%d, %d, %d)",
        bad, (double)largest_value, b[0] * SIDE + (int)(v >> 6), b[1] * SIDE + (int)(v >> 3 & 7),
        b[2] * SIDE + (int)(v & 7));
}

bool samples_read(const grid_view *l, block_map *map, samples *out, error *e)
{
    samples s = {.map = *map};
    memset(map, 0, sizeof *map);
    size_t n = s.map.count;
    s.f = mem_array(n * VOXELS, sizeof *s.f, "the voxels around the surface", e);
    s.known = mem_array(n * SIDE, sizeof *s.known, "the voxels around the surface", e);
    s.near = mem_array(n * 6, sizeof *s.near, "the voxels around the surface", e);
    bool ok = s.f && s.known && s.near;
    if (ok) {
        for (size_t i = 0; i < n; i++) {
            const int32_t *b = s.map.blocks[i];
            grid_view_read(l, grid_view_find(l, b[0], b[1], b[2]), s.f + i * VOXELS, s.known + i * SIDE);
        }
        link_neighbours(&s);
        ok = check_finite(&s, e);
    }
    if (ok)
        *out = s;
    else
        samples_free(&s);
    return ok;
}

/* ---- continuing a clamped band */

static uint64_t known_word(const samples *s, uint32_t block, int x)
{
    return block == BLOCK_MAP_NONE ? 0 : s->known[(size_t)block * SIDE + (size_t)x];
}

/* The voxels of the layer x of a block that are not known but have a known one beside them: bit by
 * bit in the result, and in towards[k] for the neighbour below and above along each axis. */
static uint64_t frontier(const samples *s, uint32_t block, int x, uint64_t towards[6])
{
    const uint64_t row_low = 0x0101010101010101u, row_high = 0x8080808080808080u;
    const uint32_t *near = s->near + 6 * (size_t)block;
    uint64_t here = known_word(s, block, x), any = 0;
    if (here == ~(uint64_t)0) return 0;
    towards[0] = x > 0 ? known_word(s, block, x - 1) : known_word(s, near[0], SIDE - 1);
    towards[1] = x < SIDE - 1 ? known_word(s, block, x + 1) : known_word(s, near[1], 0);
    towards[2] = here << 8 | known_word(s, near[2], x) >> 56;
    towards[3] = here >> 8 | known_word(s, near[3], x) << 56;
    towards[4] = (here << 1 & ~row_low) | (known_word(s, near[4], x) >> 7 & row_low);
    towards[5] = (here >> 1 & ~row_high) | (known_word(s, near[5], x) << 7 & row_high);
    for (int k = 0; k < 6; k++) any |= towards[k];
    return any & ~here;
}

/* The value `step` voxels from `at` along an axis, if it is known; |step| <= 8. */
static inline bool peek(const samples *s, uint32_t block, const int at[3], int axis, int step, double *value)
{
    int to = at[axis] + step;
    if (to < 0 || to >= SIDE) {
        block = s->near[6 * (size_t)block + (size_t)(2 * axis + (to >= SIDE))];
        if (block == BLOCK_MAP_NONE) return false;
        to &= SIDE - 1;
    }
    int offset = 64 * at[0] + 8 * at[1] + at[2] + (to - at[axis]) * stride_of[axis];
    if (!(s->known[(size_t)block * SIDE + (size_t)(offset >> 6)] >> (offset & 63) & 1)) return false;
    *value = (double)s->f[(size_t)block * VOXELS + (size_t)offset];
    return true;
}

/* What the line through voxels at distances 1, 2 (values a, b) and, if known, 3 (c) says of the voxel
 * at 0. The parabola of a curved surface is followed where it is gentle: a bend of more than
 * `bend_limit` of the slope is an edge or noise, which a parabola would throw far off. */
static double along_line(double a, double b, const double *c)
{
    double bend = c ? a - 2 * b + *c : 0, most = bend_limit * fabs(a - b);
    return 2 * a - b + (bend > most ? most : bend < -most ? -most : bend);
}

/* The clamped value that a voxel still has gives the side, and the least distance. The bounds hold off what
 * meeting fronts could build up; they are loose, so that the continuation has no edge at the clamp. */
static float continued(const samples *s, uint32_t block, int x, int bit, const uint64_t towards[6], int layer)
{
    const int at[3] = {x, bit >> 3, bit & 7};
    const double raw = (double)s->f[(size_t)block * VOXELS + (size_t)(64 * x + bit)];
    double lines = 0, flats = 0, a, b, c;
    int line_count = 0, flat_count = 0;
    for (int k = 0; k < 6; k++) {
        int axis = k / 2, step = k % 2 ? 1 : -1;
        if (!(towards[k] >> bit & 1) || !peek(s, block, at, axis, step, &a)) continue;
        flats += a;
        flat_count++;
        if (!peek(s, block, at, axis, 2 * step, &b)) continue;
        lines += along_line(a, b, peek(s, block, at, axis, 3 * step, &c) ? &c : NULL);
        line_count++;
    }
    double value = line_count ? lines / line_count : flat_count ? flats / flat_count : raw;
    double size = fabs(raw), side = raw < 0 ? -1 : 1, reach = side * value;
    if (reach < 0.5 * size) reach = 0.5 * size;
    if (reach > size * (1 + layer)) reach = size * (1 + layer);
    return (float)(side * reach);
}

/* One layer; the bits are committed only afterwards, so that the order of blocks does not matter. */
static uint64_t extend_layer(samples *s, uint64_t *fresh, int layer)
{
    uint64_t changed = 0;
    for (uint32_t n = 0; n < s->map.count; n++)
        for (int x = 0; x < SIDE; x++) {
            uint64_t towards[6], bits = frontier(s, n, x, towards);
            fresh[(size_t)n * SIDE + (size_t)x] = bits;
            changed |= bits;
            for (; bits; bits &= bits - 1) {
                int bit = __builtin_ctzll(bits);
                s->f[(size_t)n * VOXELS + (size_t)(64 * x + bit)] = continued(s, n, x, bit, towards, layer);
            }
        }
    for (size_t i = 0; i < (size_t)s->map.count * SIDE; i++) s->known[i] |= fresh[i];
    return changed;
}

bool samples_fill_unknown(samples *s, error *e)
{
    uint64_t *fresh =
        mem_array((size_t)s->map.count * SIDE, sizeof *fresh, "the voxels around the surface", e);
    if (!fresh) return false;
    for (int layer = 1; extend_layer(s, fresh, layer); layer++) continue;
    free(fresh);
    return true;
}

/* ---- the interpolating spline's coefficients */

/* A run of blocks along an axis as rows of 64 lines: rows[64 k + line], k along the axis. */
static void copy_run(samples *s, int axis, uint32_t first, double *rows, bool back)
{
    int along = stride_of[axis], a = stride_of[axis == 0 ? 1 : 0], b = stride_of[axis == 2 ? 1 : 2];
    for (uint32_t n = first; n != BLOCK_MAP_NONE; n = s->near[6 * (size_t)n + (size_t)(2 * axis + 1)]) {
        float *f = s->f + (size_t)n * VOXELS;
        for (int k = 0; k < SIDE; k++, rows += 64)
            for (int i = 0; i < SIDE; i++)
                for (int j = 0; j < SIDE; j++) {
                    if (back)
                        f[k * along + i * a + j * b] = (float)rows[8 * i + j];
                    else
                        rows[8 * i + j] = (double)f[k * along + i * a + j * b];
                }
    }
}

/* c[k-1] + 4 c[k] + c[k+1] = 6 s[k] within, c = s at both ends. */
static void solve_run(double *rows, double *ratio, size_t length)
{
    ratio[0] = 0;
    for (size_t k = 1; k + 1 < length; k++) {
        ratio[k] = 1 / (4 - ratio[k - 1]);
        double *row = rows + 64 * k;
        for (int i = 0; i < 64; i++) row[i] = (6 * row[i] - row[i - 64]) * ratio[k];
    }
    for (size_t k = length - 2; k > 0; k--) {
        double *row = rows + 64 * k;
        for (int i = 0; i < 64; i++) row[i] -= ratio[k] * row[i + 64];
    }
}

static size_t run_length(const samples *s, int axis, uint32_t first)
{
    size_t length = 0;
    for (uint32_t n = first; n != BLOCK_MAP_NONE; n = s->near[6 * (size_t)n + (size_t)(2 * axis + 1)])
        length += SIDE;
    return length;
}

static bool starts_run(const samples *s, int axis, uint32_t n)
{
    return s->near[6 * (size_t)n + (size_t)(2 * axis)] == BLOCK_MAP_NONE;
}

bool samples_prefilter(samples *s, error *e)
{
    size_t longest = 0;
    for (int axis = 0; axis < 3; axis++)
        for (uint32_t n = 0; n < s->map.count; n++) {
            size_t length = starts_run(s, axis, n) ? run_length(s, axis, n) : 0;
            if (length > longest) longest = length;
        }
    double *rows = mem_array(65 * longest, sizeof *rows, "a run of voxels", e);
    if (!rows) return false;
    for (int axis = 0; axis < 3; axis++)
        for (uint32_t n = 0; n < s->map.count; n++) {
            if (!starts_run(s, axis, n)) continue;
            copy_run(s, axis, n, rows, false);
            solve_run(rows, rows + 64 * longest, run_length(s, axis, n));
            copy_run(s, axis, n, rows, true);
        }
    free(rows);
    return true;
}

/* ---- taking cubes out */

void samples_window(const samples *s, const int32_t block[3], int low, int side, float *out)
{
    uint32_t around[27];
    for (int k = 0; k < 27; k++)
        around[k] =
            block_map_find(&s->map, block[0] + k / 9 - 1, block[1] + k / 3 % 3 - 1, block[2] + k % 3 - 1);
    for (int x = low; x < low + side; x++)
        for (int y = low; y < low + side; y++) {
            int column = 9 * (floor_div8(x) + 1) + 3 * (floor_div8(y) + 1);
            size_t offset = (size_t)(64 * (x & 7) + 8 * (y & 7));
            for (int z = low; z < low + side; z++) {
                uint32_t n = around[column + floor_div8(z) + 1];
                *out++ = n == BLOCK_MAP_NONE ? 0 : s->f[(size_t)n * VOXELS + offset + (size_t)(z & 7)];
            }
        }
}

void samples_corners(const samples *s, const int32_t block[3], bool smooth, float corners[729])
{
    if (!smooth) {
        samples_window(s, block, 0, 9, corners);
        return;
    }
    float c[11 * 11 * 11];
    samples_window(s, block, -1, 11, c);
    static const int step_of[3] = {121, 11, 1};
    for (int axis = 0; axis < 3; axis++) { /* in place: what is read behind is kept in `before` */
        int d = step_of[axis], a = step_of[axis == 0 ? 1 : 0], b = step_of[axis == 2 ? 1 : 2];
        for (int i = 0; i < 11; i++)
            for (int j = 0; j < 11; j++) {
                float *line = c + i * a + j * b, before = line[0];
                for (int k = 1; k < 10; k++) {
                    float here = line[k * d];
                    line[k * d] =
                        (float)(((double)before + 4 * (double)here + (double)line[(k + 1) * d]) / 6);
                    before = here;
                }
            }
    }
    for (int x = 0; x < 9; x++)
        for (int y = 0; y < 9; y++)
            for (int z = 0; z < 9; z++) *corners++ = c[((x + 1) * 11 + y + 1) * 11 + z + 1];
}

void samples_known(const samples *s, const int32_t block[3], uint16_t known[81])
{
    memset(known, 0, 81 * sizeof *known);
    for (int k = 0; k < 8; k++) {
        const int upper[3] = {k & 1, k >> 1 & 1, k >> 2};
        uint32_t n = block_map_find(&s->map, block[0] + upper[0], block[1] + upper[1], block[2] + upper[2]);
        for (int x = upper[0] * SIDE; n != BLOCK_MAP_NONE && x < (upper[0] ? 9 : SIDE); x++)
            for (int y = upper[1] * SIDE; y < (upper[1] ? 9 : SIDE); y++) {
                unsigned row =
                    (unsigned)(s->known[(size_t)n * SIDE + (size_t)(x & 7)] >> (8 * (y & 7))) & 0xFF;
                known[9 * x + y] = (uint16_t)(known[9 * x + y] | (upper[2] ? (row & 1) << SIDE : row));
            }
    }
}
