// SPDX-License-Identifier: Apache-2.0
#include "sampling/solver/passes/refine.h"

#include <assert.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"
#include "base/core/rng.h"
#include "base/core/sets.h"
#include "surface/field/projection.h"
#include "sampling/voronoi/voronoi.h"
#include "sampling/solver/particles/population.h"
#include "sampling/solver/particles/random_streams.h"
#include "sampling/solver/start.h"

/* Maximum displacement of a midpoint by its projection over h. A regular midpoint is a few hundredths of h
 * off the surface; beyond the limit its edge connects opposite walls. */
static const double MAX_PROJECTION = 0.5;
/* Projection tolerance over h. */
static const double TOLERANCE = 1e-3;
/* Distance from the surface over h from which a Newton step needs no verification. The error after it is half
 * the square of this times h over the radius of curvature: within TOLERANCE if h resolves the surface. */
static const double SHORTCUT = 0.02;

size_t refine_coarser(size_t count)
{
    return (count + 6 + 3) / 4;
}

/* Points, or edges, of a task of the thread pool. */
enum { CHUNK = THREADS_GRAIN };

typedef struct edge {
    uint32_t a, b;
    float length;    /* over the mean spacing of its ends */
    uint32_t copies; /* particles to insert on it */
} edge;

/* The particles as Voronoi sites and their edges. An edge is stored at its end of lower index. */
typedef struct refine_mesh {
    size_t points;
    double *spacing;
    uint8_t *flags; /* NULL: no patches */
    neighbours *near;
    voronoi_sites sites;
    uint32_t *places; /* per point: bit k is set if entry k of its neighbour list is the end of an edge */
    size_t *first;    /* per chunk of points and one more: its first edge */
    size_t count;
    edge *edges;
} mesh;

/* Bit of `places` if an edge ends at an entry beyond the bits: the edges of the point are computed again. */
#define BEYOND_BITS ((uint32_t)1 << 31)

static size_t chunks_of(size_t n)
{
    return (n + CHUNK - 1) / CHUNK;
}

/* Stores the edges of point i to points of higher index in places[i]. Returns their number. */
static size_t mark_edges(mesh *m, uint32_t i, const voronoi_star *star)
{
    size_t found = 0;
    m->places[i] = 0;
    for (uint32_t k = 0; k < star->count; k++) {
        if (star->point[k] < i) continue;
        m->places[i] |= star->place[k] < 31 ? (uint32_t)1 << star->place[k] : BEYOND_BITS;
        found++;
    }
    return found;
}

static void count_chunk(void *context, int worker, size_t begin, size_t end)
{
    mesh *m = context;
    (void)worker;
    size_t found = 0;
    voronoi_star star;
    for (uint32_t i = (uint32_t)begin; i < end; i++) {
        voronoi_star_at(&m->sites, i, &star);
        found += mark_edges(m, i, &star);
    }
    m->first[begin / CHUNK + 1] = found;
}

static edge edge_between(const voronoi_sites *s, uint32_t i, uint32_t j)
{
    double length = vec3_norm(vec3_sub(s->position[i], s->position[j]));
    return (edge){i, j, (float)(length / (0.5 * (s->spacing[i] + s->spacing[j]))), 1};
}

static void list_chunk(void *context, int worker, size_t begin, size_t end)
{
    const mesh *m = context;
    (void)worker;
    edge *out = m->edges + m->first[begin / CHUNK];
    for (uint32_t i = (uint32_t)begin; i < end; i++) {
        const uint32_t *list = neighbours_list(m->near, i);
        if (m->places[i] & BEYOND_BITS) {
            voronoi_star star;
            voronoi_star_at(&m->sites, i, &star);
            for (uint32_t k = 0; k < star.count; k++)
                if (star.point[k] > i) *out++ = edge_between(&m->sites, i, star.point[k]);
        } else
            for (uint32_t left = m->places[i]; left; left &= left - 1)
                *out++ = edge_between(&m->sites, i, list[__builtin_ctz(left)]);
    }
    assert(out == m->edges + m->first[begin / CHUNK + 1]);
}

