// SPDX-License-Identifier: Apache-2.0
#include "job/report/report.h"

#include <math.h>
#include <stdlib.h>

#include "base/core/build_part.h"
#include "base/core/clock.h"
#include "base/core/file_format.h"
#include "base/core/memory.h"
#include "geometry/space/packing.h"
#include "job/report/advice.h"
#include "job/report/label_advice.h"
#include "job/report/patch_report.h"
#include "job/report/ratings.h"
#include "job/source/source_report.h"

/* A ratio of spacings of at least this fraction of the requested ratio is not reported. */
static const double RATIO_REACHED = 0.8;

static void put_vec3(json *object, const char *key, vec3 v)
{
    json *array = json_put_array(object, key);
    json_append_number(array, v.x);
    json_append_number(array, v.y);
    json_append_number(array, v.z);
}

static void put_mesh(json *report, json *warnings, const report_facts *facts)
{
    if (!facts->outputs->has_mesh) return;
    const triangulation_facts *m = &facts->outputs->mesh;
    json *object = json_put_object(report, "mesh");
    json_put_integer(object, "triangles", (int64_t)m->triangles);
    json_put_integer(object, "closing_triangles", (int64_t)m->hole_triangles);
    json_put_integer(object, "euler", m->euler);
    json_put_integer(object, "boundary_edges", (int64_t)m->boundary_edges);
    json_put_integer(object, "rim_edges", (int64_t)m->rim_edges);
    json_put_integer(object, "nonmanifold_edges", (int64_t)m->nonmanifold_edges);
    json_put_integer(object, "seam_edges", (int64_t)m->seam_edges);
    json_put_integer(object, "nonmanifold_vertices", (int64_t)m->nonmanifold_vertices);
    json_put_bool(object, "closed", triangulation_is_closed(m));
    json_put_number(object, "radius_ratio", m->radius_ratio);
    if (facts->outputs->label_meshes) json_put(object, "labels", facts->outputs->label_meshes);
    if (!triangulation_is_manifold(m))
        json_append_string(
            warnings, "mesh.ply has holes or non-manifold edges, because the spacing does not resolve the "
                      "surface (see mesh in the report); ask for more points");
}

void report_put_box(json *object, bbox box)
{
    json *o = json_put_object(object, "bounding_box");
    put_vec3(o, "min", box.min);
    put_vec3(o, "max", box.max);
}

/* Up to this number of points, their neighbourhoods do not show whether there are walls thinner than the
 * spacing. */
static const size_t FEW_POINTS = 100;
/* Minimum ratio of the advised count to the present one: smaller increases are not worth advice. */
static const double WORTH_ADVICE = 1.1;

/* Walls thinner than the spacing. */
typedef struct thin_walls {
    double share, factor; /* fraction of the points, or of the surface if of_surface; see clearance.factor */
    bool of_surface;
} thin_walls;

bool report_needs_walls(const measures *m, size_t count, outcome_kind outcome)
{
    const double share = (double)m->thin_count / (double)count;
    return outcome != OUTCOME_UNRESOLVED && (share > MEASURES_THIN_SHARE || count <= FEW_POINTS);
}

/* Finds the walls thinner than the spacing. Those of an unresolved result are thinner than the smallest distance that
 * rays measure: the points alone show them. */
static bool find_thin_walls(const report_facts *facts, thin_walls *out)
{
    const measures *m = facts->measures;
    const double count = (double)solver_result_points(facts->solver)->count;
    const clearance *walls = facts->walls;
    *out = walls ? (thin_walls){walls->unresolved_share,
                                advice_factor(walls, source_thinnest_wall(facts->source, facts->spec)), true}
                 : (thin_walls){(double)m->thin_count / count, m->thin_factor, false};
    return out->share > MEASURES_THIN_SHARE;
}

/* Adds their fraction, and the number of points that separates them. */
static void put_thin_walls(json *advice, json *warnings, const report_facts *facts, const thin_walls *walls)
{
    const size_t count = solver_result_points(facts->solver)->count;
    const double area = facts->scan->area;
    const advice_resolution to =
        advice_resolve(area, count, walls->factor, source_thinnest_wall(facts->source, facts->spec));
    if (facts->result->outcome != OUTCOME_CONVERGED &&
        (to.reached || to.count > WORTH_ADVICE * (double)count))
        advice_append_resolution(advice, facts->spec, area, to,
                                 &(advice_memory){(facts->memory_limit - facts->particle_memory +
                                                   plan_bytes(facts->spec, facts->particles, to.count)) /
                                                      (1 << 20),
                                                  facts->memory_limit / (1 << 20),
                                                  facts->most_memory / (1 << 20)});
    advice_put_walls(advice, warnings, facts->spec, walls->share, walls->of_surface, to);
}

