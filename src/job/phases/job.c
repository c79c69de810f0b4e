// SPDX-License-Identifier: Apache-2.0
#include "job/phases/job.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>

#include "base/core/clock.h"
#include "base/core/memory.h"
#include "base/core/sandbox.h"
#include "geometry/space/packing.h"
#include "surface/remesh/left_out.h"
#include "surface/remesh/surface_mesh.h"
#include "job/phases/label_meshes.h"
#include "job/phases/measured_surface.h"
#include "job/phases/upright.h"
#include "job/report/outcome.h"
#include "job/phases/watchdog.h"
#include "sampling/solver/curves/curve_chains.h"
#include "job/source/mesh_projection.h"
#include "job/source/plan.h"
#include "spec/spec_table.h"
#include "surface/scan/surface.h"

void job_free_solution(solution *s)
{
    solver_free(s->solver);
    sizing_field_free(s->sizing);
    scaled_curvature_free(s->curvature);
    free(s->spacing_local);
    free(s->degree);
    free(s->corner);
    free(s->farthest);
    free(s->on_meshes);
    free(s->kappa);
    point_order_free_known(&s->order_known);
    *s = (solution){0};
}

/* Replaces the code cancelled, which stopped loops report for any reason. */
bool job_may_continue(const job *j, error *e)
{
    int stop = j->options->cancel ? __atomic_load_n(j->options->cancel, __ATOMIC_RELAXED) : 0;
    if (stop == SIGALRM)
        return error_set(e, ERROR_LIMIT_TIME,
                         "the job exceeded limits.timeout_s = %g s: raise it, or ask for fewer points",
                         j->spec->timeout_s);
    return stop == 0 || error_set(e, ERROR_CANCELLED, "the job was cancelled");
}

double job_particle_memory(const job *j)
{
    return plan_particle_memory(j->spec, j->memory, source_memory(&j->source)) -
           given_points_bytes(&j->given);
}

/* Whether the points of the previous frame are transferred, or given points are kept. */
static bool carries_points(const job *j)
{
    return j->options->previous != NULL || (j->spec->has_points && j->spec->points.mode == SPEC_POINTS_KEEP);
}

plan_particles job_particles(const job *j)
{
    const field *f = j->source.field; /* NULL: not opened yet */
    return (plan_particles){carries_points(j), f && f->patches, attributes_bytes_per_point(&j->attributes)};
}

static bool fits_memory(const job *j, double count, error *e)
{
    return plan_check_memory(j->spec, job_particles(j), count,
                             &(plan_memory){job_particle_memory(j), (double)j->memory,
                                            (double)run_options_most_memory(j->options)},
                             e);
}

/* The instruction set that the spec requests. */
static bool choose_isa(const spec *s, isa *out, error *e)
{
#define NAMED(prefix, name, word) [SPEC_ISA_##name] = prefix##_##name,
    static const isa named[] = {ISA_LIST(NAMED, ISA)};
#undef NAMED
    *out = s->isa == SPEC_ISA_AUTO ? isa_best() : named[s->isa];
    return isa_available(*out) ||
           error_set(e, ERROR_NOT_SUPPORTED, "/solver/isa: this machine does not support %s: use \"auto\"",
                     isa_name(*out));
}

static int64_t peak_of(int who)
{
    struct rusage usage;
    getrusage(who, &usage);
    return (int64_t)usage.ru_maxrss * 1024;
}

/* A row of /proc/self/status, bytes. rusage is not used: its maximum includes that of the process which
 * started this one. */
static int64_t own_memory(const char *row)
{
    char line[128];
    size_t length = strlen(row);
    long long kilobytes = 0;
    FILE *file = fopen(SANDBOX_OWN_STATUS, "r");
    while (file && kilobytes == 0 && fgets(line, sizeof line, file))
        if (strncmp(line, row, length) == 0) kilobytes = strtoll(line + length, NULL, 10);
    if (file) fclose(file);
    return kilobytes > 0 ? kilobytes * 1024 : peak_of(RUSAGE_SELF);
}

static int64_t own_peak(void)
{
    return own_memory("VmHWM:");
}

/* Refuses one mesh file per label if there are too many labels, before anything is solved. */
static bool check_label_meshes(const job *j, error *e)
{
    const size_t count =
        j->spec->has_label_meshes ? label_surface_labels(j->source.whole.labels, 0, NULL) : 0;
    return count <= LABEL_MESHES_MOST ||
           error_set(e, ERROR_SPEC_INVALID,
                     "/output/label_meshes: the volume has %zu labels and at most %d meshes are written: "
                     "choose labels with surface.labels.labels, or unite some with groups",
                     count, LABEL_MESHES_MOST);
}

