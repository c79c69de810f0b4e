// SPDX-License-Identifier: Apache-2.0
#include "surface/labels/label_majority.h"

#include <math.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/elementary.h"
#include "base/core/memory.h"
#include "surface/labels/label_weights.h"

static const char what[] = "the majority of the labels";

/* BLOCK: voxels along the side of a block. REACH: radius of the filter, in standard deviations. */
enum { BLOCK = 32, VOXELS = BLOCK * BLOCK * BLOCK, REACH = 3 };

/* The candidate labels of a voxel, largest smoothed indicator first. */
typedef struct ranking {
    float share[LABEL_RIVALS];
    uint16_t label[LABEL_RIVALS];
} ranking;

/* Working memory of one thread: a block with its margin. The filter is applied along one axis after the
 * other. */
typedef struct scratch {
    uint16_t *label, *present; /* label of each voxel; list of the labels that occur */
    float *along_x, *along_y, *all;
    ranking *ranks;
    label_contest *contests;
    int64_t *contested; /* per label: number of its voxels that have other candidates */
    error failed;
} scratch;

typedef struct majority_job {
    label_volume *v;
    int64_t blocks[3];
    int reach[3];
    float *weight[3];         /* filter weights for the offsets -reach .. reach */
    scratch *on;              /* per worker */
    label_contests *contests; /* per block */
    size_t left;              /* memory left for contests, bytes */
    float *label_weight;
    atomic_size_t bytes;
    atomic_ullong changed;
} majority_job;

/* Label of voxels outside the volume and in the layer around it. */
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

/* Number of voxels along an axis of a block with its margin. */
static size_t side_of(const majority_job *f, int axis)
{
    return (size_t)(BLOCK + 2 * f->reach[axis]);
}

/* Copies the labels of a block with its margin. Returns the number of different labels. */
static size_t gather(const majority_job *f, const int64_t low[3], scratch *on)
{
    const label_volume *v = f->v;
    int64_t from[3], end[3];
    size_t count = 0;
    uint16_t last = NONE, *to = on->label;
    for (int k = 0; k < 3; k++) {
        from[k] = low[k] - f->reach[k];
        end[k] = from[k] + (int64_t)side_of(f, k);
    }
    for (int64_t z = from[2]; z < end[2]; z++)
        for (int64_t y = from[1]; y < end[1]; y++)
            for (int64_t x = from[0]; x < end[0]; x++) {
                const bool inside = is_inside(v, 0, x) && is_inside(v, 1, y) && is_inside(v, 2, z);
                *to = inside ? label_volume_at(v, x, y, z) : NONE;
                if (*to != NONE && *to != last) count = note_label(on->present, count, last = *to);
                to++;
            }
    return count;
}

static bool filter_row(const majority_job *f, const uint16_t *label, uint16_t own, float out[BLOCK])
{
    bool any = false;
    for (size_t k = 0; k < side_of(f, 0); k++) any |= label[k] == own;
    if (!any) return false;
    memset(out, 0, BLOCK * sizeof *out);
    for (int k = 0; k <= 2 * f->reach[0]; k++)
        for (int x = 0; x < BLOCK; x++) out[x] += label[x + k] == own ? f->weight[0][k] : 0;
    return true;
}

/* out = weighted sum of rows of BLOCK numbers at the distance `stride`. */
static void filter_rows(const majority_job *f, int axis, const float *rows, size_t stride, float out[BLOCK])
{
    memset(out, 0, BLOCK * sizeof *out);
    for (int k = 0; k <= 2 * f->reach[axis]; k++)
        for (int x = 0; x < BLOCK; x++) out[x] += f->weight[axis][k] * rows[(size_t)k * stride + (size_t)x];
}