void refine_mesh_free(refine_mesh *m)
{
    if (!m) return;
    neighbours_free(m->near);
    free(m->spacing);
    free(m->flags);
    free(m->places);
    free(m->first);
    free(m->edges);
    free(m);
}

/* Finds and counts the edges. Releasing *out after failure is the caller's task. */
static bool fill_mesh(const particles *p, double spacing, threads *pool, mesh *out, error *e)
{
    const char *what = "refinement";
    size_t chunks = chunks_of(p->count);
    *out = (mesh){.points = p->count,
                  .spacing = mem_array(p->count, sizeof *out->spacing, what, e),
                  .near = neighbours_new(p->count, SIZE_MAX, e),
                  .places = mem_array(p->count, sizeof *out->places, what, e),
                  .first = mem_array(chunks + 1, sizeof *out->first, what, e)};
    if (!out->spacing || !out->near || !out->places || !out->first) return false;
    for (size_t i = 0; i < p->count; i++) out->spacing[i] = spacing * particles_size(p, i);
    out->near->label = p->patch;
    if (p->patch && !(out->flags = mem_array(p->count, sizeof *out->flags, what, e))) return false;
    if (p->patch) particles_flags(p, out->flags);
    if (!neighbours_build(out->near, p->count, p->position, out->spacing, VORONOI_REACH, pool, e))
        return false;
    out->sites = (voronoi_sites){p->position, p->normal, out->spacing, out->near, out->flags, NULL};
    threads_run(pool, p->count, CHUNK, count_chunk, out);
    if (!threads_may_go_on(pool, e)) return false;
    for (size_t k = 0; k < chunks; k++) out->first[k + 1] += out->first[k];
    out->count = out->first[chunks];
    return true;
}

refine_mesh *refine_mesh_new(const particles *p, double spacing, threads *pool, error *e)
{
    mesh *m = mem_alloc(sizeof *m);
    if (fill_mesh(p, spacing, pool, m, e)) return m;
    refine_mesh_free(m);
    return NULL;
}

size_t refine_mesh_edges(const refine_mesh *m)
{
    return m->count;
}

/* Lists the edges and releases the neighbour lists. */
static bool mesh_edges(mesh *m, threads *pool, error *e)
{
    m->edges = mem_array(m->count, sizeof *m->edges, "refinement", e);
    if (!m->edges) return false;
    threads_run(pool, m->points, CHUNK, list_chunk, m);
    neighbours_free(m->near);
    m->near = NULL;
    return true;
}

/* A connected component of the mesh, or a patch. If it has too many edges, the shortest get no particle; if
 * too few, the longest get two. The shortest and longest edges are at the cores of dislocations: an extra or
 * missing particle there only moves a dislocation. Elsewhere it would be an additional defect. */
typedef struct mesh_part {
    size_t members, edges;
    bool longest;   /* its longest edges are picked, otherwise its shortest */
    size_t picks;   /* edges to pick */
    size_t picked;  /* edges in the heap */
    uint32_t *pick; /* heap of picked edges; the first to replace is at the root */
} mesh_part;

/* Whether edge x is preferred to edge y. */
static bool is_better(const edge *edges, bool longest, uint32_t x, uint32_t y)
{
    if (edges[x].length != edges[y].length) return longest == (edges[x].length > edges[y].length);
    return longest == (x > y);
}

/* Inserts x into the heap at the vacant node k or below. */
static void sift_down(mesh_part *p, const edge *edges, size_t k, uint32_t x)
{
    for (size_t child = 2 * k + 1; child < p->picked; child = 2 * k + 1) {
        if (child + 1 < p->picked && is_better(edges, p->longest, p->pick[child], p->pick[child + 1]))
            child++;
        if (is_better(edges, p->longest, p->pick[child], x)) break;
        p->pick[k] = p->pick[child];
        k = child;
    }
    p->pick[k] = x;
}

/* Inserts x into the heap at the vacant node k or above. */
static void sift_up(mesh_part *p, const edge *edges, size_t k, uint32_t x)
{
    for (; k > 0 && is_better(edges, p->longest, p->pick[(k - 1) / 2], x); k = (k - 1) / 2)
        p->pick[k] = p->pick[(k - 1) / 2];
    p->pick[k] = x;
}