/* Bytes that attributes may take beside `count` particles. */
static size_t attribute_memory(const job *j, double count)
{
    return (size_t)fmax(job_particle_memory(j) - plan_bytes(j->spec, job_particles(j), count), 1);
}

static size_t memory_left(const job *j)
{
    return mem_left(j->memory, source_memory(&j->source));
}

bool job_make_pool(job *j, error *e)
{
    const spec *s = j->spec;
    j->memory = run_options_memory(j->options, s->memory_mb);
    int most = j->options->threads, workers = s->threads;
    if (workers <= 0) workers = most > 0 ? most : threads_available();
    if (most > 0 && workers > most) workers = most;
    if (workers > THREADS_MAX) workers = THREADS_MAX;
    return (j->pool = threads_new(workers, j->options->cancel, e)) != NULL;
}

bool job_load(job *j, error *e)
{
    const spec *s = j->spec;
    progress_enter(&j->progress, PROGRESS_LOAD);
    bool ok = job_make_pool(j, e) && fits_memory(j, (double)s->count, e) && choose_isa(s, &j->isa, e) &&
              (!s->coherent || sequence_begin(&j->sequence, j->options->frame, j->options->previous,
                                              threads_count(j->pool) > 1, e)) &&
              source_open(s, j->options->roots, j->options->arrays,
                          &(source_memory_limits){j->memory, run_options_most_memory(j->options)}, j->isa,
                          j->pool, &j->source, e) &&
              check_label_meshes(j, e) && given_points_read(s, &j->source, memory_left(j), &j->given, e) &&
              attributes_find(s, &j->source, attribute_memory(j, (double)s->count), &j->attributes, e);
    /* readers run one after another */
    if (!j->options->is_hosted) j->load_peak = own_peak() + peak_of(RUSAGE_CHILDREN);
    return ok;
}

report_timing job_timing(const job *j)
{
    return (report_timing){j->progress.start_ms, PROGRESS_PHASES, progress_phase_names, j->progress.phase_ms};
}

/* What the job accounts for: its surface and its points, as they are held against the memory limit. */
static int64_t accounted_memory(const job *j)
{
    const double count = (double)solver_result_points(j->solution.solver)->count;
    return (int64_t)((double)source_memory(&j->source) + given_points_bytes(&j->given) +
                     plan_bytes(j->spec, job_particles(j), count));
}

int64_t job_peak_memory(const job *j)
{
    if (j->options->is_hosted) return accounted_memory(j);
    int64_t own = own_peak();
    return own > j->load_peak ? own : j->load_peak;
}

int64_t job_held_memory(void)
{
    return own_memory("VmRSS:");
}

static sizing_field_kind sizing_field_kind_of(const spec *s)
{
    if (s->has_grid) return s->grid.kind == SPEC_MAP_DENSITY ? SIZING_FIELD_DENSITY : SIZING_FIELD_SPACING;
    if (!s->has_curvature) return SIZING_FIELD_EVEN;
    return s->curvature.chord_error > 0 ? SIZING_FIELD_CHORD : SIZING_FIELD_RATIO;
}

/* From this fraction of points on walls thinner than the spacing, the discs of a picture are smaller, so that
 * overlaps are visible. */
static const double THIN_PICTURE = 0.25;
/* Default distances over which curvature is averaged: for amplitudes, in mean spacings; for a sizing field,
 * in local spacings. Amplitudes that vary over shorter distances cannot be met by any packing: on meshes with
 * creases energy_excess is 0.08 with one spacing and 0.04 with two. */
static const double DEFAULT_EVEN_SCALE = 2, DEFAULT_OWN_SCALE = 4;

/* Minimum spacing that features may request, in voxels. Where walls meet at an acute angle they are less than
 * a voxel apart, and the spline determines how they separate. With 1 and a ratio of 1, 13 of 2 524 points of
 * the mesh fertility are unresolved; with a quarter, none of 3 107. A mesh with `resolve` uses 1: its cells
 * are as large as voxels would be, and its triangles are exact. */
static const double DEFAULT_FLOOR = 0.25;
/* Step along curves, in local spacings; the error of the spacing is a tenth of it. */
static const double CURVE_STEP = 0.05;

/* The curvature of places on meshes, for a sizing field. */
static bool curvature_at_points(const void *context, size_t count, const vec3 *position, const vec3 *normal,
                                const uint32_t *patch, threads *pool, double *kappa1, double *kappa2,
                                error *e)
{
    const point_curvature_input in = {count, position, normal, patch, NULL};
    point_curvature *found = mem_array(count, sizeof *found, "the grading", e);
    const bool ok = found && point_curvature_find(context, &in, pool, found, e);
    for (size_t i = 0; ok && i < count; i++) {
        kappa1[i] = found[i].is_defined ? found[i].kappa1 : NAN;
        kappa2[i] = found[i].is_defined ? found[i].kappa2 : NAN;
    }
    free(found);
    return ok;
}

