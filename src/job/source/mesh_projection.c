// SPDX-License-Identifier: Apache-2.0
#include "job/source/mesh_projection.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"
#include "surface/levelset/mesh_faces.h"
#include "sampling/packing/neighbours.h"

/* Tolerance, as a fraction of the extent, for points on a face of the region. */
static const double ON_FACE = 1e-9;
/* Maximum steps of the alternating projection onto a face of the region and onto the triangles; the
 * convergence depends on their angle. */
static const int MOST_STEPS = 100;
/* In spacings: a point that moves farther than FAR_MOVE may come close to another point. Points nearer than
 * NEAR are moved apart, in at most APART_ROUNDS rounds. */
static const double FAR_MOVE = 0.1, NEAR = 0.55;
enum { APART_ROUNDS = 8 };
/* Points in a chunk of work. */
enum { GRAIN = 1024 };

static bool has_faces(const source_part *p)
{
    bool found = p->volume && volume_faces(p->volume);
    for (size_t k = 0; !found && k < p->part_count; k++) found = has_faces(&p->parts[k]);
    return found;
}

static bool find_place(const source_part *p, vec3 x, bool any, vec3 *out);

static bool find_in_part(const source_part *p, size_t k, vec3 x, bool any, vec3 *out)
{
    const source_part *part = &p->parts[k];
    if (!find_place(part, p->placement ? placement_to_part(p->placement, x) : x, any, out)) return false;
    if (p->placement) *out = placement_to_world(p->placement, *out);
    return true;
}

/* Finds the place for x on the surface of a part: on the triangles that face the way of its normal, or the
 * nearest place of all surfaces (`any`). False: there is none. */
static bool find_place(const source_part *p, vec3 x, bool any, vec3 *out)
{
    if (p->part_count > 0 && !any) return find_in_part(p, source_nearest_part(p, x), x, any, out);
    if (p->part_count > 0) {
        double nearest2 = INFINITY;
        vec3 place;
        for (size_t k = 0; k < p->part_count; k++) {
            if (!find_in_part(p, k, x, any, &place) || !(vec3_norm2(vec3_sub(place, x)) < nearest2)) continue;
            nearest2 = vec3_norm2(vec3_sub(place, x));
            *out = place;
        }
        return nearest2 < INFINITY;
    }
    const mesh_faces *faces = p->volume ? volume_faces(p->volume) : NULL;
    field_sample s;
    if (p->mesh || p->labels) {
        *out = p->mesh ? mesh_surface_nearest(p->mesh, x) : label_surface_nearest(p->labels, x);
        return true;
    }
    if (faces && any) {
        *out = mesh_faces_nearest(faces, x);
        return true;
    }
    if (!(faces || any) || !p->field || !field_sample_at(p->field, x, FIELD_GRADIENT, &s)) return false;
    *out = faces ? mesh_faces_project(faces, x, s.gradient)
                 : vec3_axpy(-s.value / vec3_norm2(s.gradient), s.gradient, x);
    return true;
}

static bool sample_distance(const field *f, vec3 x, field_order order, field_sample *out)
{
    const source *s = ((const mesh_projection *)f)->source;
    vec3 place;
    if (s->turned) x = placement_to_part(s->turned, x); /* a translation preserves distances and normals */
    if (!find_place(&s->whole, x, true, &place)) return field_sample_at(s->field, x, order, out);
    const vec3 off = vec3_sub(x, place);
    const double distance = vec3_norm(off);
    out->value = distance;
    out->gradient = distance > 0 ? vec3_scale(off, 1 / distance) : vec3_make(0, 0, 1);
    return true;
}

static bool begin(const source *s, bool has_triangles, mesh_projection *out)
{
    static const field_ops ops = {.sample = sample_distance};
    if (s->creased || (s->turned && s->whole.labels) || !has_triangles) return false;
    *out = (mesh_projection){{.ops = &ops}, s};
    return true;
}

bool mesh_projection_find(const source *s, mesh_projection *out)
{
    return begin(s, has_faces(&s->whole), out);
}

bool mesh_projection_find_distance(const source *s, mesh_projection *out)
{
    return begin(s, s->whole.mesh || s->whole.labels || has_faces(&s->whole), out);
}

/* Clamps a place to the region, and keeps it on the faces on which x lies. */
static vec3 hold(const field *f, vec3 x, vec3 place)
{
    for (int axis = 0; f->open && axis < 3; axis++) {
        const double low = vec3_get(f->boundary_box.min, axis), high = vec3_get(f->boundary_box.max, axis),
                     at = vec3_get(x, axis), reach = ON_FACE * f->extent;
        vec3_set(&place, axis,
                 at < low + reach    ? low
                 : at > high - reach ? high
                                     : fmax(low, fmin(vec3_get(place, axis), high)));
    }
    return place;
}