/* Advice on the labels comes first: ragged or thin labels are the cause, and more points the costly remedy. A
 * majority filter comes before groups, which merge labels. More points do not make the packing regular on
 * single voxels. */
static void put_advice(json *report, json *warnings, const report_facts *facts)
{
    json *advice = json_put_array(report, "advice");
    const label_surface *labels = facts->source->whole.labels;
    const bool hopeless = labels && label_advice_is_hopeless(labels);
    thin_walls walls = {0};
    const bool thin = find_thin_walls(facts, &walls);
    if (labels && thin && !hopeless)
        label_advice_append_majority(advice, &facts->spec->surface.labels, labels,
                                     solver_spacing(facts->solver));
    if (labels && (outcome_is_of_thin_parts(facts->result) || (hopeless && facts->result->reason_count > 0)))
        label_advice_append(advice, &facts->spec->surface.labels, labels);
    if (facts->result->outcome != OUTCOME_CONVERGED && facts->source->whole.volume &&
        volume_describe(facts->source->whole.volume)->two_values)
        advice_append(advice, "mask",
                      "the volume has two values, as a mask: its surface at an isovalue has the steps of the "
                      "voxels. Give the file as /surface/labels in place of /surface/volume, which makes "
                      "interfaces of labels.");
    if (thin && !hopeless) put_thin_walls(advice, warnings, facts, &walls);
}

/* Whether there are outputs with floats relative to an origin. */
static bool has_scenes(const spec *s)
{
    bool has = false;
    for (int k = 0; k < FILE_FORMATS; k++)
        has |= file_formats[k].has_floats && (s->points_in[k] || s->mesh_in[k]);
    return has;
}

/* Maximum number of sweeps in a report. All are in convergence.csv; more rows would be most of a report. */
static const size_t MOST_SWEEPS = 100;

void report_warn_of_build(json *warnings, const spec *s)
{
    if (!s->preview_left_out) return;
    char *text =
        mem_printf("preview.png and preview.exr are not written: %s. Set /output/preview to false to omit "
                   "this warning.",
                   build_part_missing(BUILD_PART_PREVIEW));
    json_append_string(warnings, text);
    free(text);
}

static void append_texts(json *warnings, const json *texts)
{
    const json_at list = json_root(texts);
    for (json_at text = json_first(&list); text.node; text = json_next(&text))
        json_append_string(warnings, json_string(text, ""));
}

static void put_surface(json *report, const report_facts *facts)
{
    json *object = json_put_object(report, "surface");
    json_put_number(object, "area", facts->scan->area);
    report_put_box(object, source_box(facts->source, facts->scan));
    json *warnings = json_put_array(object, "warnings");
    source_describe(facts->source, report, object, warnings);
    if (facts->attributes) json_put(report, "attributes", facts->attributes);
    append_texts(warnings, facts->attribute_warnings);
    if (facts->outputs->widened)
        json_append_string(warnings,
                           "points.ply is written in double precision: single precision would move points by "
                           "more than 1e-3 spacings");
    if (facts->outputs->rounding > OUTCOME_RESIDUAL && has_scenes(facts->spec)) {
        char *text =
            mem_printf("points.glb and points.usda: single precision moves points by up to %.2g spacings. "
                       "Use points.ply, points.npz or points.vdb.",
                       facts->outputs->rounding);
        json_append_string(warnings, text);
        free(text);
    }
    report_warn_of_build(warnings, facts->spec);
    put_advice(report, warnings, facts);
    put_mesh(report, warnings, facts);
}