/* Makes the sizing field of the job for `count` points. 0: for as many as the request needs. */
static bool make_sizing(const job *j, size_t count, sizing_field **out, error *e)
{
    const spec *s = j->spec;
    const double share = s->resolve && source_mesh(&j->source) ? 1 : DEFAULT_FLOOR,
                 floor = s->min_spacing > 0 ? s->min_spacing : share * j->source.field->cell_size;
    const sizing_field_params params = {
        .kind = sizing_field_kind_of(s),
        .chord_error = s->curvature.chord_error,
        .ratio = s->curvature.ratio,
        .exponent = s->curvature.exponent,
        .scale_spacings = s->curvature.has_scale ? s->curvature.scale.spacings : DEFAULT_OWN_SCALE,
        .scale_world = s->curvature.scale.world,
        .curvature = point_curvature_has_mesh(&j->source) ? curvature_at_points : NULL,
        .curvature_context = &j->source,
        .map = map_value,
        .map_context = j->source.map,
        .feature_ratio = s->has_feature ? s->feature.ratio : 0,
        .feature_floor = floor,
        .curves = j->curves,
        .curve_share = s->curve_spacing,
        .min_spacing = s->min_spacing,
        .max_spacing = s->max_spacing,
        .gradation = s->gradation,
        .memory_limit = (size_t)fmax(job_particle_memory(j), 1),
    };
    *out = sizing_field_new(j->source.field, j->scan, &params, count, j->pool, e);
    return *out != NULL;
}

/* Computes distances from curves, if the spacing is finer there. The count may be unknown. */
static bool find_curves(job *j, error *e)
{
    const field *f = j->source.field;
    if (!(j->spec->curve_spacing > 0) || !f->patches || f->patches->curve_count == 0) return true;
    double h = j->spec->count > 0 ? packing_spacing(j->scan->area, (double)j->spec->count) : f->cell_size;
    j->curves = curve_distance_new(f->patches, true,
                                   CURVE_STEP * j->spec->curve_spacing * fmin(h, f->cell_size), j->pool, e);
    return j->curves != NULL;
}

bool job_survey(job *j, error *e)
{
    progress_enter(&j->progress, PROGRESS_START);
    j->scan = surface_scan(j->source.field, j->pool, e);
    if (!j->scan) return source_prefix_origin(&j->source, e);
    if (!find_curves(j, e)) return false;
    double wanted = 0;
    if (j->spec->resolve) {
        if (!make_sizing(j, 0, &j->by_features, e)) return false;
        wanted = sizing_field_describe(j->by_features).points;
    }
    return plan_count(j->spec, j->scan->area, wanted, &j->count, e) &&
           fits_memory(j, fmax((double)j->count, (double)j->spec->control.start_count), e) &&
           given_points_place(&j->given, j->spec, &j->source,
                              packing_spacing(j->scan->area, (double)j->count), j->count, j->pool, e) &&
           avoided_points_plan(&j->given, j->spec, &j->source, j->scan, j->count, j->pool, &j->avoided,
                               &j->count, e) &&
           fits_memory(j, (double)j->count, e) &&
           (!j->spec->has_feature || j->by_features || make_sizing(j, j->count, &j->by_features, e));
}

/* Makes the sizing field for j->count points, unless the spacing is uniform. */
static bool start_sizing(const job *j, sizing_field **out, error *e)
{
    const spec *s = j->spec;
    if (!s->has_feature)
        return (!s->has_curvature && !s->has_grid && !j->curves) || make_sizing(j, j->count, out, e);
    *out = sizing_field_rescale(j->by_features, j->scan->cells, j->count, e);
    return *out != NULL;
}

/* Makes the curvature for sampling.alpha, unless it is the field's own at each point. */
static bool start_curvature(const job *j, scaled_curvature **out, error *e)
{
    const spec *s = j->spec;
    if (!s->has_alpha) return true;
    double even = s->has_control ? s->control.max_sigma / packing_support(1)
                                 : packing_spacing(j->scan->area, (double)j->count);
    double scale = !s->alpha.has_scale        ? DEFAULT_EVEN_SCALE * even
                   : s->alpha.scale.world > 0 ? s->alpha.scale.world
                                              : s->alpha.scale.spacings * even;
    if (!(scale > 0)) return true;
    cell_samples samples;
    if (cell_samples_take(j->scan, j->pool, &samples, e))
        *out = scaled_curvature_new(j->scan, &samples, scale, j->pool, e);
    cell_samples_free(&samples);
    return *out != NULL;
}

