#include "labels/label_majority.h"

#include <math.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"

static const char what[] = "the majority of the labels";

/* Voxels along a side of a block; how far the filter reaches, in widths. */
enum { BLOCK = 32, REACH = 3 };

/* What one thread works on: a block and what is around it. The filter is applied along one axis after the other. */
typedef struct scratch {
    uint16_t *label, *present; /* of the voxels, and those that occur */
    float *along_x, *along_y, *all, *most;
    uint16_t *held, *best; /* before, and now */
} scratch;

typedef struct filtering {
    const label_volume *v;
    uint16_t *out;
    int64_t blocks[3];
    int reach;
    float *weight; /* of -reach .. reach */
    scratch *on;   /* of each worker */
    atomic_ullong changed;
} filtering;

/* Labels of what is around a block; beyond the end, and in the layer, there is none. */
enum { NONE = LABEL_VOLUME_MOST };

static bool is_inside(const label_volume *v, int axis, int64_t at)
{
    return at >= v->around && at < v->size[axis] - v->around;
}

static size_t note_label(uint16_t *present, size_t count, uint16_t label)
{
    for (size_t k = count; k-- > 0;)
        if (present[k] == label) return count;
    present[count] = label;
    return count + 1;
}

/* Returns how many labels there are. */
static size_t gather(const filtering *f, const int64_t low[3], scratch *on)
{
    const label_volume *v = f->v;
    const int64_t side = BLOCK + 2 * f->reach;
    size_t count = 0;
    uint16_t last = NONE, *to = on->label;
    for (int64_t z = low[2] - f->reach; z < low[2] - f->reach + side; z++)
        for (int64_t y = low[1] - f->reach; y < low[1] - f->reach + side; y++)
            for (int64_t x = low[0] - f->reach; x < low[0] - f->reach + side; x++) {
                const bool inside = is_inside(v, 0, x) && is_inside(v, 1, y) && is_inside(v, 2, z);
                *to = inside ? label_volume_at(v, x, y, z) : NONE;
                if (*to != NONE && *to != last) count = note_label(on->present, count, last = *to);
                to++;
            }
    return count;
}

static bool filter_row(const filtering *f, const uint16_t *label, uint16_t own, float out[BLOCK])
{
    bool any = false;
    for (int k = 0; k < BLOCK + 2 * f->reach; k++) any |= label[k] == own;
    if (!any) return false;
    memset(out, 0, BLOCK * sizeof *out);
    for (int k = 0; k <= 2 * f->reach; k++)
        for (int x = 0; x < BLOCK; x++) out[x] += label[x + k] == own ? f->weight[k] : 0;
    return true;
}

/* Adds up rows of BLOCK that lie `stride` from each other. */
static void filter_rows(const filtering *f, const float *rows, size_t stride, float out[BLOCK])
{
    memset(out, 0, BLOCK * sizeof *out);
    for (int k = 0; k <= 2 * f->reach; k++)
        for (int x = 0; x < BLOCK; x++) out[x] += f->weight[k] * rows[(size_t)k * stride + (size_t)x];
}

/* The smoothed indicator of one label, in on->all. */
static void smooth_indicator(const filtering *f, uint16_t own, scratch *on)
{
    const size_t side = (size_t)(BLOCK + 2 * f->reach);
    for (size_t row = 0; row < side * side; row++)
        if (!filter_row(f, on->label + row * side, own, on->along_x + row * BLOCK))
            memset(on->along_x + row * BLOCK, 0, BLOCK * sizeof *on->along_x);
    for (size_t z = 0; z < side; z++)
        for (size_t y = 0; y < BLOCK; y++)
            filter_rows(f, on->along_x + (z * side + y) * BLOCK, BLOCK,
                        on->along_y + (z * BLOCK + y) * BLOCK);
    for (size_t z = 0; z < BLOCK; z++)
        for (size_t y = 0; y < BLOCK; y++)
            filter_rows(f, on->along_y + (z * BLOCK + y) * BLOCK, (size_t)BLOCK * BLOCK,
                        on->all + (z * BLOCK + y) * BLOCK);
}

/* The largest of each voxel: its own unless another is larger. */
static void choose(const filtering *f, size_t count, scratch *on)
{
    const size_t side = (size_t)(BLOCK + 2 * f->reach), reach = (size_t)f->reach,
                 voxels = BLOCK * BLOCK * BLOCK;
    for (size_t k = 0; k < voxels; k++) {
        on->most[k] = 0;
        on->held[k] = on->label[((k / BLOCK / BLOCK + reach) * side + k / BLOCK % BLOCK + reach) * side +
                                k % BLOCK + reach];
    }
    for (size_t n = 0; n < count; n++) {
        const uint16_t own = on->present[n];
        smooth_indicator(f, own, on);
        for (size_t k = 0; k < voxels; k++) {
            const bool more = on->all[k] > on->most[k] || (on->all[k] == on->most[k] && on->held[k] == own);
            on->most[k] = more ? on->all[k] : on->most[k];
            on->best[k] = more ? own : on->best[k];
        }
    }
}

static void put(filtering *f, const int64_t low[3], const scratch *on)
{
    const int64_t *size = f->v->size;
    unsigned long long changed = 0;
    for (int64_t z = low[2]; z < low[2] + BLOCK && is_inside(f->v, 2, z); z++)
        for (int64_t y = low[1]; y < low[1] + BLOCK && is_inside(f->v, 1, y); y++)
            for (int64_t x = low[0]; x < low[0] + BLOCK && is_inside(f->v, 0, x); x++) {
                const uint16_t best = on->best[((z - low[2]) * BLOCK + y - low[1]) * BLOCK + x - low[0]];
                uint16_t *to = &f->out[(z * size[1] + y) * size[0] + x];
                changed += *to != best;
                *to = best;
            }
    atomic_fetch_add_explicit(&f->changed, changed, memory_order_relaxed);
}

