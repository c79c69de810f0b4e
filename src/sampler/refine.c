#include "sampler/refine.h"

#include <stdlib.h>

#include "base/memory.h"
#include "base/rng.h"
#include "base/sets.h"
#include "sampler/project.h"
#include "sampler/voronoi.h"

/* A middle lies within a few hundredths of h of the surface; one that is farther joins two sheets. */
static const double MIDDLE_FARTHEST = 0.5;
static const double MIDDLE_ACCEPT = 1e-3;
/* Room for edges, per particle; there are three. */
static const size_t EDGES_MAX = 4;
/* Draws per particle that the edges did not give. */
static const int MAX_DRAWS = 1000;

size_t refine_coarser(size_t count)
{
    return (count + 6 + 3) / 4;
}

typedef struct edge {
    uint32_t a, b;
    uint32_t part; /* of the mesh: its first particle */
    double length; /* over the mean spacing of its ends */
} edge;

/* The Delaunay edges, in the order of their first and second end. */
static size_t find_edges(const voronoi_sites *sites, size_t count, edge *out, size_t capacity)
{
    size_t found = 0;
    for (uint32_t i = 0; i < count; i++) {
        const uint32_t *list = neighbours_list(sites->near, i);
        for (uint32_t k = 0; k < sites->near->list_count[i] && found < capacity; k++) {
            uint32_t j = list[k];
            double across;
            if (j < i || vec3_dot(sites->normal[i], sites->normal[j]) <= VORONOI_OTHER_SIDE ||
                !voronoi_edge(sites, i, j, &across))
                continue;
            double length = vec3_norm(vec3_sub(sites->position[i], sites->position[j]));
            out[found++] = (edge){i, j, 0, length / (0.5 * (sites->spacing[i] + sites->spacing[j]))};
        }
    }
    return found;
}

static int compare_edges(const void *x, const void *y)
{
    const edge *a = x, *b = y;
    if (a->part != b->part) return (a->part > b->part) - (a->part < b->part);
    if (a->length != b->length) return (a->length > b->length) - (a->length < b->length);
    return a->a != b->a ? (a->a > b->a) - (a->a < b->a) : (a->b > b->b) - (a->b < b->b);
}

/* Adds a particle on the surface beside the point at `share` of an edge, unless it joins two sheets. */
static void add_between(const field *f, const voronoi_sites *sites, const edge *e, double share, particles *p)
{
    double spacing = fmin(sites->spacing[e->a], sites->spacing[e->b]), accept = MIDDLE_ACCEPT * spacing;
    const project_limits limits = {5, accept, accept, accept};
    vec3 m = vec3_axpy(share, vec3_sub(sites->position[e->b], sites->position[e->a]), sites->position[e->a]);
    vec3 x = m, n;
    if (!project_point(f, &limits, &x, &n) ||
        vec3_norm2(vec3_sub(x, m)) >= MIDDLE_FARTHEST * MIDDLE_FARTHEST * spacing * spacing)
        return;
    p->position[p->count] = x;
    p->normal[p->count++] = n;
}

/* Sorts the edges by the connected parts of the mesh, and in each by length. members[k]: the particles of the
 * part whose first is k. */
static bool sort_edges(edge *edges, size_t found, size_t count, size_t *members, error *e)
{
    uint32_t *parent = mem_array(count, sizeof *parent, "refinement", e);
    if (!parent) return false;
    sets_reset(parent, count);
    for (size_t k = 0; k < found; k++) sets_join(parent, edges[k].a, edges[k].b);
    for (size_t k = 0; k < found; k++) edges[k].part = sets_root(parent, edges[k].a);
    for (uint32_t k = 0; k < count; k++) members[sets_root(parent, k)]++;
    free(parent);
    qsort(edges, found, sizeof *edges, compare_edges);
    return true;
}

/* The middles of one part's edges; where these are too many the shortest edges get none, where too few the
 * longest two each. Both are at the cores of dislocations, which they only move along: anywhere else a
 * particle too few or too many is a defect more. */