/* Solves a packing by levels, from which a solve with `params` may start: uniform, by its sizing field or by
 * its amplitudes. The radii of Witkin and Heckbert's method depend on amplitudes in another way: its packing
 * is uniform. */
static solver *pack_by_levels(const job *j, const solver_params *params, error *e)
{
    solver_params packed = *params;
    packed.start = SOLVER_START_SURFACE;
    packed.witkin_heckbert = NULL;
    packed.coarse_to_fine = true;
    packed.repair_defects = false;
    packed.energy = NULL;
    packed.graded = params->graded && !params->witkin_heckbert;
    packed.gradient = false;
    packed.sigma = packed.max_sigma = 0;
    solver *s = solver_new(j->source.field, j->scan, &packed, j->pool, e);
    bool ok = s != NULL;
    while (ok && !solver_ended(s)) ok = job_may_continue(j, e) && solver_step(s, e);
    if (ok && solver_finalize(s, e)) return s;
    solver_free(s);
    return NULL;
}

/* Merges the given points that are kept with a packing by levels; points of the packing near them are
 * removed. */
static bool place_around_kept(job *j, const solver_params *params, frame_transfer_params carry,
                              frame_transfer *out, error *e)
{
    solver *packed = pack_by_levels(j, params, e);
    if (!packed) return false;
    const solver_points *p = solver_result_points(packed);
    carry.is_still = true;
    carry.previous_count = p->count;
    carry.position = p->position;
    carry.normal = p->normal;
    carry.patch = p->patch;
    carry.fixed_count = j->given.count;
    carry.fixed = j->given.position;
    carry.fixed_normal = j->given.normal;
    carry.fixed_patch = j->given.patch;
    const bool ok = frame_transfer_points(j->source.field, j->scan, &carry, j->pool, out, e) &&
                    given_points_note(&j->given, out->fixed, out->count, e);
    solver_free(packed);
    return ok;
}

static void start_from(solver_params *params, const frame_transfer *brought)
{
    params->start = SOLVER_START_GIVEN;
    params->given = brought->position;
    params->given_normal = brought->normal;
    params->given_patch = brought->patch;
    params->given_place = brought->place;
}

/* Starts a solve with `params`, or from a packing by levels. */
static solver *start_solve(const job *j, solver_params params, error *e)
{
    solver *packed = NULL;
    if (j->spec->init == SPEC_INIT_SIZED && !params.coarse_to_fine) {
        packed = pack_by_levels(j, &params, e);
        if (!packed) return NULL;
        params.start = SOLVER_START_GIVEN;
        const solver_patch_points *stands = &solver_result_points(packed)->patch_points;
        params.given = stands->position;
        params.given_normal = stands->normal;
        params.given_patch = stands->patch;
        params.given_place = stands->place;
    }
    solver *s = solver_new(j->source.field, j->scan, &params, j->pool, e);
    solver_free(packed);
    return s;
}