static void put_quality(json *report, const report_facts *facts)
{
    const measures *m = facts->measures;
    json *object = json_put_object(report, "quality");
    json_put_number(object, "hex_fraction", m->hex_fraction);
    json_put_number(object, "edge_cv", m->edge_cv);
    json_put_number(object, "edge_skipped_share", m->edge_skipped_share);
    json_put_number(object, "area_cv", m->area_cv);
    json_put_number(object, "energy_excess", m->energy_excess);
    json_put_number(object, "disorder", m->disorder);
    json_put_number(object, "defect_share", m->defect_share);
    json_put_string(object, "defect_share_reason", isnan(m->defect_share) ? "between_samples" : NULL);
    json_put_number(object, "min_spacing_ratio", m->min_spacing_ratio);
    json_put_number(object, "close_share", m->close_share);
    json_put_integer(object, "coincident", (int64_t)m->coincident);
    json_put_integer(object, "thin_count", (int64_t)m->thin_count);
    json_put_number(object, "coverage", m->coverage);
    json_put_number(object, "missing_share", m->missing_share);
    json *parts = json_put_object(object, "parts_without_points");
    json_put_integer(parts, "count", (int64_t)m->parts_without_points);
    json_put_number(parts, "area_share", m->empty_area_share);
    json_put_number(object, "unmeasured_share", m->unmeasured_share);
    json_put_number(object, "max_residual", facts->outputs->max_residual);
    json_put_number(object, "rms_residual", facts->outputs->rms_residual);
    json_put_number(object, "largest_move", facts->landed / solver_spacing(facts->solver));
    json_put_integer(object, "lost", (int64_t)solver_result_points(facts->solver)->lost);
    json_put_integer(object, "removed_offsurface", (int64_t)solver_removed_offsurface(facts->solver));
    json_put_number(object, "euler", m->euler);
    json *graded = json_put_object(object, "grading");
    json_put_number(graded, "cv", m->grading_cv);
    json_put_number(graded, "exponent", m->grading_exponent);
}

static void put_rounds(json *report, const solver *s)
{
    size_t count;
    const solver_round *round = solver_rounds(s, &count);
    json *array = json_put_array(report, "rounds");
    for (size_t k = 0; k < count; k++) {
        json *object = json_append_object(array);
        json_put_string(object, "regime", round[k].regime);
        json_put_string(object, "began", round[k].cause);
        json_put_string(object, "ended", round[k].ended);
        json_put_number(object, "defect_fraction", round[k].defect_fraction);
        json_put_bool(object, "extra_sweeps", round[k].extra_sweeps);
        json_put_integer(object, "level", round[k].level);
        json_put_integer(object, "stage", round[k].stage);
        json_put_integer(object, "least_sweeps", round[k].least_sweeps);
        json_put_integer(object, "sweeps", round[k].sweeps);
        json_put_integer(object, "inserted", (int64_t)round[k].inserted);
        json_put_integer(object, "deleted", (int64_t)round[k].deleted);
        json_put_number(object, "sigma", round[k].sigma);
        json_put_integer(object, "count", (int64_t)round[k].count);
        json_put_number(object, "energy", round[k].energy);
        json_put_number(object, "gain", round[k].gain);
    }
}

/* Adds the first and the last sweep, and evenly spaced ones between them, up to MOST_SWEEPS. */
static void put_sweeps(json *report, const solver *s)
{
    size_t count;
    const solver_sweep *sweep = solver_sweeps(s, &count);
    const size_t rows = count < MOST_SWEEPS ? count : MOST_SWEEPS;
    json_put_integer(report, "sweeps_total", (int64_t)count);
    json *array = json_put_array(report, "sweeps");
    for (size_t i = 0; i < rows; i++) {
        const size_t k = rows < count ? i * (count - 1) / (rows - 1) : i;
        json *object = json_append_object(array);
        json_put_integer(object, "sweep", (int64_t)k + 1);
        json_put_number(object, "energy", sweep[k].energy);
        json_put_number(object, "mean_log10_lambda", sweep[k].mean_log10_lambda);
        json_put_number(object, "rms_step", sweep[k].rms_step);
        json_put_integer(object, "count", (int64_t)sweep[k].count);
        json_put_number(object, "sigma", sweep[k].sigma);
        json_put_integer(object, "rejected", (int64_t)sweep[k].rejected);
        json_put_integer(object, "inserted", (int64_t)sweep[k].inserted);
        json_put_integer(object, "deleted", (int64_t)sweep[k].deleted);
    }
}

void report_put_timing(json *report, const report_timing *t)
{
    json *timing = json_put_object(report, "timing_s");
    int64_t total = 0;
    for (size_t k = 0; k < t->count; k++) {
        json_put_number(timing, t->phase[k], clock_seconds(t->phase_ms[k]));
        total += t->phase_ms[k];
    }
    json_put_number(timing, "total", clock_seconds(total));
}

