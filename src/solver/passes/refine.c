#include "solver/passes/refine.h"

#include <assert.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "base/rng.h"
#include "base/sets.h"
#include "field/projection.h"
#include "voronoi/star_lanes.h"
#include "solver/particles/population.h"
#include "solver/particles/random_streams.h"

/* A middle lies within a few hundredths of h of the surface; one that is farther joins two sheets. */
static const double MIDDLE_FARTHEST = 0.5;
static const double MIDDLE_ACCEPT = 1e-3;
/* A step from this close ends within that where h resolves the surface: the error left is half the square of
 * this times h over the radius of curvature. */
static const double MIDDLE_SHORTCUT = 0.02;
/* Draws per particle that the edges did not give. */
static const int MAX_DRAWS = 1000;
/* Particles keep this far from their patch's curves, in the finer spacing, which is half of the one at hand: half of what a row
 * and the next have between them. A draw does not insist after so many tries. */
static const double CURVE_CLEAR = 0.5 * 0.45;
enum { CURVE_DRAWS = 20 };

size_t refine_coarser(size_t count)
{
    return (count + 6 + 3) / 4;
}

/* Points, or edges, in a chunk of work. */
#define CHUNK 256

typedef struct edge {
    uint32_t a, b;
    float length;    /* over the mean spacing of its ends */
    uint32_t copies; /* particles to add on it */
} edge;

/* The particles as sites, and their edges: those to a point of higher index, chunk by chunk. */
typedef struct refine_mesh {
    size_t points;
    double *spacing;
    uint8_t *flags; /* NULL: no patches */
    neighbours *near;
    voronoi_sites sites;
    uint32_t *places; /* of each point's edges, as bits for the places in its list */
    size_t *first;    /* edge of each chunk of points, and the end */
    size_t count;
    edge *edges;
} mesh;

/* Set where a point's edges are not all at places that have a bit. */
#define ELSEWHERE ((uint32_t)1 << 31)

static size_t chunks_of(size_t n)
{
    return (n + CHUNK - 1) / CHUNK;
}

/* Those to points of higher index; returns how many. */
static size_t note_edges(mesh *m, uint32_t i, const voronoi_star *star)
{
    size_t found = 0;
    m->places[i] = 0;
    for (uint32_t k = 0; k < star->count; k++) {
        if (star->point[k] < i) continue;
        m->places[i] |= star->place[k] < 31 ? (uint32_t)1 << star->place[k] : ELSEWHERE;
        found++;
    }
    return found;
}