bool job_place(job *j, solution *out, error *e)
{
    const spec *s = j->spec;
    if (!start_sizing(j, &out->sizing, e) || !start_curvature(j, &out->curvature, e)) return false;
    threads_narrow(j->pool, j->count < SOLVER_MIN_PARALLEL_COUNT);
    bool inserts = s->has_control && s->method == SPEC_METHOD_PAPER;
    int64_t start = s->control.start_count > 0 ? s->control.start_count : s->control.min_count;
    const spec_witkin_heckbert *w = &s->witkin_heckbert;
    const witkin_heckbert_params witkin_heckbert_state = {w->alpha, w->e_hat, w->rho, w->phi,   w->beta,
                                                          w->dt,    w->gamma, w->nu,  w->delta, w->sigma_max};
    const energy_function *energy = energy_find(spec_energy_name(s->energy));
    const frame_transfer_params carry = {
        .count = j->count,
        .sizing = out->sizing,
        .eased = energy == &energy_cotangent && !s->has_alpha && s->method != SPEC_METHOD_WITKIN_HECKBERT,
        .isa = j->isa,
        .seed = s->seed,
    };
    frame_transfer brought = {0};
    if (s->coherent && j->source.field->patches && !source_mesh(&j->source)) {
        error_set(e, ERROR_NOT_SUPPORTED,
                  "/queue/coherent: points cannot be carried from frame to frame on labels, or on "
                  "formulas and combinations with sharp edges: remove it");
        goto done;
    }
    if (j->options->previous &&
        !sequence_transfer(&j->sequence, j->source.field, j->scan, carry, j->pool, &brought, e))
        goto done;
    solver_params params = {
        .max_excess = sequence_max_excess(&j->sequence, j->count),
        .witkin_heckbert = s->method == SPEC_METHOD_WITKIN_HECKBERT ? &witkin_heckbert_state : NULL,
        .count = inserts ? (size_t)start : j->count,
        .max_sigma = inserts ? s->control.max_sigma : 0,
        .min_count = (size_t)s->control.min_count,
        .unbiased = s->control.selection == SPEC_SELECTION_RANDOM,
        /* 1 instead of 0, which means no limit */
        .count_limit = (size_t)fmax(plan_fitting(s, job_particles(j), job_particle_memory(j)), 1),
        .start = s->init == SPEC_INIT_RANDOM ? SOLVER_START_RANDOM : SOLVER_START_SURFACE,
        .random_in_cells = source_starts_in_cells(&j->source),
        .seed = s->seed,
        .graded = s->has_alpha,
        .d = s->alpha.d,
        .gamma = s->alpha.gamma,
        .nu = s->alpha.nu,
        .kappa_max = s->alpha.kappa_max,
        .curvature = out->curvature,
        .sizing = out->sizing,
        .sigma = s->sigma,
        .coarse_to_fine = (s->method == SPEC_METHOD_SIZED && s->pattern == SPEC_PATTERN_HEXAGONAL) ||
                          plan_grades_by_levels(s),
        .repair_defects = plan_repairs_defects(s),
        .energy = energy,
        .blue_noise = s->pattern == SPEC_PATTERN_BLUE_NOISE,
        .isa = j->isa,
        .gradient = s->minimiser == SPEC_MINIMISER_GRADIENT,
        .step = s->step,
        .list_limit = memory_left(j),
        .max_sweeps = s->max_sweeps,
        .step_tolerance = s->step_tolerance,
        .energy_tolerance = s->energy_tolerance,
    };
    if (s->has_points && s->points.mode == SPEC_POINTS_KEEP &&
        !place_around_kept(j, &params, carry, &brought, e))
        goto done;
    if (s->has_points && s->points.mode == SPEC_POINTS_REFINE) {
        params.start = SOLVER_START_COARSEST;
        params.given = j->given.projected;
        params.given_normal = j->given.normal;
        params.given_patch = j->given.patch;
        params.given_count = j->given.start_count;
    }
    if (brought.position) start_from(&params, &brought);
    out->solver = start_solve(j, params, e);
done:
    frame_transfer_free(&brought);
    return out->solver != NULL;
}

static void show_progress(job *j, const solver *s, const solver_sweep *last, size_t sweeps)
{
    size_t rounds;
    solver_rounds(s, &rounds);
    progress_update(&j->progress,
                    &(progress_numbers){solver_fraction(s), rounds, sweeps, last->count,
                                        solver_excess(s, last), last->rms_step, last->mean_log10_lambda});
}

bool job_relax(job *j, solver *s, error *e)
{
    while (!solver_ended(s)) {
        if (!job_may_continue(j, e) || !solver_step(s, e)) return false;
        size_t sweeps;
        const solver_sweep *last = solver_sweeps(s, &sweeps) + sweeps - 1;
        show_progress(j, s, last, sweeps);
        snapshot_offer(&j->snapshot, s, &j->source, j->spec);
    }
    return true;
}

bool job_finalize(job *j, solution *s, error *e)
{
    mesh_projection l;
    if (!solver_finalize(s->solver, e)) return false;
    if (!mesh_projection_find_distance(&j->source, &l)) return true;
    const solver_patch_points *stands = &solver_result_points(s->solver)->patch_points;
    vec3 *place = solver_result_positions(s->solver);
    if (mesh_projection_find(&j->source, &l) &&
        !mesh_projection_apply(&l, place, stands->spacing, stands->count, j->pool, &s->landed, e))
        return false;
    mesh_projection_repeat(&l, place, stands->count, OUTCOME_RESIDUAL * solver_spacing(s->solver), j->pool);
    given_points_restore(&j->given, stands->point, stands->count, false, place);
    return true;
}

/* If given points are avoided: chooses the points of the result. *again: there are too few or far too many,
 * and another solve, with j->count points, has been placed. */
static bool choose_points(job *j, bool *again, error *e)
{
    const solver_points *p = solver_result_points(j->solution.solver);
    size_t packed = 0;
    *again = false;
    if (!avoided_points_choose(&j->avoided, &j->given, j->spec, &j->source, p->position, p->count, &packed,
                               e))
        return false;
    if (packed == 0) return true;
    *again = true;
    j->count = packed;
    job_free_solution(&j->solution);
    return fits_memory(j, (double)packed, e) && job_place(j, &j->solution, e);
}

/* The closed mesh that the triangles between the points have to represent (`resolve`); otherwise NULL. */
static const mesh *mesh_to_resolve(const job *j)
{
    return j->spec->resolve ? source_closed_mesh(&j->source) : NULL;
}