static void put_feature_size(json *grading, const spacing_request_features *f)
{
    json *feature = json_put_object(grading, "feature_size");
    json_put_number(feature, "least", f->least);
    json_put_number(feature, "median", f->median);
    json_put_number(feature, "floor", f->floor);
    json_put_number(feature, "below_floor", f->floored_share);
}

/* Fraction of the points from which a spacing that differs from a map is worth a warning. */
static const double CUT_SHARE = 0.05;
/* Maximum number of points whose distances from a map are tested. */
static const size_t MAP_SAMPLES = 10000;

/* The fraction of the points that are farther than their spacing from a map. */
static double find_far_share(const map *m, const solver_points *p)
{
    const size_t every = p->count / MAP_SAMPLES + 1;
    size_t far = 0, tested = 0;
    for (size_t i = 0; i < p->count; i += every, tested++)
        far += !map_is_near(m, p->position[i], p->spacing[i]);
    return (double)far / (double)fmax((double)tested, 1);
}

/* How the spacing differs from a map. */
static void put_map(json *grading, json *warnings, const report_facts *facts, const sizing_field_facts *g)
{
    const map *m = facts->source->map;
    if (!m) return;
    json_put_number(grading, "cut_share", g->cut_share);
    json_put_number(grading, "largest_cut", g->largest_cut);
    const double far = find_far_share(m, solver_result_points(facts->solver));
    char *of_cuts = mem_printf(
             "sampling.grid: %.3g %% of the points have a spacing that is more than %.0f %% below "
             "that of the map, by up to %.3g %%: adjacent spacings differ by at most %.3g of their "
             "distance. Raise sampling.gradation, or paint a map that varies less.",
             100 * g->cut_share, 100 * SIZING_FIELD_CUT, 100 * g->largest_cut, facts->spec->gradation),
         *of_place = mem_printf(
             "sampling.grid: %.3g %% of the points are farther than a spacing from the map, so that "
             "it does not determine the spacing there. Check the position and the units of the map.",
             100 * far);
    if (g->cut_share > CUT_SHARE) json_append_string(warnings, of_cuts);
    if (far > SOURCE_FAR_SHARE) json_append_string(warnings, of_place);
    free(of_cuts);
    free(of_place);
}

/* The grading that was used to meet the count. */
static void put_grading(json *report, const report_facts *facts)
{
    if (!facts->sizing) return;
    sizing_field_facts g = sizing_field_describe(facts->sizing);
    json *object = json_put_object(report, "grading");
    json_put_number(object, "scale", g.scale);
    json_put_number(object, "least_spacing", g.least);
    json_put_number(object, "largest_spacing", g.largest);
    if (facts->spec->curvature.chord_error > 0) {
        json_put_number(object, "chord_error", facts->spec->curvature.chord_error * g.scale * g.scale);
        if (facts->outputs->has_mesh)
            json_put_number(object, "chord_error_largest", facts->outputs->chord_error);
    }
    put_map(object, json_find(report, "/surface/warnings"), facts, &g);
    if (facts->spec->has_feature) put_feature_size(object, &g.features);
    double asked = facts->spec->curvature.ratio, reached = g.largest / g.least;
    if (!(asked > 0)) return;
    json_put_number(json_find(report, "/requested"), "ratio", asked);
    json_put_number(json_find(report, "/reached"), "ratio", reached);
    if (reached >= RATIO_REACHED * asked) return;
    const spec *s = facts->spec;
    const bool low = s->min_spacing > 0, high = s->max_spacing > 0;
    char *cause =
        g.permitted_ratio >= asked
            ? mem_strdup(
                  "the spacing is smoothed, so that adjacent points differ little. A larger ratio may reach more.")
        : g.permitted_ratio > 1.05
            ? mem_printf(
                  "with the exponent %.3g, the curvature of the surface varies by %.3g:1%s. Try a larger "
                  "sampling.curvature.exponent, or lower the ratio.",
                  s->curvature.exponent, g.permitted_ratio,
                  reached < RATIO_REACHED * g.permitted_ratio
                      ? ", and the spacing is smoothed, so that adjacent points differ little"
                      : "")
            : mem_strdup("the surface has the same curvature everywhere, or none. Omit sampling.curvature.");
    char *warning =
        mem_printf("sampling.curvature.ratio: the spacing varies by %.3g:1 (requested %.3g:1): %s%s", reached,
                   asked, cause,
                   low && high ? " sampling.min_spacing and sampling.max_spacing limit it as well."
                   : low       ? " sampling.min_spacing limits it as well."
                   : high      ? " sampling.max_spacing limits it as well."
                               : "");
    json_append_string(json_find(report, "/surface/warnings"), warning);
    free(warning);
    free(cause);
}

