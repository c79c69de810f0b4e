// SPDX-License-Identifier: Apache-2.0
#include "job/source/plan.h"

#include <math.h>
#include <stdio.h>

#include "base/core/elementary.h"
#include "geometry/space/packing.h"

/* Bytes of the process without a job: code, libraries and the first memory of its heap. */
static const double PROCESS_BYTES = 10 << 20;
/* Bytes per particle in the solver: its state (57), its neighbour list (108) with bins (17), flags and steps of the relaxation
 * (18). The lists are released before the result is measured and written, which takes less: its columns (48), Voronoi cells
 * (24) and measures (40). The other constants are what is needed beyond these bytes. */
static const double BYTES_PER_PARTICLE = 200;
/* Bytes per point for neighbour lists of the measures, of at most LISTED_MOST points at a time
 * (sampling/voronoi/partitions). */
static const double BYTES_PER_LISTED = 100, LISTED_MOST = 2e5;
/* Bytes per particle on patches (triangles, interfaces of labels, formulas with sharp edges): five candidate places for
 * each particle (passes/fill_gaps.c), its patch and place, and normals of all copies. */
static const double BYTES_PER_PATCH_PARTICLE = 200;
/* Bytes per particle of blue noise: a second set of neighbour lists and the candidates; on patches also the triangles of
 * the surface, six per particle, and their tree. */
static const double BYTES_PER_NOISE_PARTICLE = 120, BYTES_PER_PATCH_NOISE_PARTICLE = 800;
/* The same for the method of Witkin and Heckbert, in which the largest radius determines the length of all
 * lists: measured 2.1 and 4.7 kB. */
static const double BYTES_PER_WITKIN_HECKBERT_PARTICLE = 5000;
/* Bytes per vertex of a mesh: two triangles, twice while they are collected. */
static const double BYTES_PER_VERTEX = 50;
/* Bytes per point of a points grid: OpenVDB's index, tree and attributes, and the file twice in memory. */
static const double BYTES_PER_GRID_POINT = 80;
/* Bytes per point of a frame with transferred points: candidate places for births and their lists, and the
 * previous points. */
static const double BYTES_PER_CARRIED = 800;
/* Memory of defect repair: bytes per particle for lists and Voronoi cells, and bytes of the regions that are
 * processed together. */
static const double BYTES_PER_REPAIRED = 160, REPAIR_BYTES = 5e6;
/* Maximum number of particles for defect repair (repair_defects.c: MAX_PASSES, PASSES_COUNT). */
static const double REPAIRED_MAX = 2.4e6;
/* Bytes per point if the order differs from that of the solver: a second copy of the columns. */
static const double BYTES_PER_ORDERED = 80;
/* Bytes per point for orientations and scales of instances. */
static const double BYTES_PER_INSTANCE = 56;
/* Bytes per pixel of the preview: two pictures, and the data of the pixels. */
static const double BYTES_PER_PIXEL = 15;

static const double MIB = 1 << 20; /* bytes */

double plan_picture_memory(const spec *s)
{
    return s->has_preview ? (double)s->preview_width * s->preview_height * BYTES_PER_PIXEL : 0;
}

bool plan_grades_by_levels(const spec *s)
{
    return s->has_alpha && s->init == SPEC_INIT_SIZED && s->method == SPEC_METHOD_PAPER && !s->has_control &&
           s->energy == SPEC_ENERGY_COTANGENT && s->minimiser == SPEC_MINIMISER_LM;
}

bool plan_repairs_defects(const spec *s)
{
    const bool has_patches =
        s->surface.kind == SPEC_SURFACE_LABELS || s->surface.mesh.has_features || s->features;
    const bool may = has_patches && !spec_is_graded(s) && !s->resolve;
    return (may || (s->has_curvature && !s->has_feature)) && !s->coherent && s->method == SPEC_METHOD_SIZED &&
           !((double)s->count > REPAIRED_MAX);
}

double plan_particle_memory(const spec *s, size_t limit, size_t source_bytes)
{
    return (double)limit - PROCESS_BYTES - (double)source_bytes - plan_picture_memory(s) -
           (plan_repairs_defects(s) ? REPAIR_BYTES : 0);
}

/* Bytes per particle, without neighbour lists of the measures. */
static double bytes_per_particle(const spec *s, plan_particles of)
{
    /* these are allocated one after the other: the maximum counts */
    double more =
        fmax(s->has_mesh ? BYTES_PER_VERTEX : 0, s->points_in[FILE_FORMAT_VDB] ? BYTES_PER_GRID_POINT : 0);
    if (of.is_continued) more = fmax(more, BYTES_PER_CARRIED);
    if (of.has_patches) more = fmax(more, BYTES_PER_PATCH_PARTICLE);
    if (s->pattern == SPEC_PATTERN_BLUE_NOISE)
        more = fmax(more, of.has_patches ? BYTES_PER_PATCH_NOISE_PARTICLE : BYTES_PER_NOISE_PARTICLE);
    if (s->init == SPEC_INIT_SIZED && s->method != SPEC_METHOD_SIZED && !plan_grades_by_levels(s))
        more = fmax(more, BYTES_PER_PARTICLE); /* two solves at the same time */
    if (plan_repairs_defects(s)) more = fmax(more, BYTES_PER_REPAIRED);
    if (s->has_orient || s->has_instancer) more += BYTES_PER_INSTANCE;
    if (s->has_order) more += BYTES_PER_ORDERED;
    return of.more_bytes + more +
           (s->method == SPEC_METHOD_WITKIN_HECKBERT ? BYTES_PER_WITKIN_HECKBERT_PARTICLE
                                                     : BYTES_PER_PARTICLE);
}

