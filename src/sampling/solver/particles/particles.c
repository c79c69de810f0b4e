// SPDX-License-Identifier: Apache-2.0
#include "sampling/solver/particles/particles.h"

#include <assert.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"
#include "sampling/packing/point_flags.h"

particles *particles_new_even(size_t count, error *e)
{
    particles *p = mem_alloc(sizeof *p);
    const char *what = "particles";
    p->count = p->capacity = count;
    if (!(p->position = mem_array(count, sizeof *p->position, what, e)) ||
        !(p->normal = mem_array(count, sizeof *p->normal, what, e)) ||
        !(p->lambda = mem_array(count, sizeof *p->lambda, what, e)) ||
        !(p->energy = mem_array(count, sizeof *p->energy, what, e)) ||
        !(p->near_boundary = mem_array(count, sizeof *p->near_boundary, what, e))) {
        particles_free(p);
        return NULL;
    }
    return p;
}

/* Allocates *array, filled with 1, unless it exists. */
static bool add_ones(double **array, size_t count, error *e)
{
    if (*array) return true;
    *array = mem_array(count, sizeof **array, "particles", e);
    for (size_t i = 0; *array && i < count; i++) (*array)[i] = 1;
    return *array != NULL;
}

bool particles_add_amplitudes(particles *p, error *e)
{
    return add_ones(&p->alpha, p->capacity, e);
}

bool particles_add_sizes(particles *p, error *e)
{
    return add_ones(&p->size, p->capacity, e);
}

particles *particles_new(size_t count, error *e)
{
    particles *p = particles_new_even(count, e);
    if (p && particles_add_amplitudes(p, e) && particles_add_sizes(p, e)) return p;
    particles_free(p);
    return NULL;
}

bool particles_add_places(particles *p, error *e)
{
    if (p->place) return true;
    p->place = mem_array(p->capacity, sizeof *p->place, "particles", e);
    for (size_t i = 0; p->place && i < p->capacity; i++) p->place[i] = PARTICLES_FREE;
    return p->place != NULL;
}

bool particles_set_patches(particles *p, const field_patches *patches, size_t capacity, error *e)
{
    if (!patches) return true;
    p->patches = patches;
    p->patch = mem_array(capacity, sizeof *p->patch, "particles", e);
    p->hint = mem_array(capacity, sizeof *p->hint, "particles", e);
    for (size_t i = 0; p->hint && i < capacity; i++) p->hint[i] = FIELD_NO_HINT;
    return p->patch && p->hint && particles_add_places(p, e);
}

void particles_free(particles *p)
{
    if (!p) return;
    free(p->position);
    free(p->normal);
    free(p->alpha);
    free(p->size);
    free(p->lambda);
    free(p->energy);
    free(p->near_boundary);
    free(p->patch);
    free(p->hint);
    free(p->place);
    free(p);
}

/* (Entries that are 0 are not written: untouched pages of a zeroed allocation occupy no memory.) */
void particles_reset_damping(particles *p)
{
    for (size_t i = 0; i < p->count; i++)
        if (p->lambda[i] != 0) p->lambda[i] = 0;
}

void particles_flags(const particles *p, uint8_t *out)
{
    for (size_t i = 0; i < p->count; i++)
        out[i] = (uint8_t)((particles_is_on_curve(p, i) ? PACKING_FIXED : 0) |
                           (particles_is_one_sided(p, i) ? PACKING_ONE_SIDED : 0));
}

size_t particles_free_count(const particles *p)
{
    size_t count = p->count;
    for (size_t i = 0; p->place && i < p->count; i++) count -= particles_is_fixed(p, i);
    return count;
}

static void copy_between(particles *to, size_t i, const particles *from, size_t k)
{
    to->position[i] = from->position[k];
    to->normal[i] = from->normal[k];
    if (from->alpha) to->alpha[i] = from->alpha[k];
    if (from->size) to->size[i] = from->size[k];
    to->lambda[i] = from->lambda[k];
    to->energy[i] = from->energy[k];
    if (from->place) to->place[i] = from->place[k];
    if (!from->patch) return;
    to->patch[i] = from->patch[k];
    to->hint[i] = from->hint[k];
}