static void offer_edge(mesh_part *p, const edge *edges, uint32_t x)
{
    if (p->picked < p->picks)
        sift_up(p, edges, p->picked++, x);
    else if (p->picks > 0 && is_better(edges, p->longest, x, p->pick[0]))
        sift_down(p, edges, 0, x);
}

typedef struct parts_job {
    const mesh *m;
    uint32_t *part_of;
} parts_job;

static void join_chunk(void *context, int worker, size_t begin, size_t end)
{
    const parts_job *job = context;
    (void)worker;
    for (const edge *e = job->m->edges + begin; e < job->m->edges + end; e++)
        sets_join_shared(job->part_of, e->a, e->b);
}

/* Sets part_of of each point. Parts are numbered in the order of their first points. Returns their number. */
static size_t number_parts(const mesh *m, uint32_t *part_of, threads *pool)
{
    parts_job job = {m, part_of};
    uint32_t parts = 0;
    sets_reset(part_of, m->points);
    threads_run(pool, m->count, CHUNK, join_chunk, &job);
    for (size_t k = 0; k < m->points; k++) part_of[k] = part_of[part_of[k]];
    for (size_t k = 0; k < m->points; k++) part_of[k] = part_of[k] == k ? parts++ : part_of[part_of[k]];
    return parts;
}

/* Sets `longest` and `picks` so that every part keeps its fraction of the particles. Returns the sum of
 * picks. In proportion to edges, small parts would lose particles: a closed part of n points has 3 n - 6
 * edges. */
static size_t assign_picks(mesh_part *parts, size_t count, double share)
{
    double assigned = 0;
    size_t sum = 0;
    for (mesh_part *p = parts; p < parts + count; p++) {
        if (p->edges == 0) continue;
        double members = (double)p->members;
        double wanted = round((assigned + members) * share) - round(assigned * share) - members;
        double missing = fmax(wanted, 0) - (double)p->edges;
        assigned += members;
        p->longest = missing > 0;
        p->picks = (size_t)fmin(fabs(missing), (double)p->edges);
        sum += p->picks;
    }
    return sum;
}

/* Number of free particles of each patch; NULL: limit_memory. */
static uint32_t *count_free(const particles *p, error *e)
{
    uint32_t *count = mem_array(p->patches->count, sizeof *count, "refinement", e);
    for (size_t i = 0; count && i < p->count; i++) count[p->patch[i]] += !particles_is_fixed(p, i);
    return count;
}

/* Sets `longest` and `picks` of patches by their quotas. *picks: the sum. */
static bool assign_patch_picks(mesh_part *parts, const particles *p, const quota *next, size_t *picks,
                               error *e)
{
    uint32_t *count = count_free(p, e);
    *picks = 0;
    for (size_t k = 0; count && k < p->patches->count; k++) {
        double missing = fmax((double)next->free[k] - count[k], 0) - (double)parts[k].edges;
        parts[k].longest = missing > 0;
        parts[k].picks = (size_t)fmin(fabs(missing), (double)parts[k].edges);
        *picks += parts[k].picks;
    }
    free(count);
    return count != NULL;
}

/* Whether x is nearer to the curves of its patch than new particles may be. `spacing`: of the coarser
 * level, twice the finer one. */
static bool is_too_near_curve(const refine_patches *patches, uint32_t patch, vec3 x, double spacing)
{
    return curve_distance_at(patches->curves, patch, x) < 0.5 * START_CLEARANCE * spacing;
}

/* Removes the edges along curves: both ends are fixed and the midpoint is near a curve. */
static void remove_curve_edges(mesh *m, const particles *p, const refine_patches *patches)
{
    size_t kept = 0;
    for (size_t k = 0; k < m->count; k++) {
        const edge *e = &m->edges[k];
        double spacing = fmin(m->spacing[e->a], m->spacing[e->b]);
        vec3 middle = vec3_scale(vec3_add(p->position[e->a], p->position[e->b]), 0.5);
        if (!particles_is_fixed(p, e->a) || !particles_is_fixed(p, e->b) ||
            !is_too_near_curve(patches, p->patch[e->a], middle, spacing))
            m->edges[kept++] = *e;
    }
    m->count = kept;
}

