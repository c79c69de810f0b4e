#include "sampler/quality.h"

#include <stdlib.h>

#include "base/memory.h"
#include "sampler/energy.h"
#include "sampler/neighbours.h"
#include "sampler/voronoi.h"

/* A request whose spacings differ by less than this factor is even: the slope against it means nothing. */
static const double EVEN_REQUEST = 1.05;

typedef struct measure_job {
    const quality_input *in;
    voronoi_sites sites;
    double *area, *energy, *nearest; /* per point; nearest over requested spacing */
    double *edge_sum, *edge_squares; /* of relative lengths of the edges to points of higher index */
    uint8_t *degree;
    double *edges; /* number in the sums */
    bool *rim;
} measure_job;

static double alpha_of(const quality_input *in, size_t i)
{
    return in->alpha ? in->alpha[i] : 1;
}

/* What j adds to the energy of i, `distance` away: see quality.energy_excess. */
static double pair_energy(const quality_input *in, size_t i, size_t j, double distance)
{
    double size = in->sized ? 0.5 * (1 + in->spacing[j] / in->spacing[i]) : 1;
    double support = sqrt(3) * (in->sized ? in->spacing[i] : in->h);
    return 0.5 * (alpha_of(in, i) + alpha_of(in, j)) * size * size *
           energy_cotangent.value(fmax(distance / (size * support), 1e-6));
}

static void measure_point(const measure_job *job, uint32_t i)
{
    const quality_input *in = job->in;
    const uint32_t *list = neighbours_list(job->sites.near, i);
    double nearest = INFINITY;
    for (uint32_t k = 0; k < job->sites.near->list_count[i]; k++) {
        uint32_t j = list[k];
        double facing = vec3_dot(in->normal[i], in->normal[j]);
        if (facing <= VORONOI_OTHER_SIDE) continue;
        double length = vec3_norm(vec3_sub(in->position[i], in->position[j]));
        double relative = length / (0.5 * (in->spacing[i] + in->spacing[j]));
        job->energy[i] += pair_energy(in, i, j, length);
        nearest = fmin(nearest, relative);
        double edge;
        if (!voronoi_edge(&job->sites, i, j, &edge)) continue;
        job->area[i] += 0.25 * length * edge;
        if (job->degree[i] < UINT8_MAX) job->degree[i]++;
        if (i > j || job->rim[i] || job->rim[j]) continue;
        job->edge_sum[i] += relative;
        job->edge_squares[i] += relative * relative;
        job->edges[i]++;
    }
    job->nearest[i] = nearest;
}

static void measure_chunk(void *context, int worker, size_t begin, size_t end)
{
    (void)worker;
    for (size_t i = begin; i < end; i++) measure_point(context, (uint32_t)i);
}

static void find_rim(const quality_input *in, bool *rim)
{
    if (!in->open) return;
    for (size_t i = 0; i < in->count; i++)
        rim[i] = !bbox_contains(bbox_grow(in->domain, -2 * in->spacing[i]), in->position[i]);
}

/* Coefficient of variation from sums over n values. */
static double variation(double sum, double squares, double n)
{
    if (n < 1 || !(sum > 0)) return 0;
    double mean = sum / n;
    return sqrt(fmax(squares / n - mean * mean, 0)) / mean;
}

static void sum_up(const measure_job *job, const double *local, quality *out)
{
    const quality_input *in = job->in;
    double n = 0, hex = 0, degrees = 0, alpha = 0, energy = 0;
    double edge = 0, edge2 = 0, edges = 0, area = 0, area2 = 0, ratio = 0, ratio2 = 0;
    double sx = 0, sy = 0, sxx = 0, sxy = 0, finest = INFINITY, coarsest = 0, sized = 0;
    *out = (quality){.min_spacing_ratio = INFINITY, .grading_exponent = 1};
    for (size_t i = 0; i < in->count; i++) {
        degrees += 6.0 - job->degree[i];
        edge += job->edge_sum[i];
        edge2 += job->edge_squares[i];
        edges += job->edges[i];
        if (job->rim[i]) {
            out->rim_count++;
            continue;
        }
        double cell = job->area[i] / (in->spacing[i] * in->spacing[i]);
        double r = local[i] / in->spacing[i], x = log(in->spacing[i]), y = log(local[i]);
        n++;
        hex += job->degree[i] == 6;
        alpha += alpha_of(in, i);
        energy += job->energy[i];
        area += cell;
        area2 += cell * cell;
        ratio += r;
        ratio2 += r * r;
        finest = fmin(finest, in->spacing[i]);
        coarsest = fmax(coarsest, in->spacing[i]);
        out->min_spacing_ratio = fmin(out->min_spacing_ratio, job->nearest[i]);
        if (!(local[i] > 0)) continue;
        sized++;
        sx += x;
        sy += y;
        sxx += x * x;
        sxy += x * y;
    }
    out->euler = degrees / 6;
    if (n < 1) { /* nothing but rims: there is nothing to say */
        out->hex_fraction = out->edge_cv = out->area_cv = out->energy_excess = out->grading_cv =
            out->grading_exponent = NAN;
        return;
    }
    out->hex_fraction = hex / n;
    out->edge_cv = variation(edge, edge2, edges);
    out->area_cv = variation(area, area2, n);
    out->energy_excess = energy / alpha / energy_cotangent.ideal - 1;
    out->grading_cv = variation(ratio, ratio2, n);
    if (coarsest > EVEN_REQUEST * finest)
        out->grading_exponent = (sxy - sx * sy / sized) / (sxx - sx * sx / sized);
}

bool quality_measure(const quality_input *in, threads *pool, double *spacing_local, uint8_t *degree,
                     quality *out, error *e)
{
    bool ok = false;
    size_t n = in->count;
    const char *what = "the quality measures";
    measure_job job = {.in = in};
    double *column = mem_array(7 * n, sizeof *column, what, e), *local = column + 5 * n;
    uint8_t *bytes = mem_array(2 * n, 1, what, e);
    neighbours *near = neighbours_new(n, SIZE_MAX, e);
    if (!column || !bytes || !near) goto done;
    if (!neighbours_build(near, n, in->position, in->spacing, VORONOI_REACH, pool, e)) goto done;
    job.sites = (voronoi_sites){in->position, in->normal, in->spacing, near};
    job.area = column;
    job.energy = column + n;
    job.nearest = column + 2 * n;
    job.edge_sum = column + 3 * n;
    job.edge_squares = column + 4 * n;
    job.degree = bytes;
    job.edges = column + 6 * n;
    job.rim = (bool *)(bytes + n);
    find_rim(in, job.rim);
    threads_run(pool, n, 256, measure_chunk, &job);
    for (size_t i = 0; i < n; i++) {
        local[i] = sqrt(2 * job.area[i] / sqrt(3));
        if (spacing_local) spacing_local[i] = local[i];
        if (degree) degree[i] = job.degree[i];
    }
    sum_up(&job, local, out);
    ok = true;
done:
    free(column);
    free(bytes);
    neighbours_free(near);
    return ok;
}