/* Computes the smoothed indicator of one label in on->all. */
static void smooth_indicator(const majority_job *f, uint16_t own, scratch *on)
{
    const size_t side[3] = {side_of(f, 0), side_of(f, 1), side_of(f, 2)};
    for (size_t row = 0; row < side[1] * side[2]; row++)
        if (!filter_row(f, on->label + row * side[0], own, on->along_x + row * BLOCK))
            memset(on->along_x + row * BLOCK, 0, BLOCK * sizeof *on->along_x);
    for (size_t z = 0; z < side[2]; z++)
        for (size_t y = 0; y < BLOCK; y++)
            filter_rows(f, 1, on->along_x + (z * side[1] + y) * BLOCK, BLOCK,
                        on->along_y + (z * BLOCK + y) * BLOCK);
    for (size_t z = 0; z < BLOCK; z++)
        for (size_t y = 0; y < BLOCK; y++)
            filter_rows(f, 2, on->along_y + (z * BLOCK + y) * BLOCK, (size_t)BLOCK * BLOCK,
                        on->all + (z * BLOCK + y) * BLOCK);
}

/* Index, in the block with margin, of a voxel of the block. */
static size_t gathered(const majority_job *f, size_t voxel)
{
    const size_t x = voxel % BLOCK + (size_t)f->reach[0], y = voxel / BLOCK % BLOCK + (size_t)f->reach[1],
                 z = voxel / BLOCK / BLOCK + (size_t)f->reach[2];
    return (z * side_of(f, 1) + y) * side_of(f, 0) + x;
}

/* Enters a label's indicator in the rankings of all voxels. Among equal indicators the voxel's own label
 * comes first. */
static void rank(const majority_job *f, size_t count, scratch *on)
{
    memset(on->ranks, 0, VOXELS * sizeof *on->ranks);
    for (size_t n = 0; n < count; n++) {
        const uint16_t own = on->present[n];
        smooth_indicator(f, own, on);
        for (size_t k = 0; k < VOXELS; k++) {
            const float share = on->all[k];
            ranking *r = &on->ranks[k];
            if (!(share > 0) || share < r->share[LABEL_RIVALS - 1]) continue;
            const bool held = on->label[gathered(f, k)] == own;
            int at = LABEL_RIVALS;
            while (at > 0 && (share > r->share[at - 1] || (share == r->share[at - 1] && held))) at--;
            for (int i = LABEL_RIVALS - 1; i > at; i--) {
                r->share[i] = r->share[i - 1];
                r->label[i] = r->label[i - 1];
            }
            if (at == LABEL_RIVALS) continue;
            r->share[at] = share;
            r->label[at] = own;
        }
    }
}

static label_contest contest_of(const ranking *r, size_t voxel)
{
    enum { WHOLE = 65535 };
    label_contest c = {.place = (uint16_t)voxel};
    for (int k = 0; k < LABEL_RIVALS && r->share[k] * LABEL_WEIGHTS_RATIO >= r->share[0]; k++) {
        c.label[k] = r->label[k];
        c.share[k] = (uint16_t)rintf(WHOLE * (r->share[k] / r->share[0]));
    }
    return c;
}

/* The position of a voxel of a block. False: it is outside the volume. */
static bool place_of(const majority_job *f, size_t block, size_t voxel, int64_t at[3])
{
    const size_t in[3] = {voxel % BLOCK, voxel / BLOCK % BLOCK, voxel / BLOCK / BLOCK},
                 of[3] = {block % (size_t)f->blocks[0], block / (size_t)f->blocks[0] % (size_t)f->blocks[1],
                          block / (size_t)f->blocks[0] / (size_t)f->blocks[1]};
    bool inside = true;
    for (int k = 0; k < 3; k++) {
        at[k] = f->v->around + (int64_t)(BLOCK * of[k] + in[k]);
        inside &= is_inside(f->v, k, at[k]);
    }
    return inside;
}

/* Stores the voxels of a block that may get another label, if memory permits. Always adds the memory that
 * they need. */