static void count_chunk(void *context, int worker, size_t begin, size_t end)
{
    mesh *m = context;
    (void)worker;
    size_t found = 0;
    star_rows rows = {0};
    voronoi_star star[STAR_LANES];
    for (size_t first = begin; first < end; first += STAR_LANES) {
        uint32_t point[STAR_LANES], count = 0;
        for (size_t i = first; i < end && count < STAR_LANES; i++) point[count++] = (uint32_t)i;
        star_lanes_at(&m->sites, point, count, &rows, star);
        for (uint32_t l = 0; l < count; l++) found += note_edges(m, point[l], &star[l]);
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
        if (m->places[i] & ELSEWHERE) {
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

/* Finds and counts the edges. */
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
    if (threads_stopped(pool)) return error_set(e, ERROR_CANCELLED, "stopped");
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

/* Lists the edges; the lists of neighbours are given up. */
static bool mesh_edges(mesh *m, threads *pool, error *e)
{
    m->edges = mem_array(m->count, sizeof *m->edges, "refinement", e);
    if (!m->edges) return false;
    threads_run(pool, m->points, CHUNK, list_chunk, m);
    neighbours_free(m->near);
    m->near = NULL;
    return true;
}

/* A connected part of the mesh. Where its edges are too many the shortest get no particle, where too few the
 * longest two each. Both are at the cores of dislocations, which they only move along: anywhere else a
 * particle too few or too many is a defect more. */
typedef struct mesh_part {
    size_t members, edges;
    bool longest;         /* its longest edges are picked, not its shortest */
    size_t picks, picked; /* how many edges are, and have been */
    uint32_t *pick;       /* a heap, the one to be given up first at its root */
} mesh_part;

/* Whether edge x is to be picked rather than y. */
static bool is_better(const edge *edges, bool longest, uint32_t x, uint32_t y)
{
    if (edges[x].length != edges[y].length) return longest == (edges[x].length > edges[y].length);
    return longest == (x > y);
}

/* Puts x where the place k of the heap is free, or below. */
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

/* Which part each point belongs to; the parts in the order of their first points. */
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

/* How many edges of each part are to be picked, so that every part keeps its share of the particles; by
 * their edges alone small parts would lose, since a closed one of n has 3 n - 6. */
static size_t share_out(mesh_part *parts, size_t count, double share)
{
    double seen = 0;
    size_t sum = 0;
    for (mesh_part *p = parts; p < parts + count; p++) {
        if (p->edges == 0) continue;
        double members = (double)p->members;
        double wanted = round((seen + members) * share) - round(seen * share) - members;
        double missing = fmax(wanted, 0) - (double)p->edges;
        seen += members;
        p->longest = missing > 0;
        p->picks = (size_t)fmin(fabs(missing), (double)p->edges);
        sum += p->picks;
    }
    return sum;
}

static uint32_t *count_free(const particles *p, error *e)
{
    uint32_t *count = mem_array(p->patches->count, sizeof *count, "refinement", e);
    for (size_t i = 0; count && i < p->count; i++) count[p->patch[i]] += !particles_is_fixed(p, i);
    return count;
}

/* The same of the parts that are patches. */
static bool share_out_patches(mesh_part *parts, const particles *p, const quota *next, size_t *picks,
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

/* Whether a place of a patch is as near to its curves as no particle is to be put. */
static bool crowds_curve(const refine_patches *patches, uint32_t patch, vec3 x, double spacing)
{
    return curve_distance_at(patches->curves, patch, x) < CURVE_CLEAR * spacing;
}

/* Leaves out the edges along rows. */
static void drop_row_edges(mesh *m, const particles *p, const refine_patches *patches)
{
    size_t kept = 0;
    for (size_t k = 0; k < m->count; k++) {
        const edge *e = &m->edges[k];
        double spacing = fmin(m->spacing[e->a], m->spacing[e->b]);
        vec3 middle = vec3_scale(vec3_add(p->position[e->a], p->position[e->b]), 0.5);
        if (!particles_is_fixed(p, e->a) || !particles_is_fixed(p, e->b) ||
            !crowds_curve(patches, p->patch[e->a], middle, spacing))
            m->edges[kept++] = *e;
    }
    m->count = kept;
}

/* Sets how many particles each edge is to have, for `count` of them in all, or as many as patches are to have. */
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
        sum = share_out(parts, number, (double)count / (double)m->points);
    else if (!share_out_patches(parts, p, patches->next, &sum, e))
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

/* New particles chunk by chunk of edges, each at a place of its own. */
typedef struct middles {
    const field *f;
    const refine_patches *patches;
    const mesh *m;
    particles *p;
    size_t *first; /* place for each chunk's particles, and the end */
    size_t *kept;  /* by chunk: how many there are */
} middles;

/* Middles that are looked for together. */
typedef struct middle_lanes {
    const edge *edge[VEC3_LANES];
    vec3_lanes from, x, normal; /* on the edge, and on the surface */
    double spacing[VEC3_LANES];
    double unit[VEC3_LANES]; /* of the limits of a projection */
    bool found[VEC3_LANES];
    uint32_t patch[VEC3_LANES], hint[VEC3_LANES];
    int count;
} middle_lanes;

static const projection_limits to_middle = {5, MIDDLE_ACCEPT, MIDDLE_SHORTCUT, MIDDLE_ACCEPT};

/* The place over that of an edge on its arc, which has the normals of its ends: t (1 - t) / 2 (b - a).(n_b - n_a) beyond it, at the
 * share t of its way. */
static vec3 place_on_arc(const particles *p, const edge *e, vec3 place)
{
    const vec3 turn = vec3_sub(p->normal[e->b], p->normal[e->a]),
               along = vec3_sub(p->position[e->b], p->position[e->a]);
    const double t = vec3_dot(vec3_sub(place, p->position[e->a]), along) / vec3_norm2(along);
    const vec3 up = vec3_axpy(t, turn, p->normal[e->a]);
    const double depth = t * (1 - t) / 2 * vec3_dot(along, turn), length = vec3_norm(up);
    return length > 0 ? vec3_axpy(depth / length, up, place) : place;
}

/* One middle by itself; *hint tells of a place nearby. Of a coarse level's edges some lie farther from the surface than F
 * reaches, as in the narrow band of a level set: from their arcs it is near. */
static bool find_middle(const middles *job, middle_lanes *m, int l, uint32_t *hint)
{
    const double h = m->unit[l];
    const edge *e = m->edge[l];
    const field *f = particles_field(job->p, job->f, e->a);
    const projection_limits limits = {to_middle.max_steps, to_middle.accept * h, to_middle.shortcut * h,
                                      to_middle.reject * h};
    vec3 x = vec3_lanes_get(&m->from, l), normal;
    if (!projection_find_near(f, &limits, hint, &x, &normal)) {
        x = place_on_arc(job->p, e, vec3_lanes_get(&m->from, l));
        if (!projection_find_near(f, &limits, hint, &x, &normal)) return false;
    }
    vec3_lanes_put(&m->x, l, x);
    vec3_lanes_put(&m->normal, l, normal);
    return true;
}

/* On patches they are looked for from where the edges' first ends are. A place that looks the other way is on another sheet: a
 * hint of long ago has led there. */
static void find_patch_middles(const middles *job, middle_lanes *m)
{
    const particles *p = job->p;
    projection_find_lanes(job->f, &to_middle, m->unit, m->patch, m->found, m->hint, &m->x, &m->normal);
    for (int l = 0; l < m->count; l++) {
        if (m->found[l] && !(vec3_dot(vec3_lanes_get(&m->normal, l), p->normal[m->edge[l]->a]) < 0)) continue;
        m->hint[l] = FIELD_NO_HINT;
        m->found[l] = find_middle(job, m, l, &m->hint[l]);
    }
}

static void find_middles(const middles *job, middle_lanes *m, uint32_t *last)
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
        find_patch_middles(job, m);
        return;
    }
    const bool in_lanes = !p->patch && !job->f->open && job->f->ops->sample_lanes;
    if (in_lanes) projection_find_lanes(job->f, &to_middle, m->unit, NULL, m->found, NULL, &m->x, &m->normal);
    for (int l = 0; l < m->count; l++) {
        if (in_lanes && m->found[l]) continue;
        if (m->hint[l] != FIELD_NO_HINT) *last = m->hint[l];
        m->found[l] = find_middle(job, m, l, last);
        m->hint[l] = *last;
    }
}

/* Puts a particle at a middle, unless that joins two sheets. */
static bool put_middle(const middles *job, middle_lanes *m, int l, size_t place)
{
    const double spacing = m->spacing[l];
    const vec3 x = vec3_lanes_get(&m->x, l);
    particles *p = job->p;
    if (!m->found[l] || vec3_norm2(vec3_sub(x, vec3_lanes_get(&m->from, l))) >=
                            MIDDLE_FARTHEST * MIDDLE_FARTHEST * spacing * spacing)
        return false;
    p->position[place] = x;
    p->normal[place] = vec3_lanes_get(&m->normal, l);
    if (!job->patches) return true;
    const uint32_t patch = m->patch[l];
    p->patch[place] = patch;
    p->place[place] = PARTICLES_FREE;
    const bool within = field_is_within_near(field_of_patch(job->f, patch), x, &m->hint[l]);
    p->hint[place] = m->hint[l];
    return within && !crowds_curve(job->patches, patch, x, spacing);
}

/* Returns how many were put, from `place` on. */
static size_t put_middles(const middles *job, middle_lanes *m, size_t place, uint32_t *last)
{
    size_t put = 0;
    if (m->count == 0) return 0;
    for (int l = m->count; l < VEC3_LANES; l++) m->spacing[l] = m->spacing[0];
    find_middles(job, m, last);
    for (int l = 0; l < m->count; l++) put += put_middle(job, m, l, place + put);
    m->count = 0;
    return put;
}

static void put_chunk(void *context, int worker, size_t begin, size_t end)
{
    const middles *job = context;
    const voronoi_sites *s = &job->m->sites;
    (void)worker;
    size_t place = job->first[begin / CHUNK];
    uint32_t last = FIELD_NO_HINT;
    middle_lanes m = {.count = 0};
    for (const edge *e = job->m->edges + begin; e < job->m->edges + end; e++)
        for (uint32_t k = 1; k <= e->copies; k++) {
            const vec3 along = vec3_sub(s->position[e->b], s->position[e->a]);
            vec3_lanes_put(&m.from, m.count, vec3_axpy(k / (e->copies + 1.0), along, s->position[e->a]));
            m.spacing[m.count] = fmin(s->spacing[e->a], s->spacing[e->b]);
            m.edge[m.count++] = e;
            if (m.count == VEC3_LANES) place += put_middles(job, &m, place, &last);
        }
    place += put_middles(job, &m, place, &last);
    job->kept[begin / CHUNK] = place - job->first[begin / CHUNK];
}

/* Adds the particles that the edges are to have, in their order, less those that failed. */
static bool add_middles(const field *f, const refine_patches *patches, const mesh *m, threads *pool,
                        particles *p, error *e)
{
    size_t chunks = chunks_of(m->count), *first = mem_array(2 * chunks + 1, sizeof *first, "refinement", e);
    if (!first) return false;
    middles job = {f, patches, m, p, first, first + chunks + 1};
    first[0] = p->count;
    for (size_t k = 0; k < m->count; k++) first[k / CHUNK + 1] += m->edges[k].copies;
    for (size_t k = 0; k < chunks; k++) first[k + 1] += first[k];
    threads_run(pool, m->count, CHUNK, put_chunk, &job);
    for (size_t k = 0; k < chunks; k++) { /* closes the gaps */
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
    return !threads_stopped(pool) || error_set(e, ERROR_CANCELLED, "stopped");
}

/* Particles that the edges did not give all the same, anywhere on the surface. */
static bool draw_rest(const field *f, const surface *scan, const sizing_field *sizing, particles *p,
                      size_t count, double spacing, uint64_t seed, error *e)
{
    rng r = rng_seed(seed, RANDOM_STREAM_REFINEMENT);
    const projection_limits limits = {20, MIDDLE_ACCEPT * spacing, MIDDLE_ACCEPT * spacing,
                                      MIDDLE_ACCEPT * spacing};
    for (int draws = 0; p->count < count; draws++) {
        vec3 x = sizing_field_draw(sizing, scan, rng_uniform(&r), &r, NULL), n;
        if (draws == MAX_DRAWS)
            return error_set(e, ERROR_NO_SURFACE,
                             "particle %zu of %zu does not reach the surface in %d draws", p->count + 1,
                             count, draws);
        if (!projection_find(f, &limits, &x, &n)) continue;
        p->position[p->count] = x;
        p->normal[p->count++] = n;
        draws = 0;
    }
    return true;
}

/* Draws a place of a patch, on it, and clear of its curves unless that is too much to ask. */
static bool draw_on_patch(const field *f, const surface *scan, const sizing_field *sizing,
                          const refine_patches *patches, uint32_t patch, double spacing, rng *r, vec3 *x,
                          vec3 *normal)
{
    const double *weight = sizing_field_weight(sizing, scan);
    const projection_limits limits = {20, MIDDLE_ACCEPT * spacing, MIDDLE_ACCEPT * spacing,
                                      MIDDLE_ACCEPT * spacing};
    for (int draw = 0; draw < MAX_DRAWS; draw++)
        if (surface_patch_point(scan, weight, patch, rng_uniform(r), r, x) &&
            projection_find(field_of_patch(f, patch), &limits, x, normal) &&
            field_is_within(field_of_patch(f, patch), *x) &&
            (draw >= CURVE_DRAWS || !crowds_curve(patches, patch, *x, spacing)))
            return true;
    return false;
}

static bool is_twin(const particles *p, size_t i, size_t k)
{
    const vec3 a = p->position[i], b = p->position[k];
    return p->patch[i] == p->patch[k] && a.x == b.x && a.y == b.y && a.z == b.z;
}

/* Of a place on a patch; `+ 0.0` makes -0 the same as 0. */
static uint64_t hash_of(vec3 x, uint32_t patch)
{
    const double at[3] = {x.x + 0.0, x.y + 0.0, x.z + 0.0};
    uint64_t bits[3], hash = patch;
    memcpy(bits, at, sizeof bits);
    for (int k = 0; k < 3; k++) {
        hash = (hash ^ bits[k]) * 0x9E3779B97F4A7C15u;
        hash ^= hash >> 29;
    }
    return hash;
}

/* Marks of free particles that have one place all but the first. Middles of several edges come to one where patches are smaller than
 * the spacing, on corners of their triangles; no force parts them. */
static bool mark_twins(const particles *p, bool *gone, error *e)
{
    size_t places = 1024;
    while (places < 2 * p->count) places *= 2;
    uint32_t *first =
        mem_array(places, sizeof *first, "refinement", e); /* one more than a particle's number, or 0 */
    for (uint32_t i = 0; first && i < p->count; i++) {
        if (particles_is_fixed(p, i)) continue;
        size_t k = hash_of(p->position[i], p->patch[i]) % places;
        while (first[k] && !is_twin(p, first[k] - 1, i)) k = (k + 1) % places;
        gone[i] = first[k];
        if (!first[k]) first[k] = i + 1;
    }
    const bool ok = first != NULL;
    free(first);
    return ok;
}

/* Takes away those that have no place of their own, and of each patch what is beyond its share. */
static bool trim(particles *p, const quota *next, error *e)
{
    bool *gone = mem_array(p->count, sizeof *gone, "refinement", e);
    uint32_t *count = mem_array(p->patches->count, sizeof *count, "refinement", e);
    bool ok = gone && count && mark_twins(p, gone, e);
    for (size_t i = 0; ok && i < p->count; i++)
        if (!gone[i] && !particles_is_fixed(p, i)) gone[i] = count[p->patch[i]]++ >= next->free[p->patch[i]];
    if (ok) population_remove(p, gone);
    free(gone);
    free(count);
    return ok;
}

/* Each patch its share, and the finer rows. */
static bool fill_patches(const field *f, const surface *scan, const sizing_field *sizing,
                         const refine_patches *patches, particles *p, double spacing, uint64_t seed, error *e)
{
    rng r = rng_seed(seed, RANDOM_STREAM_REFINEMENT);
    if (!trim(p, patches->next, e)) return false;
    uint32_t *count = count_free(p, e);
    bool ok = count != NULL;
    for (uint32_t k = 0; ok && k < p->patches->count; k++)
        for (; ok && count[k] < patches->next->free[k]; count[k]++) {
            size_t i = p->count;
            ok = draw_on_patch(f, scan, sizing, patches, k, spacing, &r, &p->position[i], &p->normal[i]) ||
                 error_set(e, ERROR_NO_SURFACE, "a particle does not reach its patch in %d draws", MAX_DRAWS);
            p->patch[i] = k;
            p->hint[i] = FIELD_NO_HINT;
            p->place[i] = PARTICLES_FREE;
            p->count += ok;
        }
    free(count);
    return ok && quota_replace_rows(patches->next, p, e);
}

bool refine_particles(const field *f, const surface *scan, const sizing_field *sizing,
                      const refine_patches *patches, refine_mesh *m, particles *p, size_t count,
                      double spacing, uint64_t seed, threads *pool, error *e)
{
    assert(count >= p->count || patches);
    assert(m->points == p->count);
    bool ok = mesh_edges(m, pool, e);
    if (ok && patches) drop_row_edges(m, p, patches);
    return ok && choose_edges(m, count, p, patches, pool, e) && add_middles(f, patches, m, pool, p, e) &&
           (patches ? fill_patches(f, scan, sizing, patches, p, spacing, seed, e)
                    : draw_rest(f, scan, sizing, p, count, spacing, seed, e));
}
