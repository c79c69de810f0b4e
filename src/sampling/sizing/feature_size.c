// SPDX-License-Identifier: Apache-2.0
#include "sampling/sizing/feature_size.h"

#include <math.h>
#include <stdlib.h>

#include "base/core/memory.h"
#include "sampling/voronoi/resolution.h"
#include "sampling/sizing/elements.h"

/* Maximum distance, in cubes, of the contact of a ball with the plane of an element from the centre of the
 * element: no gap between two elements remains. */
static const double PATCH = 0.9;
/* Half the diagonal of a cube: maximum distance of an element from the centre of its cube. */
static const double HALF_DIAGONAL = 0.8660254037844386;
/* Balls are searched within REACH cubes, and cubes grow by the factor GROWTH: except at the first level a
 * ball is at least two cubes wide. */
enum { REACH = 4, GROWTH = 2 };
enum { OFFSETS_SIDE = 2 * (REACH + 1) + 1, MOST_OFFSETS = OFFSETS_SIDE * OFFSETS_SIDE * OFFSETS_SIDE };

/* A cube relative to another one. */
typedef struct offset {
    int at[3];
    double distance; /* between the centres, in cubes */
} offset;

typedef struct feature_search {
    const surface *scan;
    const cell_samples *sample;
    cell_samples on_faces; /* replaces `sample` if cells consist of triangles; owns `normal` only */
    offset *offset;        /* offsets within reach, sorted by distance */
    size_t offsets;
    elements elements;
    bool *is_asked, *sees; /* per element: a sample in it has no size yet; it has a ball */
    double *size;
} feature_search;

static int compare_offsets(const void *a, const void *b)
{
    const offset *x = a, *y = b;
    if (x->distance != y->distance) return x->distance < y->distance ? -1 : 1;
    for (int k = 0; k < 3; k++)
        if (x->at[k] != y->at[k]) return x->at[k] - y->at[k];
    return 0;
}

static bool list_offsets(feature_search *m, error *e)
{
    m->offset = mem_array(MOST_OFFSETS, sizeof *m->offset, "the feature size", e);
    if (!m->offset) return false;
    for (int k = -REACH - 1; k <= REACH + 1; k++)
        for (int j = -REACH - 1; j <= REACH + 1; j++)
            for (int i = -REACH - 1; i <= REACH + 1; i++) {
                offset o = {{i, j, k}, sqrt(i * i + j * j + k * k)};
                if (o.distance <= REACH + 1) m->offset[m->offsets++] = o;
            }
    qsort(m->offset, m->offsets, sizeof *m->offset, compare_offsets);
    return true;
}

/* The radius of the ball that touches the surface at x and the plane of an opposite element. INFINITY: it
 * does not touch the plane within the element. */
static double ball_radius(const elements *s, const element *other, vec3 x, vec3 normal)
{
    double cosine = vec3_dot(normal, other->normal);
    if (cosine >= RESOLUTION_OPPOSITE) return INFINITY;
    vec3 d = vec3_sub(other->position, x);
    double radius = vec3_dot(d, other->normal) / (1 - cosine); /* < 0: the ball is outside the solid */
    if (!(radius * vec3_dot(d, normal) < 0)) return INFINITY;  /* the other wall is on the side of the ball */
    vec3 touch = vec3_scale(vec3_sub(other->normal, normal), radius); /* relative to x */
    double patch = PATCH * s->edge;
    return vec3_norm2(vec3_sub(touch, d)) <= patch * patch ? fabs(radius) : INFINITY;
}

/* Whether a ball can touch an element in a cube at this offset: contacts lie in a cone about the normal. */
static bool is_in_cone(const offset *o, vec3 normal)
{
    static const double SLOPE =
        0.6546536707079771; /* tangent of half the angle that RESOLUTION_OPPOSITE permits */
    double along = fabs(o->at[0] * normal.x + o->at[1] * normal.y + o->at[2] * normal.z);
    double slack = 2 * HALF_DIAGONAL + PATCH;
    double across2 = o->distance * o->distance - along * along, most = SLOPE * (along + slack) + slack;
    return across2 <= most * most;
}

/* The radius of the smallest ball within reach. */
static double find_ball(const feature_search *m, vec3 x, vec3 normal)
{
    const elements *s = &m->elements;
    elements_cube from = elements_cube_of(s, x);
    double best = 0.5 * REACH * s->edge;
    bool found = false;
    for (size_t k = 0; k < m->offsets; k++) {
        const offset *o = &m->offset[k];
        if ((o->distance - 2 * HALF_DIAGONAL - PATCH) * s->edge > 2 * best) break;
        if (!is_in_cone(o, normal)) continue;
        for (uint32_t n = elements_first(s, from, o->at[0], o->at[1], o->at[2]); n != BLOCK_MAP_NONE;
             n = s->element[n].next) {
            double radius = ball_radius(s, &s->element[n], x, normal);
            if (radius > best) continue;
            best = radius;
            found = true;
        }
    }
    return found ? best : INFINITY;
}