static void drop_triangles(solution *s)
{
    free(s->corner);
    s->corner = NULL;
    s->triangles = 0;
}

/* For an optional step: true if it succeeded or lacked memory; otherwise false with its error. */
static bool may_lack_memory(bool ok, const error *why, error *e)
{
    if (ok || why->code == ERROR_LIMIT_MEMORY) return true;
    if (e) *e = *why;
    return false;
}

/* Makes the triangles between the points on a mesh. They remain NULL if memory does not suffice: most
 * measures need the points only. */
static bool make_triangles(const job *j, const mesh *on, solution *s, error *e)
{
    const solver_points *p = solver_result_points(s->solver);
    const solver_patch_points *stands = &p->patch_points;
    size_t side_count = 0;
    uint32_t(*side)[2] = curve_chains_steps(j->source.field->patches, p, &side_count);
    const surface_mesh_input in = {on,
                                   stands->count,
                                   stands->position,
                                   stands->spacing,
                                   stands->point,
                                   p->count,
                                   (const uint32_t(*)[2])side,
                                   side_count,
                                   NULL};
    error why = {0};
    drop_triangles(s);
    const bool ok = surface_mesh_make(&in, &s->corner, &s->triangles, &why);
    free(side);
    if (!ok) drop_triangles(s);
    return may_lack_memory(ok, &why, e);
}

/* Maximum deviation of the triangles from the mesh, in spacings. The documented limit is a third of the
 * feature size. */
static const double MOST_DEVIATION = 0.3;
/* Maximum rounds of pinning. Maximum pinned points: one in PINNED_OF of all, or PINNED_FEW if that is more.
 * One of five pinned points causes a narrow triangle. */
enum { PIN_ROUNDS = 4, PINNED_OF = 400, PINNED_FEW = 50 };

/* Number of points to pin next, of those still permitted: the worst half, because pinning one may resolve its
 * neighbours. */
static size_t pinned_next(size_t left)
{
    const size_t half = (left + 1) / 2, most = half > PINNED_FEW ? half : PINNED_FEW;
    return most < left ? most : left;
}

/* On a closed mesh that has to be resolved: if the triangles between the final points deviate too much from
 * the mesh, pins points at the deviations and relaxes all others again. */
static bool pin_unrepresented(job *j, solution *s, error *e)
{
    const mesh *on = mesh_to_resolve(j);
    const size_t share = solver_result_points(s->solver)->count / PINNED_OF;
    size_t left = share > PINNED_FEW ? share : PINNED_FEW;
    for (int k = 0; on && k < PIN_ROUNDS && left > 0; k++) {
        const solver_points *p = solver_result_points(s->solver);
        vec3 *place = NULL;
        size_t count = 0;
        bool goes_on = false;
        if (!make_triangles(j, on, s, e)) return false;
        if (s->triangles == 0) return true;
        const left_out_input in = {
            on,          p->count, p->position, p->patch_points.spacing, (const uint32_t(*)[3])s->corner,
            s->triangles};
        error why = {0};
        const bool found =
            left_out_find(&in, MOST_DEVIATION, pinned_next(left), j->pool, &place, &count, &why);
        const bool ok = may_lack_memory(found, &why, e) && solver_pin(s->solver, place, count, &goes_on, e);
        free(place);
        if (!ok || !goes_on) return ok;
        left -= count;
        drop_triangles(s);
        if (!job_relax(j, s->solver, e) || !job_finalize(j, s, e)) return false;
    }
    return true;
}

bool job_solve(job *j, error *e)
{
    for (bool again = true; again;)
        if (!job_relax(j, j->solution.solver, e) || !job_finalize(j, &j->solution, e) ||
            !pin_unrepresented(j, &j->solution, e) || !choose_points(j, &again, e))
            return false;
    return true;
}

static double requested_at(const void *context, vec3 x)
{
    return sizing_field_spacing(context, x, NULL);
}

/* `stands`: the points on their patches, with the walls of given points. */
static measures_input measures_input_of(const job *j, const solution *s, const solver_patch_points *stands,
                                        const measured_surface *on)
{
    const solver_points *p = solver_result_points(s->solver);
    return (measures_input){.surface = on->facets,
                            .lost_place = on->lost_place,
                            .lost_places = on->lost_places,
                            .count = p->count,
                            .position = p->position,
                            .spacing = p->spacing,
                            .h = solver_spacing(s->solver),
                            .spacing_at = s->sizing ? requested_at : NULL,
                            .spacing_context = s->sizing,
                            .sized = s->sizing != NULL,
                            .achieved = j->spec->has_alpha,
                            .kept = j->given.kept,
                            .exact = j->options->exact_measures,
                            .copy_count = stands->count,
                            .copy_normal = on->own_normals ? NULL : stands->normal,
                            .copy_point = stands->point,
                            .copy_patch = stands->patch,
                            .copy_flags = stands->flags,
                            .patch_labels = (const uint32_t(*)[2])on->patch_labels,
                            .piece_euler = on->euler};
}