double plan_bytes(const spec *s, plan_particles of, double count)
{
    return count * bytes_per_particle(s, of) + fmin(count, LISTED_MOST) * BYTES_PER_LISTED;
}

double plan_fitting(const spec *s, plan_particles of, double bytes)
{
    const double each = bytes_per_particle(s, of), few = bytes / (each + BYTES_PER_LISTED);
    return fmax(few < LISTED_MOST ? few : (bytes - LISTED_MOST * BYTES_PER_LISTED) / each, 0);
}

/* Rounds to three digits, up or down. */
static double rounded(double value, bool up)
{
    const double unit = elementary_pow(10, floor(elementary_log10(value)) - 2);
    return (up ? ceil(value / unit) : floor(value / unit)) * unit;
}

bool plan_check_memory(const spec *s, plan_particles of, double count, const plan_memory *memory, error *e)
{
    const double particles = plan_bytes(s, of, count), needed = memory->limit + particles - memory->left;
    if (particles <= memory->left) return true;
    const bool too_much = memory->most > 0 && needed > memory->most;
    const double fitting = memory->left > 0 ? rounded(plan_fitting(s, of, memory->left), false) : 0;
    char fewer[128] = "", more[128];
    snprintf(more, sizeof more, too_much ? "a job may have at most %.0f" : "set it to at least %.0f",
             (too_much ? floor(memory->most / MIB) : ceil(needed / MIB)));
    if (s->resolve)
        snprintf(fewer, sizeof fewer, ", %s raise /sampling/min_spacing for fewer points",
                 too_much ? "so" : "or");
    else if (s->count > 0 && fitting >= PLAN_COUNT_MIN)
        snprintf(fewer, sizeof fewer, ", %s lower /sampling/count to at most %.0f", too_much ? "so" : "or",
                 fitting);
    else if (too_much)
        snprintf(fewer, sizeof fewer, ", so ask for fewer points");
    return error_set(
        e, ERROR_LIMIT_MEMORY,
        "limits.memory_mb: %.0f points require about %.0f MiB, and the surface and the preview leave "
        "%.0f of %.0f MiB: %s%s",
        count, ceil(particles / MIB), fmax(memory->left, 0) / MIB, memory->limit / MIB, more, fewer);
}

/* Sets the error that the target, which is not a count, gives too few or too many points; it names the value
 * for the minimum or maximum count. */
static bool refuse_count(const spec *s, double area, double count, error *e)
{
    const bool high = count > PLAN_COUNT_MAX, by_density = !(s->spacing > 0) && s->density > 0;
    const double bound = high ? PLAN_COUNT_MAX : PLAN_COUNT_MIN, spacing = packing_spacing(area, bound);
    const bool smallest = high != by_density; /* the bound is the smallest permitted value */
    return error_set(
        e, ERROR_SPEC_INVALID,
        "%s: %g gives %.0f points on the area of %g, and at %s %.0f are allowed: set it to at %s %.3g, in the "
        "units of the surface",
        s->spacing > 0 ? "/sampling/spacing"
        : by_density   ? "/sampling/density"
                       : "/sampling/control/max_sigma",
        s->spacing > 0 ? s->spacing
        : by_density   ? s->density
                       : s->control.max_sigma,
        count, area, high ? "most" : "least", bound, smallest ? "least" : "most",
        rounded(s->spacing > 0 ? spacing
                : by_density   ? bound / area
                               : packing_support(spacing),
                smallest));
}

double plan_spacing(const spec *s)
{
    return s->spacing > 0   ? s->spacing
           : s->density > 0 ? packing_spacing(1, s->density)
           : s->has_control ? s->control.max_sigma / packing_support(1)
           : s->resolve     ? s->min_spacing / s->feature.ratio
                            : 0;
}

bool plan_count(const spec *s, double area, double points, size_t *out, error *e)
{
    double count = (double)s->count;
    if (s->spacing > 0) count = round(packing_count(area, s->spacing));
    if (s->density > 0) count = round(s->density * area);
    if (s->resolve) count = round(points);
    /* the count for which max_sigma is the support of the packing; the method "paper" reaches it by itself */
    if (s->has_control)
        count =
            fmax((double)s->control.min_count, ceil(packing_count_of_support(area, s->control.max_sigma)));
    if (s->resolve && !(count <= PLAN_COUNT_MAX))
        return error_set(
            e, ERROR_SPEC_INVALID,
            "/sampling/resolve: %.0f points are required on the area of %g, and at most %.0f are allowed: "
            "raise /sampling/min_spacing, which leaves smaller details unresolved",
            count, area, PLAN_COUNT_MAX);
    if (s->resolve) count = fmax(count, PLAN_COUNT_MIN);
    if (count < PLAN_COUNT_MIN || count > PLAN_COUNT_MAX) return refuse_count(s, area, count, e);
    *out = (size_t)count;
    return true;
}