static void keep_contests(majority_job *f, size_t block, scratch *on)
{
    size_t count = 0;
    for (size_t k = 0; k < VOXELS; k++) {
        const uint16_t own = on->label[gathered(f, k)];
        int64_t at[3];
        if (!place_of(f, block, k, at)) continue;
        const label_contest c = contest_of(&on->ranks[k], k);
        if (c.label[0] == own && c.share[1] == 0) continue;
        on->contests[count++] = c;
        on->contested[own]++;
    }
    const size_t bytes = count * sizeof *on->contests;
    if (atomic_fetch_add(&f->bytes, bytes) + bytes > f->left || count == 0) return;
    label_contests *to = &f->contests[block];
    if (!(to->at = mem_array(count, sizeof *to->at, what, &on->failed))) return;
    memcpy(to->at, on->contests, bytes);
    to->count = count;
}

static void filter_blocks(void *context, int worker, size_t begin, size_t end)
{
    majority_job *f = context;
    scratch *on = &f->on[worker];
    for (size_t n = begin; n < end; n++) {
        int64_t low[3];
        place_of(f, n, 0, low);
        const size_t count = gather(f, low, on);
        if (count < 2) continue;
        rank(f, count, on);
        keep_contests(f, n, on);
    }
}

static void put_winners(void *context, int worker, size_t begin, size_t end)
{
    majority_job *f = context;
    const int64_t *size = f->v->size;
    unsigned long long changed = 0;
    (void)worker;
    for (size_t n = begin; n < end; n++)
        for (size_t i = 0; i < f->contests[n].count; i++) {
            const label_contest *c = &f->contests[n].at[i];
            int64_t at[3];
            place_of(f, n, c->place, at);
            uint16_t *to = &f->v->at[(at[2] * size[1] + at[1]) * size[0] + at[0]];
            const uint16_t winner = c->label[label_weights_winner(c, f->label_weight)];
            changed += *to != winner;
            *to = winner;
        }
    atomic_fetch_add_explicit(&f->changed, changed, memory_order_relaxed);
}

/* ---- public functions */

/* Bytes of the working memory of a thread. */
static size_t scratch_bytes(const majority_job *f)
{
    const size_t side[3] = {side_of(f, 0), side_of(f, 1), side_of(f, 2)};
    const scratch *on = NULL;
    return side[0] * side[1] * side[2] * sizeof *on->label +
           f->v->count * (sizeof *on->present + sizeof *on->contested) +
           side[1] * side[2] * BLOCK * sizeof *on->along_x + side[2] * BLOCK * BLOCK * sizeof *on->along_y +
           VOXELS * (sizeof *on->all + sizeof *on->ranks + sizeof *on->contests);
}

static bool make_scratch(const majority_job *f, scratch *on, error *e)
{
    const size_t side[3] = {side_of(f, 0), side_of(f, 1), side_of(f, 2)};
    return (on->label = mem_array(side[0] * side[1] * side[2], sizeof *on->label, what, e)) &&
           (on->present = mem_array(f->v->count, sizeof *on->present, what, e)) &&
           (on->contested = mem_array(f->v->count, sizeof *on->contested, what, e)) &&
           (on->along_x = mem_array(side[1] * side[2] * BLOCK, sizeof *on->along_x, what, e)) &&
           (on->along_y = mem_array(side[2] * BLOCK * BLOCK, sizeof *on->along_y, what, e)) &&
           (on->all = mem_array(VOXELS, sizeof *on->all, what, e)) &&
           (on->ranks = mem_array(VOXELS, sizeof *on->ranks, what, e)) &&
           (on->contests = mem_array(VOXELS, sizeof *on->contests, what, e));
}

static void free_scratch(scratch *on)
{
    free(on->label);
    free(on->present);
    free(on->contested);
    free(on->along_x);
    free(on->along_y);
    free(on->all);
    free(on->ranks);
    free(on->contests);
}

