// SPDX-License-Identifier: Apache-2.0
#include "job/inspect/suggestion.h"

#include <math.h>

#include "base/core/memory.h"
#include "surface/field/patches.h"
#include "geometry/space/packing.h"
#include "job/report/advice.h"
#include "job/phases/job.h"
#include "job/source/plan.h"
#include "job/source/source_report.h"
#include "job/report/report.h"
#include "sampling/measures/measures.h"
#include "sampling/sizing/clearance.h"
#include "spec/sample_spec.h"

/* Minimum and maximum number of points of a suggested spec; the maximum takes seconds. */
static const double FEWEST = 2000, MOST = SAMPLE_SPEC_COUNT_MOST;
/* Limits of the work of an inspection, independent of the machine: cells scanned over all surfaces (those of
 * a cube of 256 voxels), and voxels read to open the surfaces. */
static const double MOST_CELLS = 4e5, MOST_VOXELS = 3e8;
/* Mean number of cells that a plane crosses per squared cell side, over all orientations. */
static const double CELLS_OF_A_PLANE = 1.5;
/* Number of cells at which the gradient is measured. */
static const size_t SLOPES = 256;

/* The mean length of the gradient. NAN: the field is undefined at all sampled cells. */
static double mean_slope(const surface *scan)
{
    double sum = 0, count = 0;
    size_t step = scan->cells / SLOPES + 1;
    for (size_t k = 0; k < scan->cells; k += step) {
        field_cell cell;
        field_sample s;
        surface_cell(scan, k, &cell);
        vec3 middle = field_cell_middle(&cell);
        if (!field_sample_at(scan->field, middle, FIELD_GRADIENT, &s)) continue;
        sum += vec3_norm(s.gradient);
        count++;
    }
    return count > 0 ? sum / count : NAN;
}

static json *spec_of(const json *shape, double count)
{
    json *document = json_new_object();
    json_put_integer(document, "version", 1);
    json_put(document, "surface", json_copy(shape));
    json_put_integer(json_put_object(document, "sampling"), "count", (int64_t)count);
    return document;
}

/* Estimates the area of a surface that is not scanned from its number of cells. Not for surfaces of patches:
 * their cells are triangles, or parts of them, of any size. */
static double estimate_area(const field *f)
{
    if (f->patches) return field_patches_area(f->patches);
    return (double)f->ops->cell_count(f) * f->cell_size * f->cell_size / CELLS_OF_A_PLANE;
}

/* Describes a surface that is not scanned, because that would take too long. `f` NULL: the surface was not
 * opened. */
static void describe_unseen(const field *f, const json *shape, json *item)
{
    json_put_number(item, "cells", f ? (double)f->ops->cell_count(f) : NAN);
    json_put_bool(item, "measured", false);
    json_put_number(item, "area", f ? estimate_area(f) : NAN);
    json_put_null(item, "count");
    json_put_null(item, "spacing");
    json_put_null(item, "slope");
    json_put(item, "spec", spec_of(shape, MOST));
}

/* Warns that walls may be thinner than the smallest distance that an inspection measures. The job's report
 * may then advise more points. */
static void warn_of_thinner_walls(const clearance *room, bool of_voxels, json *warnings)
{
    if (of_voxels)
        json_append_string(
            warnings,
            "walls may be thinner than half a voxel: the stated points separate walls of half a voxel, "
            "the thinnest that the data determine");
    if (of_voxels || room->factor > room->least_factor || room->least_factor >= 1) return;
    json_append_string(
        warnings, "walls may be thinner than the smallest distance that an inspection measures: they take "
                  "more points than stated");
}

static bool describe(job *j, const json *shape, json *item, json *warnings, error *e)
{
    clearance room;
    if (!job_survey(j, e)) return false;
    double area = j->scan->area;
    if (!clearance_measure(j->scan, NULL, packing_spacing(area, FEWEST), j->pool, MEASURES_THIN_SHARE, &room,
                           e))
        return false;
    advice_resolution to = {.spacing = packing_spacing(area, FEWEST), .count = FEWEST};
    const double thinnest = source_thinnest_wall(&j->source, j->spec);
    if (room.factor < 1) to = advice_resolve(area, (size_t)FEWEST, advice_factor(&room, thinnest), thinnest);
    warn_of_thinner_walls(&room, to.of_voxels, warnings);
    json_put_integer(item, "cells", (int64_t)j->scan->cells);
    json_put_bool(item, "measured", true);
    json_put_number(item, "area", area);
    report_put_box(item, source_box(&j->source, j->scan));
    json_put_number(item, "count", to.count <= PLAN_COUNT_MAX ? to.count : NAN);
    json_put_number(item, "spacing", to.spacing);
    json_put_number(item, "slope", mean_slope(j->scan));
    json_put(item, "spec", spec_of(shape, fmin(to.count, MOST)));
    return true;
}

/* The number of scanned cells of the surfaces in the list. */
static double cells_scanned(const json *list)
{
    double cells = 0;
    json_at root = json_root(list);
    for (json_at item = json_first(&root); item.node; item = json_next(&item)) {
        if (json_bool(json_member(&item, "measured"), false))
            cells += json_number(json_member(&item, "cells"), 0);
    }
    return cells;
}

/* Opens a surface and measures it. `cells`: maximum number of cells to scan. */
static bool look(job *j, const json *shape, double cells, json *item, error *e)
{
    static job_phase *const phases[] = {job_load};
    if (!job_run_phases(j, phases, 1, e)) return false;
    const field *f = j->source.field;
    bool seen = (double)f->ops->cell_count(f) <= cells;
    json *warnings = json_put_array(item, "warnings");
    if (!seen) describe_unseen(f, shape, item);
    if (seen && !describe(j, shape, item, warnings, e)) return false;
    json *unused = json_new_object();
    source_describe(&j->source, unused, unused, warnings);
    json_free(unused);
    return true;
}

bool suggestion_append(json *list, json *shape, double voxels, const run_options *options, error *e)
{
    error fault = {0};
    json *document = spec_of(shape, FEWEST), *item = json_new_object();
    spec *s = spec_parse(document, NULL, &fault);
    job j = {.spec = s, .options = options};
    progress_begin(&j.progress, options->progress_fd, false, options->listener);
    bool unopened = voxels * (double)(json_size(json_root(list)) + 1) > MOST_VOXELS;
    if (unopened) describe_unseen(NULL, shape, item);
    bool ok = unopened || (s && look(&j, shape, MOST_CELLS - cells_scanned(list), item, &fault));
    progress_end(&j.progress);
    job_free(&j);
    spec_free(s);
    json_free(document);
    if (!ok) {
        json *told = json_put_object(item, "error");
        json_put_string(told, "code", error_code_name(fault.code));
        json_put_string(told, "message", fault.message);
        json_put(item, "surface", shape);
    } else {
        json_free(shape);
    }
    json_append(list, item);
    if (fault.code != ERROR_CANCELLED && fault.code != ERROR_LIMIT_TIME) return true;
    if (e) *e = fault;
    return false;
}
