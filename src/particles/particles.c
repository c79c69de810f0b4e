#include "particles/particles.h"

#include <assert.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "packing/packing.h"

particles *particles_new(size_t count, error *e)
{
    particles *p = mem_alloc(sizeof *p);
    const char *what = "particles";
    p->count = count;
    if (!(p->position = mem_array(count, sizeof *p->position, what, e)) ||
        !(p->normal = mem_array(count, sizeof *p->normal, what, e)) ||
        !(p->alpha = mem_array(count, sizeof *p->alpha, what, e)) ||
        !(p->size = mem_array(count, sizeof *p->size, what, e)) ||
        !(p->lambda = mem_array(count, sizeof *p->lambda, what, e)) ||
        !(p->energy = mem_array(count, sizeof *p->energy, what, e)) ||
        !(p->near_boundary = mem_array(count, sizeof *p->near_boundary, what, e))) {
        particles_free(p);
        return NULL;
    }
    for (size_t i = 0; i < count; i++) p->alpha[i] = p->size[i] = 1;
    return p;
}

bool particles_label(particles *p, const field_patches *patches, size_t capacity, error *e)
{
    if (!patches) return true;
    p->patches = patches;
    p->patch = mem_array(capacity, sizeof *p->patch, "particles", e);
    p->hint = mem_array(capacity, sizeof *p->hint, "particles", e);
    p->place = mem_array(capacity, sizeof *p->place, "particles", e);
    for (size_t i = 0; p->hint && i < capacity; i++) p->hint[i] = FIELD_NO_HINT;
    for (size_t i = 0; p->place && i < capacity; i++) p->place[i] = PARTICLES_FREE;
    return p->patch && p->hint && p->place;
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
    to->alpha[i] = from->alpha[k];
    to->size[i] = from->size[k];
    to->lambda[i] = from->lambda[k];
    to->energy[i] = from->energy[k];
    if (!from->patch) return;
    to->patch[i] = from->patch[k];
    to->hint[i] = from->hint[k];
    to->place[i] = from->place[k];
}

bool particles_grow(particles *p, size_t capacity, error *e)
{
    particles *q = particles_new(capacity, e);
    if (!q || !particles_label(q, p->patches, capacity, e)) {
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
    size_t size, count; /* of an entry; of entries */
    const char *from;
    char *to;
} arrangement;

/* With a size that is known where this is expanded a copy is no call. */
static inline __attribute__((always_inline)) void take(const arrangement *a, size_t begin, size_t end,
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
        take(a, begin, end, sizeof(vec3));
    else if (a->size == sizeof(double))
        take(a, begin, end, sizeof(double));
    else
        take(a, begin, end, sizeof(float));
}

static void copy_chunk(void *context, int worker, size_t begin, size_t end)
{
    const arrangement *a = context;
    (void)worker;
    memcpy(a->to + begin * a->size, a->from + begin * a->size, (end - begin) * a->size);
}

enum { GRAIN = 8192 };

/* `room` is for a copy. */
static void arrange(void *array, size_t size, const uint32_t *order, size_t count, char *room, threads *pool)
{
    assert(size == sizeof(vec3) || size == sizeof(double) || size == sizeof(float));
    arrangement a = {order, size, count, array, room};
    threads_run(pool, count, GRAIN, copy_chunk, &a);
    a.from = room;
    a.to = array;
    threads_run(pool, count, GRAIN, arrange_chunk, &a);
}

bool particles_arrange(particles *p, const uint32_t *order, threads *pool, error *e)
{
    char *room = mem_array(p->count, sizeof *p->position, "the order of particles", e);
    if (!room) return false;
    arrange(p->position, sizeof *p->position, order, p->count, room, pool);
    arrange(p->normal, sizeof *p->normal, order, p->count, room, pool);
    arrange(p->alpha, sizeof *p->alpha, order, p->count, room, pool);
    arrange(p->size, sizeof *p->size, order, p->count, room, pool);
    arrange(p->lambda, sizeof *p->lambda, order, p->count, room, pool);
    if (p->patch) {
        arrange(p->energy, sizeof *p->energy, order, p->count, room, pool);
        arrange(p->patch, sizeof *p->patch, order, p->count, room, pool);
        arrange(p->hint, sizeof *p->hint, order, p->count, room, pool);
        arrange(p->place, sizeof *p->place, order, p->count, room, pool);
    }
    free(room);
    return true;
}

void particles_mark_boundary(particles *p, const field *f, double h)
{
    if (!f->open) return;
    for (size_t i = 0; i < p->count; i++)
        p->near_boundary[i] = packing_is_near_boundary(f->boundary_box, p->position[i], h * p->size[i]);
}