bool particles_grow(particles *p, size_t capacity, error *e)
{
    particles *q = particles_new_even(capacity, e);
    if (!q || (p->alpha && !particles_add_amplitudes(q, e)) || (p->size && !particles_add_sizes(q, e)) ||
        !particles_set_patches(q, p->patches, capacity, e) || (p->place && !particles_add_places(q, e))) {
        particles_free(q);
        return false;
    }
    for (size_t i = 0; i < p->count; i++) copy_between(q, i, p, i);
    q->count = p->count;
    particles old = *p;
    *p = *q;
    *q = old;
    particles_free(q);
    return true;
}

void particles_copy(particles *p, size_t to, size_t from)
{
    copy_between(p, to, p, from);
}

typedef struct arrangement {
    const uint32_t *order;
    size_t size;  /* of an entry, bytes */
    size_t count; /* of entries */
    const char *from;
    char *to;
} arrangement;

/* Gathers entries. Inlined with a constant size, so that memcpy is compiled inline. */
static inline __attribute__((always_inline)) void gather(const arrangement *a, size_t begin, size_t end,
                                                         size_t size)
{
    for (size_t k = begin; k < end; k++) {
        assert(a->order[k] < a->count);
        memcpy(a->to + k * size, a->from + a->order[k] * size, size);
    }
}

static void arrange_chunk(void *context, int worker, size_t begin, size_t end)
{
    const arrangement *a = context;
    (void)worker;
    if (a->size == sizeof(vec3))
        gather(a, begin, end, sizeof(vec3));
    else if (a->size == sizeof(double))
        gather(a, begin, end, sizeof(double));
    else
        gather(a, begin, end, sizeof(float));
}

static void copy_chunk(void *context, int worker, size_t begin, size_t end)
{
    const arrangement *a = context;
    (void)worker;
    memcpy(a->to + begin * a->size, a->from + begin * a->size, (end - begin) * a->size);
}

/* Entries per task of the thread pool: large compared with the cost of a task. */
enum { GRAIN = 8192 };

/* Permutes an array in place. `buffer`: memory for `count` entries. */
static void arrange(void *array, size_t size, const uint32_t *order, size_t count, char *buffer,
                    threads *pool)
{
    assert(size == sizeof(vec3) || size == sizeof(double) || size == sizeof(float));
    arrangement a = {order, size, count, array, buffer};
    threads_run(pool, count, GRAIN, copy_chunk, &a);
    a.from = buffer;
    a.to = array;
    threads_run(pool, count, GRAIN, arrange_chunk, &a);
}

bool particles_arrange(particles *p, const uint32_t *order, threads *pool, error *e)
{
    char *buffer = mem_array(p->count, sizeof *p->position, "the order of particles", e);
    if (!buffer) return false;
    arrange(p->position, sizeof *p->position, order, p->count, buffer, pool);
    arrange(p->normal, sizeof *p->normal, order, p->count, buffer, pool);
    if (p->alpha) arrange(p->alpha, sizeof *p->alpha, order, p->count, buffer, pool);
    if (p->size) arrange(p->size, sizeof *p->size, order, p->count, buffer, pool);
    if (p->patch) {
        arrange(p->lambda, sizeof *p->lambda, order, p->count, buffer, pool);
        arrange(p->energy, sizeof *p->energy, order, p->count, buffer, pool);
        arrange(p->patch, sizeof *p->patch, order, p->count, buffer, pool);
        arrange(p->hint, sizeof *p->hint, order, p->count, buffer, pool);
    }
    if (p->place) arrange(p->place, sizeof *p->place, order, p->count, buffer, pool);
    free(buffer);
    return true;
}

void particles_mark_boundary(particles *p, const field *f, double h)
{
    for (size_t i = 0; !f->open && p->place && i < p->count; i++) p->near_boundary[i] = false;
    if (!f->open) return;
    for (size_t i = 0; i < p->count; i++)
        p->near_boundary[i] =
            packing_is_near_boundary(f->boundary_box, p->position[i], h * particles_size(p, i));
}
