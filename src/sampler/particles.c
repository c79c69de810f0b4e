#include "sampler/particles.h"

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
    free(p);
}

bool particles_grow(particles *p, size_t capacity, error *e)
{
    particles *q = particles_new(capacity, e);
    if (!q) return false;
    for (size_t i = 0; i < p->count; i++) {
        q->position[i] = p->position[i];
        q->normal[i] = p->normal[i];
        q->alpha[i] = p->alpha[i];
        q->size[i] = p->size[i];
        q->lambda[i] = p->lambda[i];
        q->energy[i] = p->energy[i];
    }
    q->count = p->count;
    particles old = *p;
    *p = *q;
    *q = old;
    particles_free(q);
    return true;
}

void particles_copy(particles *p, size_t to, size_t from)
{
    p->position[to] = p->position[from];
    p->normal[to] = p->normal[from];
    p->alpha[to] = p->alpha[from];
    p->size[to] = p->size[from];
    p->lambda[to] = p->lambda[from];
    p->energy[to] = p->energy[from];
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
           arrange(p->lambda, sizeof *p->lambda, order, p->count, e);
}

void particles_mark_boundary(particles *p, const field *f, double h)
{
    if (!f->open) return;
    for (size_t i = 0; i < p->count; i++)
        p->near_boundary[i] = packing_is_near_boundary(f->boundary_box, p->position[i], h * p->size[i]);
}
