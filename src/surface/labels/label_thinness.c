// SPDX-License-Identifier: Apache-2.0
#include "surface/labels/label_thinness.h"

#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"

/* MOST_NAMED: maximum number of thin labels that get a warning of their own. GRAIN: rows of voxels in a
 * chunk of work. */
enum { MOST_NAMED = 5, GRAIN = 64 };

/* Whether all voxels of the box `low` to `high`, which contains a voxel of material `own`, lie in the volume
 * and have this material. */
static bool is_uniform(const label_volume *v, const int64_t low[3], const int64_t high[3], uint16_t own)
{
    for (int k = 0; k < 3; k++)
        if (low[k] < 0 || high[k] >= v->size[k]) return false;
    for (int64_t z = low[2]; z <= high[2]; z++)
        for (int64_t y = low[1]; y <= high[1]; y++)
            for (int64_t x = low[0]; x <= high[0]; x++)
                if (label_volume_at(v, x, y, z) != own) return false;
    return true;
}

/* Whether the voxel lies in a box of its material that has two voxels along each axis except `flat` (3:
 * along all axes). Along an axis with one voxel a box has one, so that a volume of one slice is not thin
 * everywhere. */
static bool is_in_box(const label_volume *v, const int64_t at[3], uint16_t own, int flat)
{
    for (int corner = 0; corner < 8; corner++) {
        int64_t low[3], high[3];
        bool again = false; /* the box is the same as that of another corner */
        for (int k = 0; k < 3; k++) {
            const int64_t longer = k != flat && v->size[k] > 1, before = corner >> k & 1;
            again |= !longer && before;
            low[k] = at[k] - longer * before;
            high[k] = low[k] + longer;
        }
        if (!again && is_uniform(v, low, high, own)) return true;
    }
    return false;
}

typedef struct thinness_job {
    const label_volume *v;
    atomic_ullong *thin, *rows; /* per material */
} thinness_job;

enum { WORD = 4 }; /* voxels that are compared at a time */

/* Whether the next WORD voxels of a row and of the three adjacent rows (y + 1, z + 1, both) have one
 * material: then none of them is thin. A fast test, true for most voxels; the boxes are tested otherwise. */
static bool is_thick(const label_volume *v, const int64_t at[3], uint16_t own)
{
    if (at[0] + WORD > v->size[0] || at[1] + 1 >= v->size[1] || at[2] + 1 >= v->size[2]) return false;
    const uint64_t alike = UINT64_C(0x0001000100010001) * own;
    bool is = true;
    for (int row = 0; row < 4; row++) {
        uint64_t word;
        memcpy(&word, v->at + ((at[2] + row / 2) * v->size[1] + at[1] + row % 2) * v->size[0] + at[0],
               sizeof word);
        is &= word == alike;
    }
    return is;
}

/* Counts the thin voxels of rows along x. */
static void find_in_rows(void *context, int worker, size_t begin, size_t end)
{
    const thinness_job *f = context;
    const label_volume *v = f->v;
    (void)worker;
    for (size_t row = begin; row < end; row++) {
        int64_t at[3] = {0, (int64_t)row % v->size[1], (int64_t)row / v->size[1]};
        for (; at[0] < v->size[0]; at[0]++) {
            const uint16_t own = label_volume_at(v, at[0], at[1], at[2]);
            if (is_thick(v, at, own)) {
                at[0] += WORD - 1;
                continue;
            }
            if (v->material[own].background || is_in_box(v, at, own, 3)) continue;
            atomic_fetch_add_explicit(&f->thin[own], 1, memory_order_relaxed);
            if (!is_in_box(v, at, own, 0) && !is_in_box(v, at, own, 1) && !is_in_box(v, at, own, 2))
                atomic_fetch_add_explicit(&f->rows[own], 1, memory_order_relaxed);
        }
    }
}

void label_thinness_find(label_volume *v, threads *pool)
{
    thinness_job f = {v, mem_alloc(v->count * sizeof *f.thin), mem_alloc(v->count * sizeof *f.rows)};
    for (size_t k = 0; k < v->count; k++) {
        atomic_init(&f.thin[k], 0);
        atomic_init(&f.rows[k], 0);
    }
    threads_run(pool, (size_t)(v->size[1] * v->size[2]), GRAIN, find_in_rows, &f);
    for (size_t k = 0; k < v->count; k++) {
        v->material[k].thin = f.thin[k];
        v->material[k].rows = f.rows[k];
    }
    free(f.thin);
    free(f.rows);
}

bool label_thinness_is_thin(const label_material *m)
{
    return m->asked && m->voxels > 0 && 2 * m->thin >= m->voxels;
}

bool label_thinness_is_row(const label_material *m)
{
    return m->asked && m->voxels > 0 && 2 * m->rows >= m->voxels;
}

static const char CONSEQUENCE[] =
    ", too thin for a regular packing of points: if that matters, merge the label with a neighbour (/surface/labels/groups)";

static char *words_for(const label_material *m)
{
    if (m->voxels == 1)
        return mem_printf("label %lld is a single voxel, at (%lld, %lld, %lld)%s", (long long)m->value,
                          (long long)m->low[0], (long long)m->low[1], (long long)m->low[2], CONSEQUENCE);
    if (label_thinness_is_row(m))
        return mem_printf("label %lld: %llu of its %llu voxels are single voxels or rows of voxels%s",
                          (long long)m->value, (unsigned long long)m->rows, (unsigned long long)m->voxels,
                          CONSEQUENCE);
    return mem_printf("label %lld: %llu of its %llu voxels are in parts one voxel thin%s",
                      (long long)m->value, (unsigned long long)m->thin, (unsigned long long)m->voxels,
                      CONSEQUENCE);
}

void label_thinness_warn(const label_volume *v, json *warnings)
{
    size_t thin = 0;
    for (size_t k = 0; k < v->count; k++) {
        if (!label_thinness_is_thin(&v->material[k]) || thin++ >= MOST_NAMED) continue;
        char *words = words_for(&v->material[k]);
        json_append_string(warnings, words);
        free(words);
    }
    if (thin <= MOST_NAMED) return;
    const size_t more = thin - MOST_NAMED;
    char *words = mem_printf("%zu more label%s %s as thin: see thin_voxels of surface.labels in report.json",
                             more, more == 1 ? "" : "s", more == 1 ? "is" : "are");
    json_append_string(warnings, words);
    free(words);
}
