#include "sampler/particles.h"

#include <stdlib.h>

#include "base/memory.h"

particles *particles_new(size_t count, error *e)
{
    particles *p = mem_alloc(sizeof *p);
    const char *what = "particles";
    p->count = count;
    if (!(p->position = mem_array(count, sizeof *p->position, what, e)) ||
        !(p->normal = mem_array(count, sizeof *p->normal, what, e)) ||
        !(p->anchor = mem_array(count, sizeof *p->anchor, what, e)) ||
        !(p->alpha = mem_array(count, sizeof *p->alpha, what, e)) ||
        !(p->size = mem_array(count, sizeof *p->size, what, e)) ||
        !(p->lambda = mem_array(count, sizeof *p->lambda, what, e)) ||
        !(p->energy = mem_array(count, sizeof *p->energy, what, e)) ||
        !(p->step = mem_array(count, sizeof *p->step, what, e)) ||
        !(p->rim = mem_array(count, sizeof *p->rim, what, e)) ||
        !(p->cramped = mem_array(count, sizeof *p->cramped, what, e)) ||
        !(p->rejected = mem_array(count, sizeof *p->rejected, what, e))) {
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
    free(p->anchor);
    free(p->alpha);
    free(p->size);
    free(p->lambda);
    free(p->energy);
    free(p->step);
    free(p->rim);
    free(p->cramped);
    free(p->rejected);
    free(p);
}