/* The factor of curvatures in (14), and the distance over which they are averaged. */
static void put_alpha(json *report, const report_facts *facts)
{
    if (!facts->spec->has_alpha) return;
    json *object = json_put_object(report, "alpha");
    json_put_number(object, "length", facts->source->field->extent);
    json_put_number(object, "scale", facts->curvature ? scaled_curvature_scale(facts->curvature) : 0);
}

/* The requested target, and the value reached. */
static void put_target(json *report, const report_facts *facts)
{
    const spec *s = facts->spec;
    const solver_points *solved = solver_result_points(facts->solver);
    json *requested = json_put_object(report, "requested"), *reached = json_put_object(report, "reached");
    if (s->count > 0) {
        json_put_integer(requested, "count", s->count);
        json_put_integer(reached, "count", (int64_t)facts->count);
    }
    if (s->spacing > 0) {
        json_put_number(requested, "spacing", s->spacing);
        json_put_number(reached, "spacing", solver_spacing(facts->solver));
    }
    if (s->density > 0) {
        json_put_number(requested, "density", s->density);
        json_put_number(reached, "density", (double)facts->count / facts->scan->area);
    }
    if (s->resolve) {
        json_put_bool(requested, "resolve", true);
        json_put_integer(reached, "count", (int64_t)facts->count);
    }
    if (s->has_control) {
        json_put_integer(requested, "min_count", s->control.min_count);
        json_put_number(requested, "max_sigma", s->control.max_sigma);
        json_put_integer(reached, "count", (int64_t)facts->count);
        json_put_number(reached, "sigma", solved->sigma);
    }
}

/* Adds the members that describe the solve and not its result. */
static void put_diagnostics(json *object, const report_facts *facts)
{
    const solver_points *solved = solver_result_points(facts->solver);
    json_put_number(object, "sigma", solved->sigma);
    json_put_number(object, "mean_neighbours", solved->mean_neighbours);
    json_put_number(object, "step_left", solved->step_left);
    json *energy = json_put_object(object, "energy");
    json_put_number(energy, "mean", solved->mean_energy);
    json_put_number(energy, "ideal", solved->ideal_energy);
    json_put_number(energy, "excess", solved->mean_energy / solved->ideal_energy - 1);
    json_put_integer(object, "threads", threads_count(facts->pool));
    json_put_string(object, "isa", isa_name(facts->isa));
}

/* How the last round was solved: the method of the spec may be solved in another way. */
static void put_regime(json *report, const solver *s)
{
    size_t count;
    const solver_round *round = solver_rounds(s, &count);
    json_put_string(report, "regime", count > 0 ? round[count - 1].regime : NULL);
}

void report_fill(json *report, const report_facts *facts)
{
    const solver_points *solved = solver_result_points(facts->solver);
    json_put_string(report, "schema", "hexad.report");
    json_put_integer(report, "version", 1);
    outcome_describe(facts->result, report);
    put_regime(report, facts->solver);
    json_put_integer(report, "count", (int64_t)facts->count);
    json_put_string(report, "up", facts->outputs->y_up ? "y" : "z");
    put_target(report, facts);
    put_surface(report, facts);
    put_grading(report, facts);
    put_alpha(report, facts);
    if (facts->source->field->patches)
        patch_report_put(facts->source->field->patches, solved, facts->farthest,
                         solver_spacing(facts->solver), facts->source->whole.labels, report);
    json_put_number(report, "spacing", solver_spacing(facts->solver));
    put_diagnostics(json_put_object(report, "diagnostics"), facts);
    put_quality(report, facts);
    ratings_describe(facts->measures, facts->spec->pattern == SPEC_PATTERN_BLUE_NOISE, report);
    put_rounds(report, facts->solver);
    put_sweeps(report, facts->solver);
    report_put_timing(report, &facts->timing);
    json_put_integer(report, "peak_memory_bytes", facts->peak_memory);
    json_put(report, "spec", json_copy(facts->spec->normalised));
}