static vec3 project(const mesh_projection *l, vec3 x)
{
    const field *f = l->source->field;
    vec3 from = x, place;
    for (int step = 0; step < MOST_STEPS; step++) {
        if (!find_place(&l->source->whole, from, false, &place)) return from;
        from = hold(f, x, place);
        if (vec3_norm(vec3_sub(from, place)) <= ON_FACE * f->extent) return from;
    }
    return place;
}

typedef struct move_job {
    const mesh_projection *l;
    vec3 *place;
    const double *spacing;
    double *largest; /* per chunk */
    bool *far;       /* per chunk: a place moved by more than FAR_MOVE */
} move_job;

static void move_chunk(void *context, int worker, size_t begin, size_t end)
{
    const move_job *m = context;
    double largest = 0;
    (void)worker;
    for (size_t i = begin; i < end; i++) {
        const vec3 from = m->place[i];
        m->place[i] = project(m->l, from);
        const double moved = vec3_norm(vec3_sub(m->place[i], from));
        largest = fmax(largest, moved);
        m->far[begin / GRAIN] |= moved > FAR_MOVE * m->spacing[i];
    }
    m->largest[begin / GRAIN] = largest;
}

/* The displacement that moves place i away from places that are too close. If two places coincide, the one
 * with the lower index moves along x. */
static vec3 way_out(const move_job *m, const neighbours *near, size_t i)
{
    vec3 way = {0, 0, 0};
    for (uint32_t k = 0; k < near->list_count[i]; k++) {
        const uint32_t j = neighbours_list(near, i)[k];
        const double least = NEAR * 0.5 * (m->spacing[i] + m->spacing[j]);
        vec3 apart = vec3_sub(m->place[i], m->place[j]);
        double distance = vec3_norm(apart);
        if (distance == 0) apart = vec3_make(i < j ? 1 : -1, 0, 0);
        if (distance < least) way = vec3_axpy(0.5 * (least - distance), vec3_unit(apart), way);
    }
    return way;
}

/* Moves places that are too close apart, once. *moved: a place was moved. */
static bool move_apart(const move_job *m, size_t count, threads *pool, bool *moved, error *e)
{
    neighbours *near = neighbours_new(count, SIZE_MAX, e);
    vec3 *to = mem_array(count, sizeof *to, "the points on the triangles", e);
    bool ok = near && to && neighbours_build(near, count, m->place, m->spacing, NEAR, pool, e);
    *moved = false;
    for (size_t i = 0; ok && i < count; i++) {
        to[i] = m->place[i];
        const vec3 way = way_out(m, near, i);
        if (!(vec3_norm2(way) > 0)) continue;
        to[i] = project(m->l, vec3_add(to[i], way));
        *moved = true;
    }
    if (ok && *moved) memcpy(m->place, to, count * sizeof *to);
    free(to);
    neighbours_free(near);
    return ok;
}

bool mesh_projection_apply(const mesh_projection *l, vec3 *place, const double *spacing, size_t count,
                           threads *pool, double *largest, error *e)
{
    const size_t chunks = count / GRAIN + 1;
    const move_job m = {l, place, spacing, mem_alloc(chunks * sizeof *m.largest),
                        mem_alloc(chunks * sizeof *m.far)};
    threads_run(pool, count, GRAIN, move_chunk, (void *)&m);
    bool far = false, ok = true;
    *largest = 0;
    for (size_t k = 0; k < chunks; k++) {
        *largest = fmax(*largest, m.largest[k]);
        far |= m.far[k];
    }
    for (int round = 0; ok && far && round < APART_ROUNDS; round++) ok = move_apart(&m, count, pool, &far, e);
    free(m.largest);
    free(m.far);
    return ok && threads_may_go_on(pool, e);
}

typedef struct repeat_job {
    const mesh_projection *l;
    vec3 *place;
    double most;
} repeat_job;

static void repeat_chunk(void *context, int worker, size_t begin, size_t end)
{
    const repeat_job *r = context;
    (void)worker;
    for (size_t i = begin; i < end; i++) {
        vec3 nearest;
        if (find_place(&r->l->source->whole, r->place[i], true, &nearest) &&
            !(vec3_norm(vec3_sub(nearest, r->place[i])) <= r->most))
            r->place[i] = project(r->l, r->place[i]);
    }
}

void mesh_projection_repeat(const mesh_projection *l, vec3 *place, size_t count, double most, threads *pool)
{
    threads_run(pool, count, GRAIN, repeat_chunk, &(repeat_job){l, place, most});
}