/* Sets `copies` of each edge for a total of `count` particles, or for the quotas of patches. */
static bool choose_edges(mesh *m, size_t count, const particles *p, const refine_patches *patches,
                         threads *pool, error *e)
{
    const char *what = "refinement";
    bool ok = false;
    mesh_part *parts = NULL;
    uint32_t *picks = NULL, *part_of = mem_array(m->points, sizeof *part_of, what, e);
    if (!part_of) return false;
    size_t number = patches ? p->patches->count : number_parts(m, part_of, pool), sum;
    if (patches) memcpy(part_of, p->patch, m->points * sizeof *part_of);
    parts = mem_array(number, sizeof *parts, what, e);
    if (!parts) goto done;
    for (size_t k = 0; k < m->points; k++) parts[part_of[k]].members++;
    for (size_t k = 0; k < m->count; k++) parts[part_of[m->edges[k].a]].edges++;
    if (!patches)
        sum = assign_picks(parts, number, (double)count / (double)m->points);
    else if (!assign_patch_picks(parts, p, patches->next, &sum, e))
        goto done;
    picks = mem_array(sum, sizeof *picks, what, e);
    if (!picks) goto done;
    uint32_t *next = picks;
    for (size_t k = 0; k < number; next += parts[k++].picks) parts[k].pick = next;
    for (size_t k = 0; k < m->count; k++) offer_edge(&parts[part_of[m->edges[k].a]], m->edges, (uint32_t)k);
    for (mesh_part *part = parts; part < parts + number; part++)
        for (size_t k = 0; k < part->picked; k++) m->edges[part->pick[k]].copies = part->longest ? 2 : 0;
    ok = true;
done:
    free(part_of);
    free(parts);
    free(picks);
    return ok;
}

/* Insertion of particles. Each chunk of edges has its own range of indices. */
typedef struct midpoint_job {
    const field *f;
    const refine_patches *patches;
    const mesh *m;
    particles *p;
    size_t *first; /* per chunk and one more: the first index of its particles */
    size_t *kept;  /* per chunk: number of valid particles */
} midpoint_job;

/* Midpoints that are projected in SIMD lanes. */
typedef struct midpoint_lanes {
    const edge *edge[VEC3_LANES];
    vec3_lanes from;      /* on the edge */
    vec3_lanes x, normal; /* projected */
    double spacing[VEC3_LANES];
    double unit[VEC3_LANES]; /* scale of the projection limits */
    bool found[VEC3_LANES];
    uint32_t patch[VEC3_LANES], hint[VEC3_LANES];
    int count;
} midpoint_lanes;

static const projection_limits midpoint_limits = {5, TOLERANCE, SHORTCUT, TOLERANCE};

/* The point of the arc over an edge that has the normals of the edge's ends. At the parameter t it is
 * t (1 - t) / 2 (b - a).(n_b - n_a) beyond the edge. `place`: a point of the edge. */
static vec3 place_on_arc(const particles *p, const edge *e, vec3 place)
{
    const vec3 turn = vec3_sub(p->normal[e->b], p->normal[e->a]),
               along = vec3_sub(p->position[e->b], p->position[e->a]);
    const double t = vec3_dot(vec3_sub(place, p->position[e->a]), along) / vec3_norm2(along);
    const vec3 up = vec3_axpy(t, turn, p->normal[e->a]);
    const double depth = t * (1 - t) / 2 * vec3_dot(along, turn), length = vec3_norm(up);
    return length > 0 ? vec3_axpy(depth / length, up, place) : place;
}

/* Projects one midpoint. If that fails, projects from the arc over the edge. (Edges of a coarse level may
 * leave the region where F is known, such as the narrow band of a level set.) *hint: a location nearby on
 * the field. */