bool job_measure(job *j, solution *s, error *e)
{
    const solver_points *p = solver_result_points(s->solver);
    solver_patch_points stands = p->patch_points;
    measured_surface on = {0};
    given_walls walls;
    bool ok = given_points_walls(&j->given, &j->source, p->count, &stands, &walls, e) &&
              measured_surface_open(&j->source, j->scan, &on, e) &&
              measured_surface_find_euler(&on, j->pool, e);
    if (ok) {
        s->spacing_local = mem_array(p->count, sizeof *s->spacing_local, "the result", e);
        s->farthest = mem_array(on.facets.patch_count, sizeof *s->farthest, "the result", e);
        if (j->spec->has_preview && j->spec->preview_color == SPEC_COLOR_DEGREE)
            s->degree = mem_array(p->count, sizeof *s->degree, "the result", e);
        ok = s->spacing_local && s->farthest && point_order_prepare(j->spec, p->count, &s->order_known, e) &&
             (s->degree || !j->spec->has_preview || j->spec->preview_color != SPEC_COLOR_DEGREE);
    }
    measures_input in = measures_input_of(j, s, &stands, &on);
    in.out_piece = s->order_known.piece;
    in.out_spacing = s->order_known.spacing;
    ok = ok && measures_take(&in, j->pool, s->spacing_local, s->degree, s->farthest, &s->measures, e);
    measured_surface_close(&on);
    given_walls_free(&walls);
    return ok;
}

bool job_weigh(job *j, const solution *s, error *e)
{
    const solver_points *p = solver_result_points(s->solver);
    solver_patch_points stands = p->patch_points;
    measured_surface on = {0};
    given_walls walls;
    if (!spec_has_weight(j->spec)) return true;
    bool ok = given_points_walls(&j->given, &j->source, p->count, &stands, &walls, e) &&
              measured_surface_open(&j->source, j->scan, &on, e);
    const measures_input cells = measures_input_of(j, s, &stands, &on);
    const weights_input in = {j->spec, &j->source, p, &s->measures, j->scan->area, &cells};
    ok = ok && weights_find(&in, j->pool, &j->weights, e);
    measured_surface_close(&on);
    given_walls_free(&walls);
    return ok;
}

/* Positions and normals in world space, in one array that the caller frees. */
static bool turn_points(const source *from, const given_points *given, points *set, vec3 **out, error *e)
{
    vec3 *place = mem_array(set->count, 2 * sizeof *place, "the result", e), *normal = place + set->count;
    if (!place) return false;
    for (size_t i = 0; i < set->count; i++) {
        place[i] = placement_to_world(from->turned, set->position[i]);
        normal[i] = placement_turn_normal(from->turned, set->normal[i]);
    }
    given_points_restore(given, NULL, set->count, true, place);
    set->position = place;
    set->normal = normal;
    *out = place;
    return true;
}

bool job_find_curvature(job *j, solution *s, error *e)
{
    const solver_points *p = solver_result_points(s->solver);
    const size_t n = p->count;
    if (!attributes_have_curvature(j->spec) || !point_curvature_is_special(&j->source)) return true;
    const point_curvature_input in = {n, p->position, p->normal, p->patch, p->hint};
    free(s->on_meshes);
    free(s->kappa);
    s->on_meshes = mem_array(n, sizeof *s->on_meshes, "the result", e);
    s->kappa = mem_array(3 * n, sizeof *s->kappa, "the result", e);
    if (!s->on_meshes || !s->kappa || !point_curvature_find(&j->source, &in, j->pool, s->on_meshes, e))
        return false;
    double *kappa = s->kappa, *kappa1 = kappa + n, *kappa2 = kappa1 + n;
    for (size_t i = 0; i < n; i++) {
        const point_curvature *c = &s->on_meshes[i];
        kappa1[i] = c->is_special ? c->kappa1 : p->kappa1[i];
        kappa2[i] = c->is_special ? c->kappa2 : p->kappa2[i];
        kappa[i] = sqrt(kappa1[i] * kappa1[i] + kappa2[i] * kappa2[i]);
    }
    return true;
}

/* Sets the curvature of the points: that of job_find_curvature, or that of a surface without meshes. */
static void set_curvature(const job *j, const solver_points *p, points *set)
{
    const double *found = j->solution.kappa;
    if (found) {
        set->kappa = found;
        set->kappa1 = found + p->count;
        set->kappa2 = found + 2 * p->count;
    } else if (!point_curvature_is_special(&j->source)) {
        set->kappa = p->kappa;
        set->kappa1 = p->kappa1;
        set->kappa2 = p->kappa2;
    }
}