static void filter_blocks(void *context, int worker, size_t begin, size_t end)
{
    filtering *f = context;
    scratch *on = &f->on[worker];
    for (size_t n = begin; n < end; n++) {
        const int64_t at[3] = {(int64_t)n % f->blocks[0], (int64_t)n / f->blocks[0] % f->blocks[1],
                               (int64_t)n / f->blocks[0] / f->blocks[1]};
        int64_t low[3];
        for (int k = 0; k < 3; k++) low[k] = f->v->around + BLOCK * at[k];
        const size_t count = gather(f, low, on);
        if (count < 2) continue;
        choose(f, count, on);
        put(f, low, on);
    }
}

/* ---- the whole */

/* What make_scratch takes. */
static size_t scratch_bytes(const label_volume *v, int reach)
{
    const size_t side = (size_t)(BLOCK + 2 * reach), voxels = BLOCK * BLOCK * BLOCK;
    const scratch *on = NULL;
    return side * side * side * sizeof *on->label + v->count * sizeof *on->present +
           side * side * BLOCK * sizeof *on->along_x + side * BLOCK * BLOCK * sizeof *on->along_y +
           voxels * (sizeof *on->all + sizeof *on->most + sizeof *on->held + sizeof *on->best);
}

static bool make_scratch(scratch *on, const label_volume *v, int reach, error *e)
{
    const size_t side = (size_t)(BLOCK + 2 * reach), voxels = BLOCK * BLOCK * BLOCK;
    return (on->label = mem_array(side * side * side, sizeof *on->label, what, e)) &&
           (on->present = mem_array(v->count, sizeof *on->present, what, e)) &&
           (on->along_x = mem_array(side * side * BLOCK, sizeof *on->along_x, what, e)) &&
           (on->along_y = mem_array(side * BLOCK * BLOCK, sizeof *on->along_y, what, e)) &&
           (on->all = mem_array(voxels, sizeof *on->all, what, e)) &&
           (on->most = mem_array(voxels, sizeof *on->most, what, e)) &&
           (on->held = mem_array(voxels, sizeof *on->held, what, e)) &&
           (on->best = mem_array(voxels, sizeof *on->best, what, e));
}

static void free_scratch(scratch *on)
{
    free(on->label);
    free(on->present);
    free(on->along_x);
    free(on->along_y);
    free(on->all);
    free(on->most);
    free(on->held);
    free(on->best);
}

static void set_weights(filtering *f, double width)
{
    double sum = 0;
    for (int k = -f->reach; k <= f->reach; k++) sum += exp(-0.5 * k * k / (width * width));
    for (int k = -f->reach; k <= f->reach; k++)
        f->weight[k + f->reach] = (float)(exp(-0.5 * k * k / (width * width)) / sum);
}

static void count_again(label_volume *v)
{
    for (size_t k = 0; k < v->count; k++) {
        v->material[k].before = v->material[k].voxels;
        label_material_clear(&v->material[k]);
    }
    for (int64_t z = v->around; is_inside(v, 2, z); z++)
        for (int64_t y = v->around; is_inside(v, 1, y); y++)
            for (int64_t x = v->around; is_inside(v, 0, x); x++)
                label_material_note(&v->material[label_volume_at(v, x, y, z)],
                                    (const int64_t[3]){x - v->around, y - v->around, z - v->around});
}

static bool check_memory(const label_volume *v, int reach, size_t workers, size_t memory_limit, error *e)
{
    const size_t needed = 2 * label_volume_bytes(v) + workers * scratch_bytes(v, reach);
    return needed <= memory_limit ||
           error_set(
               e, ERROR_LIMIT_MEMORY,
               "surface.labels.majority needs %zu MiB and %zu MiB are left of the limit: raise limits.memory_mb",
               (needed >> 20) + 1, memory_limit >> 20);
}

bool label_majority_apply(label_volume *v, double width, size_t memory_limit, threads *pool, error *e)
{
    if (!(width > 0)) return true;
    const size_t workers = (size_t)threads_count(pool),
                 voxels = (size_t)(v->size[0] * v->size[1] * v->size[2]);
    filtering f = {.v = v, .reach = (int)ceil(REACH * width)};
    size_t blocks = 1;
    if (!check_memory(v, f.reach, workers, memory_limit, e)) return false;
    for (int k = 0; k < 3; k++) {
        f.blocks[k] = (v->size[k] - 2 * v->around + BLOCK - 1) / BLOCK;
        blocks *= (size_t)f.blocks[k];
    }
    atomic_init(&f.changed, 0);
    bool ok = (f.out = mem_array(voxels, sizeof *f.out, what, e)) &&
              (f.weight = mem_array((size_t)(2 * f.reach + 1), sizeof *f.weight, what, e)) &&
              (f.on = mem_array(workers, sizeof *f.on, what, e));
    for (size_t k = 0; ok && k < workers; k++) ok = make_scratch(&f.on[k], v, f.reach, e);
    if (ok) {
        set_weights(&f, width);
        memcpy(f.out, v->at, voxels * sizeof *f.out);
        threads_run(pool, blocks, 1, filter_blocks, &f);
        free(v->at);
        v->at = f.out;
        f.out = NULL;
        v->changed = f.changed;
        count_again(v);
    }
    for (size_t k = 0; f.on && k < workers; k++) free_scratch(&f.on[k]);
    free(f.on);
    free(f.weight);
    free(f.out);
    return ok;
}