static bool project_midpoint(const midpoint_job *job, midpoint_lanes *m, int l, uint32_t *hint)
{
    const double h = m->unit[l];
    const edge *e = m->edge[l];
    const field *f = particles_field(job->p, job->f, e->a);
    const projection_limits limits = {midpoint_limits.max_steps, midpoint_limits.accept * h,
                                      midpoint_limits.shortcut * h, midpoint_limits.reject * h};
    vec3 x = vec3_lanes_get(&m->from, l), normal;
    if (!projection_find_near(f, &limits, hint, &x, &normal)) {
        x = place_on_arc(job->p, e, vec3_lanes_get(&m->from, l));
        if (!projection_find_near(f, &limits, hint, &x, &normal)) return false;
    }
    vec3_lanes_put(&m->x, l, x);
    vec3_lanes_put(&m->normal, l, normal);
    return true;
}

/* Projects midpoints of patches, with the hints of the edges' first ends. A result with an opposite normal is
 * on the opposite wall, because the hint is outdated: it is projected again without a hint. */
static void project_patch_midpoints(const midpoint_job *job, midpoint_lanes *m)
{
    const particles *p = job->p;
    projection_find_lanes(job->f, &midpoint_limits, m->unit, m->patch, m->found, m->hint, &m->x, &m->normal);
    for (int l = 0; l < m->count; l++) {
        if (m->found[l] && !(vec3_dot(vec3_lanes_get(&m->normal, l), p->normal[m->edge[l]->a]) < 0)) continue;
        m->hint[l] = FIELD_NO_HINT;
        m->found[l] = project_midpoint(job, m, l, &m->hint[l]);
    }
}

/* Projects all midpoints of m. *last: the hint of the previous projection. */
static void project_midpoints(const midpoint_job *job, midpoint_lanes *m, uint32_t *last)
{
    const particles *p = job->p;
    for (int l = 0; l < VEC3_LANES; l++) {
        m->found[l] = l < m->count;
        m->unit[l] = m->found[l] ? projection_scale(job->f, m->spacing[l]) : 1;
        m->patch[l] = m->found[l] ? particles_patch(p, m->edge[l]->a) : 0;
        m->hint[l] = m->found[l] && p->patch ? p->hint[m->edge[l]->a] : FIELD_NO_HINT;
    }
    m->x = m->from;
    if (p->patch && job->f->ops->sample_patch_lanes) {
        project_patch_midpoints(job, m);
        return;
    }
    const bool in_lanes = !p->patch && !job->f->open && job->f->ops->sample_lanes;
    if (in_lanes)
        projection_find_lanes(job->f, &midpoint_limits, m->unit, NULL, m->found, NULL, &m->x, &m->normal);
    for (int l = 0; l < m->count; l++) {
        if (in_lanes && m->found[l]) continue;
        if (m->hint[l] != FIELD_NO_HINT) *last = m->hint[l];
        m->found[l] = project_midpoint(job, m, l, last);
        m->hint[l] = *last;
    }
}

/* Stores a midpoint as particle `place`. False: the edge connects opposite walls, or the midpoint is not on
 * its patch or too near a curve. */
static bool store_midpoint(const midpoint_job *job, midpoint_lanes *m, int l, size_t place)
{
    const double spacing = m->spacing[l];
    const vec3 x = vec3_lanes_get(&m->x, l);
    particles *p = job->p;
    if (!m->found[l] || vec3_norm2(vec3_sub(x, vec3_lanes_get(&m->from, l))) >=
                            MAX_PROJECTION * MAX_PROJECTION * spacing * spacing)
        return false;
    p->position[place] = x;
    p->normal[place] = vec3_lanes_get(&m->normal, l);
    if (!job->patches) return true;
    const uint32_t patch = m->patch[l];
    p->patch[place] = patch;
    p->place[place] = PARTICLES_FREE;
    const bool within = field_is_within_near(field_of_patch(job->f, patch), x, &m->hint[l]);
    p->hint[place] = m->hint[l];
    return within && !is_too_near_curve(job->patches, patch, x, spacing);
}

/* Projects and stores midpoints from index `place` on. Returns their number. */
static size_t store_midpoints(const midpoint_job *job, midpoint_lanes *m, size_t place, uint32_t *last)
{
    size_t stored = 0;
    if (m->count == 0) return 0;
    for (int l = m->count; l < VEC3_LANES; l++) m->spacing[l] = m->spacing[0];
    project_midpoints(job, m, last);
    for (int l = 0; l < m->count; l++) stored += store_midpoint(job, m, l, place + stored);
    m->count = 0;
    return stored;
}