/* Computes the weights of a Gaussian that has the same width along each axis in world space. */
static bool make_weights(majority_job *f, double width, error *e)
{
    double step[3];
    const double least = label_volume_sides(f->v, step);
    for (int k = 0; k < 3; k++) {
        const double own = width * least / step[k];
        double sum = 0;
        f->reach[k] = (int)ceil(REACH * own);
        if (!(f->weight[k] = mem_array((size_t)(2 * f->reach[k] + 1), sizeof *f->weight[k], what, e)))
            return false;
        for (int j = -f->reach[k]; j <= f->reach[k]; j++) sum += elementary_exp(-0.5 * j * j / (own * own));
        for (int j = -f->reach[k]; j <= f->reach[k]; j++)
            f->weight[k][j + f->reach[k]] = (float)(elementary_exp(-0.5 * j * j / (own * own)) / sum);
    }
    return true;
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

static bool check_memory(size_t needed, size_t memory_limit, error *e)
{
    return needed <= memory_limit ||
           error_set(e, ERROR_LIMIT_MEMORY,
                     "/surface/labels/majority requires %zu MiB, and %zu MiB of the limit are left: raise "
                     "limits.memory_mb by at least %zu",
                     (needed >> 20) + 1, memory_limit >> 20, ((needed - memory_limit) >> 20) + 1);
}

/* Finds label weights with which each label wins as many contested voxels as it has now: this preserves its
 * volume. */
static bool find_weights(majority_job *f, size_t blocks, size_t workers, threads *pool, error *e)
{
    const size_t labels = f->v->count;
    label_wish *wish = mem_array(labels, sizeof *wish, what, e);
    bool ok = wish && (f->label_weight = mem_array(labels, sizeof *f->label_weight, what, e));
    for (size_t k = 0; ok && k < labels; k++) {
        wish[k].voxels = (int64_t)f->v->material[k].voxels;
        for (size_t w = 0; w < workers; w++) wish[k].wanted += f->on[w].contested[k];
    }
    ok = ok && label_weights_find(f->contests, blocks, wish, labels, pool, f->label_weight, e);
    free(wish);
    return ok;
}

/* Filters all blocks. Error: limit_memory, if the contests exceed the memory that is left. */
static bool filter(majority_job *f, size_t blocks, size_t memory_limit, threads *pool, error *e)
{
    const size_t workers = (size_t)threads_count(pool),
                 taken = label_volume_bytes(f->v) + workers * scratch_bytes(f) +
                         label_weights_bytes(f->v->count, workers) + blocks * sizeof *f->contests;
    if (!check_memory(taken, memory_limit, e)) return false;
    f->left = mem_left(memory_limit, taken);
    if (!(f->contests = mem_array(blocks, sizeof *f->contests, what, e)) ||
        !(f->on = mem_array(workers, sizeof *f->on, what, e)))
        return false;
    for (size_t k = 0; k < workers; k++)
        if (!make_scratch(f, &f->on[k], e)) return false;
    threads_run(pool, blocks, 1, filter_blocks, f);
    for (size_t k = 0; k < workers; k++)
        if (f->on[k].failed.code) {
            *e = f->on[k].failed;
            return false;
        }
    return check_memory(taken + f->bytes, memory_limit, e);
}

bool label_majority_apply(label_volume *v, double width, size_t memory_limit, threads *pool, error *e)
{
    if (!(width > 0)) return true;
    const size_t workers = (size_t)threads_count(pool);
    majority_job f = {.v = v};
    size_t blocks = 1;
    for (int k = 0; k < 3; k++) {
        f.blocks[k] = (v->size[k] - 2 * v->around + BLOCK - 1) / BLOCK;
        blocks *= (size_t)f.blocks[k];
    }
    atomic_init(&f.bytes, 0);
    atomic_init(&f.changed, 0);
    const bool ok = make_weights(&f, width, e) && filter(&f, blocks, memory_limit, pool, e) &&
                    find_weights(&f, blocks, workers, pool, e);
    if (ok) {
        threads_run(pool, blocks, 1, put_winners, &f);
        v->changed = f.changed;
        count_again(v);
    }
    for (size_t k = 0; f.on && k < workers; k++) free_scratch(&f.on[k]);
    for (size_t k = 0; f.contests && k < blocks; k++) free(f.contests[k].at);
    for (int k = 0; k < 3; k++) free(f.weight[k]);
    free(f.on);
    free(f.contests);
    free(f.label_weight);
    return ok;
}
