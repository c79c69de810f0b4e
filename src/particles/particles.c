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
    p->place = mem_array(capacity, sizeof *p->place, "particles", e);
    for (size_t i = 0; p->place && i < capacity; i++) p->place[i] = PARTICLES_FREE;
    return p->patch && p->place;
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

static bool arrange(void *array, size_t size, const uint32_t *order, size_t count, error *e)
{
    char *copy = mem_array(count, size, "the order of particles", e), *to = array;
    if (!copy) return false;
    memcpy(copy, array, count * size);
    for (size_t k = 0; k < count; k++) {
        assert(order[k] < count);
        memcpy(to + k * size, copy + order[k] * size, size);
    }
    free(copy);
    return true;
}

bool particles_arrange(particles *p, const uint32_t *order, error *e)
{
    return arrange(p->position, sizeof *p->position, order, p->count, e) &&
           arrange(p->normal, sizeof *p->normal, order, p->count, e) &&
           arrange(p->alpha, sizeof *p->alpha, order, p->count, e) &&
           arrange(p->size, sizeof *p->size, order, p->count, e) &&
           arrange(p->lambda, sizeof *p->lambda, order, p->count, e) &&
           (!p->patch || (arrange(p->energy, sizeof *p->energy, order, p->count, e) &&
                          arrange(p->patch, sizeof *p->patch, order, p->count, e) &&
                          arrange(p->place, sizeof *p->place, order, p->count, e)));
}

void particles_mark_boundary(particles *p, const field *f, double h)
{
    if (!f->open) return;
    for (size_t i = 0; i < p->count; i++)
        p->near_boundary[i] = packing_is_near_boundary(f->boundary_box, p->position[i], h * p->size[i]);
}