static void midpoint_chunk(void *context, int worker, size_t begin, size_t end)
{
    const midpoint_job *job = context;
    const voronoi_sites *s = &job->m->sites;
    (void)worker;
    size_t place = job->first[begin / CHUNK];
    uint32_t last = FIELD_NO_HINT;
    midpoint_lanes m = {.count = 0};
    for (const edge *e = job->m->edges + begin; e < job->m->edges + end; e++)
        for (uint32_t k = 1; k <= e->copies; k++) {
            const vec3 along = vec3_sub(s->position[e->b], s->position[e->a]);
            vec3_lanes_put(&m.from, m.count, vec3_axpy(k / (e->copies + 1.0), along, s->position[e->a]));
            m.spacing[m.count] = fmin(s->spacing[e->a], s->spacing[e->b]);
            m.edge[m.count++] = e;
            if (m.count == VEC3_LANES) place += store_midpoints(job, &m, place, &last);
        }
    place += store_midpoints(job, &m, place, &last);
    job->kept[begin / CHUNK] = place - job->first[begin / CHUNK];
}

/* Inserts the particles of all edges, in the order of the edges, except those whose projection failed. */
static bool insert_midpoints(const field *f, const refine_patches *patches, const mesh *m, threads *pool,
                             particles *p, error *e)
{
    size_t chunks = chunks_of(m->count), *first = mem_array(2 * chunks + 1, sizeof *first, "refinement", e);
    if (!first) return false;
    midpoint_job job = {f, patches, m, p, first, first + chunks + 1};
    first[0] = p->count;
    for (size_t k = 0; k < m->count; k++) first[k / CHUNK + 1] += m->edges[k].copies;
    for (size_t k = 0; k < chunks; k++) first[k + 1] += first[k];
    threads_run(pool, m->count, CHUNK, midpoint_chunk, &job);
    for (size_t k = 0; k < chunks; k++) { /* closes the gaps between chunks */
        if (p->count != first[k]) {
            memmove(p->position + p->count, p->position + first[k], job.kept[k] * sizeof *p->position);
            memmove(p->normal + p->count, p->normal + first[k], job.kept[k] * sizeof *p->normal);
            if (patches) {
                memmove(p->patch + p->count, p->patch + first[k], job.kept[k] * sizeof *p->patch);
                memmove(p->hint + p->count, p->hint + first[k], job.kept[k] * sizeof *p->hint);
            }
        }
        p->count += job.kept[k];
    }
    free(first);
    return threads_may_go_on(pool, e);
}

/* Draws the missing particles at random on the surface. */
static bool draw_missing(const field *f, const surface *scan, const sizing_field *sizing, particles *p,
                         size_t count, double spacing, uint64_t seed, error *e)
{
    rng r = rng_seed(seed, RANDOM_STREAM_REFINEMENT);
    const projection_limits limits = projection_draft(spacing);
    for (int draws = 0; p->count < count; draws++) {
        vec3 x = sizing_field_draw(sizing, scan, rng_uniform(&r), &r, NULL), n;
        if (draws == START_MAX_DRAWS)
            return error_set(
                e, ERROR_NO_SURFACE,
                "no place on the surface was found for particle %zu of %zu in %d random draws: the field "
                "has no usable gradient near its isosurface",
                p->count + 1, count, draws);
        if (!projection_find(f, &limits, &x, &n)) continue;
        p->position[p->count] = x;
        p->normal[p->count++] = n;
        draws = 0;
    }
    return true;
}

/* Draws a random point of a patch, at first with the minimum distance from its curves. False:
 * START_MAX_DRAWS failed. */
static bool draw_on_patch(const field *f, const surface *scan, const sizing_field *sizing,
                          const refine_patches *patches, uint32_t patch, double spacing, rng *r, vec3 *x,
                          vec3 *normal)
{
    const double *weight = sizing_field_weight(sizing, scan);
    const projection_limits limits = projection_draft(spacing);
    for (int draw = 0; draw < START_MAX_DRAWS; draw++) {
        uint32_t hint;
        if (surface_patch_point(scan, weight, patch, rng_uniform(r), r, x, &hint) &&
            projection_find_near(field_of_patch(f, patch), &limits, &hint, x, normal) &&
            field_is_within_near(field_of_patch(f, patch), *x, &hint) &&
            (draw >= START_CLEAR_DRAWS || !is_too_near_curve(patches, patch, *x, spacing)))
            return true;
    }
    return false;
}

