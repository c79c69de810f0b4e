#include "packing/batches.h"

#include <stdbool.h>
#include <string.h>

#include "base/isa.h"

/* Batches that wait for more points at a time: an even packing needs some eight until the first are full. */
enum { OPEN = 16 };

/* Far from any place, and differences to those are numbers still. */
static const int32_t NOWHERE = INT32_MAX;

typedef struct batch {
    int32_t x[BATCH_MOST], y[BATCH_MOST], z[BATCH_MOST];
    float size[BATCH_MOST];
    uint32_t point[BATCH_MOST];
    size_t count;
} batch;

static void clear(batch *b)
{
    b->count = 0;
    for (int l = 0; l < BATCH_MOST; l++) {
        b->x[l] = b->y[l] = b->z[l] = NOWHERE;
        b->size[l] = 0;
    }
}

/* Whether nobody in the batch is a neighbour of who is at p. */
ISA_CLONES static bool has_room(const batch *b, const neighbours_place *p, float half_cutoff2)
{
    int32_t near = 0;
    for (int l = 0; l < BATCH_MOST; l++) {
        float x = (float)(b->x[l] - p->x), y = (float)(b->y[l] - p->y), z = (float)(b->z[l] - p->z),
              sizes = b->size[l] + p->size;
        near |= x * x + y * y + z * z <= half_cutoff2 * (sizes * sizes);
    }
    return !near;
}

static void join(batch *b, uint32_t point, const neighbours_place *p)
{
    size_t l = b->count++;
    b->x[l] = p->x;
    b->y[l] = p->y;
    b->z[l] = p->z;
    b->size[l] = p->size;
    b->point[l] = point;
}

static uint32_t *write_batch(const batch *b, uint32_t *to)
{
    memcpy(to, b->point, b->count * sizeof *to);
    to[b->count - 1] |= BATCH_LAST;
    return to + b->count;
}

/* Each point goes to the first batch that has room for it. There are never more written than read. */
static void form(neighbours *n, uint32_t begin, uint32_t end)
{
    batch open[OPEN];
    size_t count = 0;
    uint32_t *to = n->bin_item + begin;
    const float half_cutoff = (float)(0.5 * n->cutoff / n->unit), half_cutoff2 = half_cutoff * half_cutoff;
    for (uint32_t a = begin; a < end; a++) {
        uint32_t point = n->bin_item[a];
        const neighbours_place *p = &n->place[point];
        size_t k = 0;
        while (k < count && !has_room(&open[k], p, half_cutoff2)) k++;
        if (k == OPEN) {
            to = write_batch(&open[0], to);
            memmove(open, open + 1, (OPEN - 1) * sizeof *open);
            count = --k;
        }
        if (k == count) clear(&open[count++]);
        join(&open[k], point, p);
        if (open[k].count < BATCH_MOST) continue;
        to = write_batch(&open[k], to);
        memmove(open + k, open + k + 1, (--count - k) * sizeof *open);
    }
    for (size_t k = 0; k < count; k++) to = write_batch(&open[k], to);
}

typedef struct form_job {
    neighbours *n;
    size_t first_block; /* of the colour */
} form_job;

static void form_chunk(void *context, int worker, size_t begin, size_t end)
{
    const form_job *job = context;
    uint32_t from, to;
    (void)worker;
    neighbours_points(job->n, job->first_block + begin, job->first_block + end, &from, &to);
    form(job->n, from, to);
}

void batches_form(neighbours *n, threads *pool)
{
    for (int c = 0; c < n->colours; c++) {
        form_job job = {n, n->colour_begin[c]};
        threads_run(pool, n->colour_begin[c + 1] - n->colour_begin[c], BATCH_BLOCKS, form_chunk, &job);
    }
}