/* Marks the points that were given, in the order of the results. NULL: none. */
static bool find_kept(const job *j, const point_order *order, size_t count, bool **out, error *e)
{
    if (!j->given.kept) return true;
    *out = mem_array(count, sizeof **out, "the result", e);
    for (size_t i = 0; *out && i < count; i++) (*out)[order->place[i]] = j->given.kept[i];
    return *out != NULL;
}

bool job_write_points(job *j, error *e)
{
    const solution *s = &j->solution;
    const solver_points *p = solver_result_points(s->solver);
    points set = {.count = p->count,
                  .position = p->position,
                  .normal = p->normal,
                  .kappa_scale = p->kappa_scale,
                  .alpha = p->alpha,
                  .energy = p->energy,
                  .spacing = p->spacing,
                  .is_graded = spec_is_graded(j->spec) || j->spec->has_alpha,
                  .spacing_local = s->spacing_local,
                  .degree = s->degree,
                  .id = j->sequence.id,
                  .velocity = j->sequence.velocity};
    results_input in = {.spec = j->spec,
                        .field = source_world(&j->source),
                        .set = &set,
                        .sampled = j->source.field,
                        .solved = p,
                        .labels = j->source.whole.labels,
                        .triangles = source_mesh(&j->source),
                        .corner = (const uint32_t(*)[3])s->corner,
                        .corners = s->triangles,
                        .h = solver_spacing(s->solver),
                        .frame = j->options->frame};
    const delivery *to = &j->options->delivery;
    mesh_projection l;
    vec3 *turned = NULL;
    point_order order = {0};
    bool *kept = NULL;
    const label_surface *labels = j->source.whole.labels;
    if (labels && j->source.field != label_surface_field(labels)) labels = NULL;
    if (mesh_projection_find_distance(&j->source, &l)) in.field = &l.base;
    if (j->source.turned && !turn_points(&j->source, &j->given, &set, &turned, e)) return false;
    in.y_up = upright_y(j->spec, &set);
    in.thin = (double)s->measures.thin_count > THIN_PICTURE * (double)p->count;
    in.sweeps = solver_sweeps(s->solver, &in.sweep_count);
    j->attributes.kept = j->given.kept;
    j->attributes.weight = j->weights.value;
    json_free(j->report);
    j->report = json_new_object();
    const size_t left = attribute_memory(j, (double)p->count);
    set_curvature(j, p, &set);
    j->attributes.curvature = s->on_meshes;
    bool ok = attributes_read(&j->attributes, &j->source, p, left, &set, e) &&
              point_order_find(j->spec, &set, p, &s->order_known, labels, &j->given, &j->avoided, j->pool,
                               &order, e) &&
              point_order_apply(&order, &set, &j->attributes, e) && job_may_continue(j, e);
    in.place = order.place;
    char *comments = surface_meshes_comments(&j->attributes.meshes);
    in.comments = comments;
    ok = ok && find_kept(j, &order, set.count, &kept, e);
    in.kept = kept;
    ok = ok && to->points(to->context, &in, j->pool, json_put_array(j->report, "outputs"), &j->results, e);
    free(comments);
    j->attributes.curvature = NULL;
    point_order_free(&order);
    free(turned);
    free(kept);
    return ok;
}

/* Ends the process while the job is still running; the kernel frees its memory. */
static void leave_job(void *context)
{
    const job *j = context;
    error e = {0};
    job_may_continue(j, &e);
    j->options->delivery.clear(j->options->delivery.context);
    snapshot_end(&j->snapshot);
    j->options->leave(&e);
}

bool job_run_phases(job *j, job_phase *const *phases, size_t count, error *e)
{
    const watchdog_params params = {&j->progress, j->options->cancel, j->options->leave ? leave_job : NULL,
                                    j};
    watchdog *w = watchdog_start(&params, e);
    bool ok = w != NULL;
    for (size_t k = 0; ok && k < count; k++) {
        ok = phases[k](j, e);
        if (!job_may_continue(j, e)) ok = false;
    }
    watchdog_end(w);
    return ok;
}

void job_free(job *j)
{
    snapshot_free(&j->snapshot);
    json_free(j->report);
    job_free_solution(&j->solution);
    sequence_free(&j->sequence);
    sizing_field_free(j->by_features);
    curve_distance_free(j->curves);
    surface_free(j->scan);
    attributes_free(&j->attributes);
    weights_free(&j->weights);
    given_points_free(&j->given);
    avoided_points_free(&j->avoided);
    source_close(&j->source);
    threads_free(j->pool);
}