/* A free particle, to find those with the same position. */
typedef struct located {
    vec3 at;
    uint32_t patch, index;
} located;

static int compare_places(const located *a, const located *b)
{
    return a->patch != b->patch ? (a->patch > b->patch ? 1 : -1) : vec3_compare(a->at, b->at);
}

static int compare_located(const void *left, const void *right)
{
    const located *a = left, *b = right;
    const int order = compare_places(a, b);
    return order ? order : (a->index > b->index) - (a->index < b->index);
}

/* Marks all but the first of free particles with the same position. On patches smaller than the spacing,
 * midpoints of several edges project to one vertex of a triangle; no force separates them. */
static bool mark_duplicates(const particles *p, bool *removed, error *e)
{
    located *list = mem_array(p->count, sizeof *list, "refinement", e);
    size_t count = 0;
    if (!list) return false;
    for (uint32_t i = 0; i < p->count; i++)
        if (!particles_is_fixed(p, i)) list[count++] = (located){p->position[i], p->patch[i], i};
    qsort(list, count, sizeof *list, compare_located);
    for (size_t k = 1; k < count; k++) removed[list[k].index] = compare_places(&list[k - 1], &list[k]) == 0;
    free(list);
    return true;
}

/* Removes particles with duplicate positions and particles beyond the quota of their patch. */
static bool remove_surplus(particles *p, const quota *next, error *e)
{
    bool *removed = mem_array(p->count, sizeof *removed, "refinement", e);
    uint32_t *count = mem_array(p->patches->count, sizeof *count, "refinement", e);
    bool ok = removed && count && mark_duplicates(p, removed, e);
    for (size_t i = 0; ok && i < p->count; i++)
        if (!removed[i] && !particles_is_fixed(p, i))
            removed[i] = count[p->patch[i]]++ >= next->free[p->patch[i]];
    if (ok) population_remove(p, removed);
    free(removed);
    free(count);
    return ok;
}

/* Fills each patch to its quota and replaces the curve samples. */
static bool fill_patches(const field *f, const surface *scan, const sizing_field *sizing,
                         const refine_patches *patches, particles *p, double spacing, uint64_t seed, error *e)
{
    rng r = rng_seed(seed, RANDOM_STREAM_REFINEMENT);
    if (!remove_surplus(p, patches->next, e)) return false;
    uint32_t *count = count_free(p, e);
    bool ok = count != NULL;
    for (uint32_t k = 0; ok && k < p->patches->count; k++)
        for (; ok && count[k] < patches->next->free[k]; count[k]++) {
            size_t i = p->count;
            ok = draw_on_patch(f, scan, sizing, patches, k, spacing, &r, &p->position[i], &p->normal[i]) ||
                 error_set(e, ERROR_NO_SURFACE, "a particle does not reach its patch in %d draws",
                           START_MAX_DRAWS);
            p->patch[i] = k;
            p->hint[i] = FIELD_NO_HINT;
            p->place[i] = PARTICLES_FREE;
            p->count += ok;
        }
    free(count);
    return ok && quota_replace_samples(patches->next, p, e);
}

bool refine_particles(const field *f, const surface *scan, const sizing_field *sizing,
                      const refine_patches *patches, refine_mesh *m, particles *p, size_t count,
                      double spacing, uint64_t seed, threads *pool, error *e)
{
    assert(count >= p->count || patches);
    assert(m->points == p->count);
    bool ok = mesh_edges(m, pool, e);
    if (ok && patches) remove_curve_edges(m, p, patches);
    return ok && choose_edges(m, count, p, patches, pool, e) && insert_midpoints(f, patches, m, pool, p, e) &&
           (patches ? fill_patches(f, scan, sizing, patches, p, spacing, seed, e)
                    : draw_missing(f, scan, sizing, p, count, spacing, seed, e));
}