static void add_part(const field *f, const voronoi_sites *sites, const edge *edges, size_t found,
                     size_t wanted, particles *p)
{
    size_t count = p->count + wanted, left_out = found > wanted ? found - wanted : 0;
    size_t twice = found < wanted ? wanted - found : 0;
    for (size_t k = left_out; k < found && p->count < count; k++) {
        bool two = k + twice >= found && p->count + 1 < count;
        add_between(f, sites, &edges[k], two ? 1.0 / 3 : 0.5, p);
        if (two) add_between(f, sites, &edges[k], 2.0 / 3, p);
    }
}

/* Every part keeps its share of the particles; by their edges alone small parts would lose, since a closed
 * one of n has 3 n - 6. */
static bool add_middles(const field *f, const voronoi_sites *sites, edge *edges, size_t found, size_t count,
                        particles *p, error *e)
{
    size_t before = p->count, *members = mem_array(before, sizeof *members, "refinement", e), end = 0;
    bool ok = members && sort_edges(edges, found, before, members, e);
    double share = (double)count / (double)before, seen = 0;
    for (size_t k = 0; ok && k < found; k = end) {
        size_t part = members[edges[k].part];
        while (end < found && edges[end].part == edges[k].part) end++;
        double wanted = round((seen + (double)part) * share) - round(seen * share) - (double)part;
        seen += (double)part;
        add_part(f, sites, edges + k, end - k, (size_t)fmin(fmax(wanted, 0), (double)(count - p->count)), p);
    }
    free(members);
    return ok;
}

/* Particles that the edges did not give all the same, anywhere on the surface. */
static bool draw_rest(const field *f, const surface *scan, const grading *graded, particles *p, size_t count,
                      double spacing, uint64_t seed, error *e)
{
    rng r = rng_seed(seed, 3);
    const project_limits limits = {20, MIDDLE_ACCEPT * spacing, MIDDLE_ACCEPT * spacing,
                                   MIDDLE_ACCEPT * spacing};
    for (int draws = 0; p->count < count; draws++) {
        vec3 x = grading_draw(graded, scan, rng_uniform(&r), &r), n;
        if (draws == MAX_DRAWS)
            return error_set(e, ERROR_NO_SURFACE,
                             "particle %zu of %zu does not reach the surface in %d draws", p->count + 1,
                             count, draws);
        if (!project_point(f, &limits, &x, &n)) continue;
        p->position[p->count] = x;
        p->normal[p->count++] = n;
        draws = 0;
    }
    return true;
}

/* The particles as sites and their edges, in memory of their own. */
typedef struct mesh {
    double *spacing;
    neighbours *near;
    edge *edges;
    size_t count;
    voronoi_sites sites;
} mesh;

static void mesh_free(mesh *m)
{
    neighbours_free(m->near);
    free(m->edges);
    free(m->spacing);
}

static bool mesh_particles(const particles *p, double spacing, threads *pool, mesh *out, error *e)
{
    mesh m = {.spacing = mem_array(p->count, sizeof *m.spacing, "refinement", e),
              .near = neighbours_new(p->count, SIZE_MAX, e),
              .edges = mem_array(EDGES_MAX * p->count, sizeof *m.edges, "refinement", e)};
    *out = m;
    if (!m.spacing || !m.edges || !m.near) return false;
    for (size_t i = 0; i < p->count; i++) m.spacing[i] = spacing * p->size[i];
    if (!neighbours_build(m.near, p->count, p->position, m.spacing, VORONOI_REACH, pool, e)) return false;
    out->sites = (voronoi_sites){p->position, p->normal, m.spacing, m.near};
    out->count = find_edges(&out->sites, p->count, m.edges, EDGES_MAX * p->count);
    return true;
}

bool refine_count_edges(const particles *p, double spacing, threads *pool, size_t *edges, error *e)
{
    mesh m;
    bool ok = mesh_particles(p, spacing, pool, &m, e);
    if (ok) *edges = m.count;
    mesh_free(&m);
    return ok;
}

bool refine_particles(const field *f, const surface *scan, const grading *graded, particles *p, size_t count,
                      double spacing, uint64_t seed, threads *pool, error *e)
{
    mesh m;
    bool ok = mesh_particles(p, spacing, pool, &m, e);
    ok = ok && add_middles(f, &m.sites, m.edges, m.count, count, p, e) &&
         draw_rest(f, scan, graded, p, count, spacing, seed, e);
    mesh_free(&m);
    return ok;
}