static void look_from_elements(void *context, int worker, size_t begin, size_t end)
{
    feature_search *m = context;
    (void)worker;
    for (size_t k = begin; k < end; k++) {
        const element *n = &m->elements.element[k];
        m->sees[k] = m->is_asked[k] && isfinite(find_ball(m, n->position, n->normal));
    }
}

static bool is_open(const feature_search *m, size_t cell)
{
    return m->sample->found[cell] && isinf(m->size[cell]) && surface_cell_area(m->scan, cell) > 0;
}

static void look_from_cells(void *context, int worker, size_t begin, size_t end)
{
    feature_search *m = context;
    const cell_samples *s = m->sample;
    (void)worker;
    for (size_t k = begin; k < end; k++)
        if (is_open(m, k) && m->sees[elements_find(&m->elements, s->position[k], s->normal[k], s->patch[k])])
            m->size[k] = find_ball(m, s->position[k], s->normal[k]);
}

/* Finds balls within the reach of cubes of this edge. *open: some cells have no size. False: out of
 * memory. */
static bool measure_level(feature_search *m, double edge, threads *pool, bool *open, error *e)
{
    const char *what = "the feature size";
    bool ok = elements_make(m->scan, m->sample, edge, &m->elements, e);
    if (ok) {
        m->is_asked = mem_array(m->scan->cells, sizeof *m->is_asked, what, e);
        m->sees = mem_array(m->scan->cells, sizeof *m->sees, what, e);
        ok = m->is_asked && m->sees;
    }
    *open = false;
    for (size_t k = 0; ok && k < m->scan->cells; k++) {
        if (!is_open(m, k)) continue;
        m->is_asked[elements_find(&m->elements, m->sample->position[k], m->sample->normal[k],
                                  m->sample->patch[k])] = true;
        *open = true;
    }
    if (ok && *open) {
        threads_run(pool, m->elements.count, THREADS_GRAIN, look_from_elements, m);
        threads_run(pool, m->scan->cells, THREADS_GRAIN, look_from_cells, m);
    }
    elements_free(&m->elements);
    free(m->is_asked);
    free(m->sees);
    m->is_asked = m->sees = NULL;
    return ok;
}

/* Uses the normals of the triangles themselves. Interpolated normals turn over a whole triangle, so that
 * opposite walls near an edge of large triangles would not be detected. */
static bool take_faces(feature_search *m, const cell_samples *sample, error *e)
{
    vec3 t[FIELD_CELL_TRIANGLES][3];
    m->sample = sample;
    if (!m->scan->field->ops->cell_triangles) return true;
    m->on_faces = *sample;
    m->on_faces.normal = mem_array(m->scan->cells, sizeof *m->on_faces.normal, "the feature size", e);
    if (!m->on_faces.normal) return false;
    m->sample = &m->on_faces;
    for (size_t k = 0; k < m->scan->cells; k++) {
        if (!sample->found[k]) continue;
        const vec3 own = sample->normal[k];
        surface_cell_triangles(m->scan, k, t);
        const vec3 across = vec3_cross(vec3_sub(t[0][1], t[0][0]), vec3_sub(t[0][2], t[0][0]));
        m->on_faces.normal[k] = !(vec3_norm2(across) > 0)   ? own
                                : vec3_dot(across, own) < 0 ? vec3_unit(vec3_scale(across, -1))
                                                            : vec3_unit(across);
    }
    return true;
}

bool feature_size_measure(const surface *scan, const cell_samples *sample, threads *pool, double *size,
                          error *e)
{
    feature_search m = {.scan = scan, .size = size};
    double edge = ELEMENTS_LEAST_EDGE * scan->field->cell_size, widest = bbox_longest(scan->box);
    bool ok = take_faces(&m, sample, e) && list_offsets(&m, e), open = true;
    for (size_t k = 0; k < scan->cells; k++) size[k] = INFINITY;
    for (; ok && open && edge < widest && !threads_stopped(pool); edge *= GROWTH)
        ok = measure_level(&m, edge, pool, &open, e);
    ok = ok && threads_may_go_on(pool, e);
    free(m.offset);
    free(m.on_faces.normal);
    return ok;
}
