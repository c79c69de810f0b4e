// SPDX-License-Identifier: Apache-2.0
#include "job/phases/attach.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <unistd.h>

#include "base/core/memory.h"
#include "geometry/space/packing.h"
#include "io/points/ply.h"
#include "io/points/property.h"
#include "job/phases/job.h"
#include "job/phases/output_points.h"
#include "job/report/report.h"
#include "job/phases/surface_meshes.h"
#include "job/phases/upright.h"
#include "job/source/source_report.h"
#include "spec/attach_spec.h"
#include "files/file.h"

static const char what[] = "the points of a result";

/* Memory of the points, as a multiple of their numbers in doubles: the columns, the attributes made of them,
 * and the sets that are written. */
static const double COPIES = 3;

typedef struct attach {
    job job; /* first, since phases of a job receive this pointer */
    ply_file file;
    points set;
    size_t kept; /* attributes of the file; names and values are owned here until they are adopted */
    point_attribute attributes[COLUMNS_MAX];
    const double *places[ATTACHMENT_ARRAYS]; /* values of the attribute `source`: the positions on the
                                              * meshes */
    surface_meshes meshes;                   /* meshes of the spec, with the topologies stored in the
                                              * result */
    size_t without;                          /* number of points without a stored position; they are not
                                              * moved */
    double spacing;                          /* mean requested spacing */
    json *warnings;                          /* for the report, which takes ownership */
} attach;

/* ---- the points of the result ---- */

/* A range of columns that are components of one attribute, by the suffixes of their names. */
typedef struct group {
    char base[COLUMN_NAME_SIZE];
    int components;
    point_attribute_kind kind;
} group;

static bool is_named(const columns *list, size_t c, const char *base, char suffix)
{
    char name[COLUMN_NAME_SIZE + 4];
    snprintf(name, sizeof name, "%s_%c", base, suffix);
    return c < list->count && strcmp(list->list[c].name, name) == 0;
}

static bool is_whole(const column *c)
{
    return c->type == COLUMN_INT || c->type == COLUMN_UINT;
}

/* The attribute that begins with a column: several columns v_x v_y ..., or one column. */
static group group_at(const columns *list, size_t first)
{
    static const struct {
        const char *suffixes;
        int least;
        point_attribute_kind kind;
    } kinds[] = {{"xyzw", 2, POINT_ATTRIBUTE_VECTOR},
                 {"rgba", 3, POINT_ATTRIBUTE_COLOR},
                 {"st", 2, POINT_ATTRIBUTE_UV}};
    const column *c = &list->list[first];
    const size_t length = strlen(c->name);
    group one = {.components = 1, .kind = is_whole(c) ? POINT_ATTRIBUTE_INT : POINT_ATTRIBUTE_FLOAT};
    snprintf(one.base, sizeof one.base, "%s", c->name);
    if (length < 3 || c->name[length - 2] != '_') return one;
    for (size_t k = 0; k < sizeof kinds / sizeof *kinds; k++) {
        group several = {.kind = is_whole(c) ? POINT_ATTRIBUTE_INT : kinds[k].kind};
        snprintf(several.base, sizeof several.base, "%.*s", (int)(length - 2), c->name);
        while (kinds[k].suffixes[several.components] &&
               is_named(list, first + (size_t)several.components, several.base,
                        kinds[k].suffixes[several.components]))
            several.components++;
        if (several.kind == POINT_ATTRIBUTE_VECTOR && several.components != 3)
            several.kind = POINT_ATTRIBUTE_FLOAT;
        if (several.components >= kinds[k].least) return several;
    }
    return one;
}

/* Whether the values are whole numbers. Those of more than 32 bits are stored as doubles. */
static bool are_whole(const double *values, size_t count)
{
    bool whole = true;
    for (size_t k = 0; whole && k < count; k++) whole = values[k] == round(values[k]);
    return whole;
}

/* Checks that all formats accept the name of an attribute, and that no earlier attribute has it. */
static bool check_name(const attach *a, const char *name, error *e)
{
    static const char letters[] = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ_0123456789";
    enum { NAME_MOST = 63 };
    bool ok = *name && strlen(name) <= NAME_MOST && strspn(name, letters) == strlen(name) &&
              !(*name >= '0' && *name <= '9');
    for (size_t k = 0; ok && k < a->kept; k++) ok = strcasecmp(a->attributes[k].name, name) != 0;
    return ok ||
           error_set(e, ERROR_INPUT_UNSUPPORTED,
                     "/sampling/attach: the points have a property \"%.63s\" whose name is not of letters, "
                     "digits and _, or that occurs twice: rename or remove it",
                     name);
}

static bool keep_group(attach *a, const columns *list, size_t first, const group *g, error *e)
{
    if (!check_name(a, g->base, e)) return false;
    const size_t count = a->file.points.count, n = (size_t)g->components;
    double *values = mem_array(count, n * sizeof *values, what, e);
    if (!values) return false;
    for (size_t c = 0; c < n; c++)
        for (size_t i = 0; i < count; i++) values[n * i + c] = list->list[first + c].values[i];
    point_attribute *out = &a->attributes[a->kept++];
    *out = (point_attribute){mem_strdup(g->base), g->kind, g->components, values, false};
    const bool is_long = list->list[first].type == COLUMN_DOUBLE;
    if (is_long && n == 1 && are_whole(values, count)) out->kind = POINT_ATTRIBUTE_INT;
    out->is_double = is_long && out->kind != POINT_ATTRIBUTE_INT;
    return true;
}

/* Makes attributes of the columns that are not properties of points. */
static bool keep_attributes(attach *a, error *e)
{
    const columns *list = &a->file.columns;
    for (size_t c = 0; c < list->count;) {
        const char *name = list->list[c].name;
        if (columns_is_own(name) || columns_is_of_orient(name)) {
            c++;
            continue;
        }
        const group g = group_at(list, c);
        if (!keep_group(a, list, c, &g, e)) return false;
        c += (size_t)g.components;
    }
    return true;
}

/* Finds the arrays of the stored positions: the first name with all suffixes. Error: attribute_missing. */
static bool find_places(attach *a, error *e)
{
    for (size_t k = 0; k < a->kept; k++) {
        const char *own = a->attributes[k].name, *end = strrchr(own, '_');
        size_t found = 0;
        for (int n = 0; end && n < ATTACHMENT_ARRAYS; n++) {
            char *name = mem_printf("%.*s_%s", (int)(end - own), own, attachment_arrays[n].suffix);
            point_attribute *of = (point_attribute *)property_find_attribute(a->attributes, a->kept, name);
            free(name);
            if (!of || of->components != attachment_arrays[n].components) break;
            of->kind = attachment_arrays[n].kind;
            of->is_double = attachment_arrays[n].is_double;
            a->places[n] = of->values;
            found++;
        }
        if (found == ATTACHMENT_ARRAYS) return true;
    }
    return error_set(e, ERROR_ATTRIBUTE_MISSING,
                     "/sampling/attach: the points have no attribute source: " ATTACH_SPEC_SOURCE_ADVICE);
}

static bool check_properties(const points *p, error *e)
{
    const char *missing = !p->normal ? "nx, ny and nz" : !p->spacing_local ? "spacing_local" : NULL;
    return !missing || error_set(e, ERROR_ATTRIBUTE_MISSING,
                                 "/sampling/attach: the points have no %s: sample the surface without "
                                 "output.ply.properties",
                                 missing);
}

/* Checks the values that the outputs depend on. */
static bool check_values(const points *p, error *e)
{
    static const double largest = 1e30; /* as for coordinates of meshes */
    for (size_t i = 0; i < p->count; i++) {
        const vec3 x = p->position[i];
        const double length = vec3_norm(p->normal[i]);
        const bool is_spaced = p->spacing_local[i] > 0 && (!p->spacing || p->spacing[i] > 0);
        if (!(is_spaced && length > 0.5 && length < 2 && fabs(x.x) <= largest && fabs(x.y) <= largest &&
              fabs(x.z) <= largest))
            return error_set(
                e, ERROR_INPUT_DAMAGED,
                "/sampling/attach: point %zu has no unit normal, no spacing above 0, or a position "
                "beyond %g: sample the surface again",
                i, largest);
    }
    return true;
}

/* Reads the topologies of the meshes from the comments. */
static bool read_topologies(attach *a, FILE *file, error *e)
{
    char line[1024];
    size_t found = 0;
    rewind(file);
    while (fgets(line, sizeof line, file) && strncmp(line, "end_header", 10) != 0) {
        attachment_topology topology;
        size_t index;
        if (!attachment_parse_comment(line, &index, &topology)) continue;
        if (index < a->meshes.count) a->meshes.file[index].topology = topology;
        found++;
    }
    return found == a->meshes.count ||
           error_set(e, found ? ERROR_INPUT_UNSUPPORTED : ERROR_INPUT_DAMAGED,
                     "/sampling/attach: the points are on %zu meshes, but the surface has %zu: name each "
                     "mesh of the result, in the same order, and keep the comments of points.ply",
                     found, a->meshes.count);
}

/* Checks by its length that the file may be read within the memory limit. */
static bool check_size(const attach *a, int fd, error *e)
{
    const off_t bytes = lseek(fd, 0, SEEK_END);
    const double needed = COPIES * 2 * (double)bytes; /* factor 2: floats become doubles */
    return needed <= (double)a->job.memory ||
           error_set(e, ERROR_LIMIT_MEMORY,
                     "/sampling/attach: the points require %.0f MiB, and the limit is %zu MiB: raise "
                     "limits.memory_mb",
                     ceil(needed / (1 << 20)), a->job.memory >> 20);
}

static bool read_points(attach *a, error *e)
{
    const int fd = source_open_file(&a->job.source, a->job.spec->attach, e);
    if (fd < 0) return error_prefix(e, "/sampling/attach");
    const bool fits = check_size(a, fd, e);
    FILE *file = fits ? fdopen(fd, "rb") : NULL;
    if (!file) {
        if (fits) error_set(e, error_code_of_errno(errno), "cannot read %s: %m", a->job.spec->attach);
        close(fd);
        return false;
    }
    const bool ok = (ply_read(file, &a->file, e) || error_prefix(e, "%s", a->job.spec->attach)) &&
                    check_properties(&a->file.points, e) && check_values(&a->file.points, e) &&
                    keep_attributes(a, e) && find_places(a, e) && read_topologies(a, file, e);
    fclose(file);
    return ok && (a->file.points.count > 0 ||
                  error_set(e, ERROR_INPUT_DAMAGED, "%s: the file has no points", a->job.spec->attach));
}

/* ---- phases ---- */

static bool load(job *j, error *e)
{
    attach *a = (attach *)j;
    progress_enter(&j->progress, PROGRESS_LOAD);
    j->source.roots = j->options->roots;
    return job_make_pool(j, e) && surface_meshes_open(&j->spec->surface, &j->source, &a->meshes, e) &&
           read_points(a, e);
}

/* The area of the result's surface: the sum of the areas of its points' cells. */
static double area_of(const points *p)
{
    double sum = 0;
    for (size_t i = 0; i < p->count; i++) sum += 0.5 * sqrt(3) * p->spacing_local[i] * p->spacing_local[i];
    return sum;
}

/* The mean requested spacing: of the points, otherwise that of the area, as in the report of the result. */
static double mean_spacing(const points *p)
{
    double sum = 0;
    if (!p->spacing) return packing_spacing(area_of(p), (double)p->count);
    for (size_t i = 0; i < p->count; i++) sum += p->spacing[i];
    return sum / (double)p->count;
}

static bool place(job *j, error *e)
{
    attach *a = (attach *)j;
    const points *p = &a->file.points;
    progress_enter(&j->progress, PROGRESS_START);
    for (size_t i = 0; i < p->count; i++) a->without += a->places[ATTACHMENT_MESH][i] < 0;
    a->set = *p;
    a->set.is_graded = p->spacing != NULL; /* the word "default" means what it meant for the result */
    a->spacing = mean_spacing(p);
    a->set.orient = NULL; /* computed again from the new normals */
    return attachment_evaluate(a->meshes.file, a->meshes.count, j->memory, p->count, a->places,
                               (vec3 *)p->position, (vec3 *)p->normal, e);
}

/* Sets the members of a spec that attributes_find checks: only these attributes, and no outputs, which may
 * need others. */
static spec spec_with(const spec *s, spec_attribute *list, size_t count)
{
    spec how = *s;
    how.attributes = list;
    how.attribute_count = count;
    how.ply_properties = NULL;
    how.ply_property_count = 0;
    how.has_preview = how.has_orient = how.has_instancer = false;
    return how;
}

/* Whether the file of this frame has an attribute. If not, the values of the result are kept, with a
 * warning. */
static bool has_values(attach *a, spec_attribute *one, bool *out, error *e)
{
    job *j = &a->job;
    const spec how = spec_with(j->spec, one, 1);
    attributes found = {0};
    error why = {0};
    *out = attributes_find(&how, &j->source, j->memory, &found, &why);
    const char *name = found.count > 0 ? found.values[0].name : NULL;
    const bool is_kept = !*out && why.code == ERROR_ATTRIBUTE_MISSING && name &&
                         property_find_attribute(a->attributes, a->kept, name);
    if (is_kept) {
        char *text = mem_printf("attribute \"%s\" keeps the values of the result: %s", name, why.message);
        json_append_string(a->warnings, text);
        free(text);
    }
    attributes_free(&found);
    if (*out || is_kept) return true;
    if (e) *e = why;
    return false;
}

/* Reads the values of the attributes that are not known; points without a requested spacing have the mean. */
static bool read_values(attach *a, error *e)
{
    job *j = &a->job;
    const double *known = a->set.spacing;
    double *even = known ? NULL : mem_array(a->set.count, sizeof *even, what, e);
    for (size_t i = 0; even && i < a->set.count; i++) even[i] = a->spacing;
    a->set.spacing = known ? known : even;
    const bool ok =
        a->set.spacing && attributes_read(&j->attributes, &j->source, NULL, j->memory, &a->set, e);
    a->set.spacing = known;
    free(even);
    return ok;
}

/* Reads the attributes from files at the new positions. All other attributes keep the values of the
 * result. */
static bool read_attributes(job *j, error *e)
{
    attach *a = (attach *)j;
    const spec *s = j->spec;
    spec_attribute *chosen = mem_alloc((s->attribute_count + 1) * sizeof *chosen);
    size_t count = 0;
    bool ok = true;
    progress_enter(&j->progress, PROGRESS_RELAX);
    for (size_t k = 0; ok && k < s->attribute_count; k++) {
        bool has = false;
        if (strcmp(s->attributes[k].from, SPEC_FROM_GEOMETRY) == 0) continue;
        ok = has_values(a, &s->attributes[k], &has, e);
        if (has) chosen[count++] = s->attributes[k];
    }
    const spec how = spec_with(s, chosen, count);
    ok = ok && attributes_find(&how, &j->source, j->memory, &j->attributes, e);
    if (ok) {
        attributes_adopt(&j->attributes, a->attributes, a->kept);
        a->kept = 0;
        ok = read_values(a, e);
    }
    free(chosen);
    return ok;
}

/* The outputs of the spec: by default all properties that the points have. A preview of values that they lack is
 * shaded, with a warning. */
static spec outputs_of(const attach *a)
{
    static const char *const all[] = {"all"};
    spec how = *a->job.spec;
    const quantity_look look = output_points_look(&how);
    if (!how.ply_properties) {
        how.ply_properties = (char **)all;
        how.ply_property_count = 1;
    }
    if (!how.has_preview || how.preview_attribute || !quantity_has_scale(look.which) ||
        quantity_values(&a->set, &look))
        return how;
    how.preview_color = SPEC_COLOR_SHADING;
    char *text = mem_printf("the preview is shaded, because the points have no %s: sample the surface with "
                            "\"all\" in output.ply.properties",
                            quantity_title(&look));
    json_append_string(a->warnings, text);
    free(text);
    return how;
}

static bool write_files(job *j, error *e)
{
    attach *a = (attach *)j;
    const delivery *to = &j->options->delivery;
    const spec how = outputs_of(a);
    char *comments = surface_meshes_comments(&a->meshes);
    progress_enter(&j->progress, PROGRESS_WRITE);
    const results_input in = {.spec = &how,
                              .set = &a->set,
                              .comments = comments,
                              .frame = j->options->frame,
                              .y_up = upright_y(j->spec, &a->set),
                              .h = a->spacing};
    const bool ok =
        attributes_check_named(j->spec, &a->set, e) &&
        to->points(to->context, &in, j->pool, json_put_array(j->report, "outputs"), &j->results, e);
    free(comments);
    return ok;
}

/* ---- report ---- */

static void fill_report(attach *a)
{
    job *j = &a->job;
    json *report = j->report, *of_surface = json_put_object(report, "surface"), *unused = json_new_object();
    const outcome_result v = {.outcome = OUTCOME_CONVERGED};
    json_put_string(report, "schema", "hexad.report");
    json_put_integer(report, "version", 1);
    outcome_describe(&v, report);
    json_put_integer(report, "count", (int64_t)a->set.count);
    json_put_string(report, "up", j->results.y_up ? "y" : "z");
    json_put_number(report, "spacing", a->spacing);
    json *attached = json_put_object(report, "attached");
    json_put_string(attached, "from", j->spec->attach);
    json_put_integer(attached, "without_place", (int64_t)a->without);
    json_put(of_surface, "warnings", a->warnings);
    source_describe(&j->source, report, unused, a->warnings);
    json_free(unused);
    json *of_points = attributes_describe(&j->attributes, a->warnings);
    if (of_points) json_put(report, "attributes", of_points);
    if (a->without > 0) {
        char *text = mem_printf("%zu points lie on no mesh and stay where they were", a->without);
        json_append_string(a->warnings, text);
        free(text);
    }
    report_warn_of_build(a->warnings, j->spec);
    a->warnings = NULL;
    json_put_array(report, "advice");
    json_put_integer(json_put_object(report, "diagnostics"), "threads", threads_count(j->pool));
    json_put_integer(report, "peak_memory_bytes", job_peak_memory(j));
    const report_timing timing = job_timing(j);
    report_put_timing(report, &timing);
    json_put(report, "spec", json_copy(j->spec->normalised));
}

static void begin(attach *a, const spec *s, const run_options *options)
{
    *a = (attach){.job = {.spec = s, .options = options}, .warnings = json_new_array()};
    a->job.report = json_new_object();
    progress_begin(&a->job.progress, options->progress_fd, options->progress_bar, options->listener);
    snapshot_begin(&a->job.snapshot, NULL);
}

static void end(attach *a)
{
    for (size_t k = 0; k < a->kept; k++) {
        free((char *)a->attributes[k].name);
        free((double *)a->attributes[k].values);
    }
    json_free(a->warnings);
    surface_meshes_close(&a->meshes);
    ply_file_free(&a->file);
    job_free(&a->job);
}

bool attach_run(const spec *s, const run_options *options, outcome_kind *outcome, json **report, error *e)
{
    static job_phase *const phases[] = {load, place, read_attributes, write_files};
    attach a;
    begin(&a, s, options);
    bool ok = options->delivery.begin(options->delivery.context, e) &&
              job_run_phases(&a.job, phases, sizeof phases / sizeof *phases, e);
    progress_end(&a.job.progress);
    if (ok) {
        fill_report(&a);
        ok = job_may_continue(&a.job, e) &&
             options->delivery.report(options->delivery.context, a.job.report, e);
    }
    if (ok) {
        *outcome = OUTCOME_CONVERGED;
        *report = a.job.report;
        a.job.report = NULL;
    }
    end(&a);
    return ok;
}

json *attach_estimate(const spec *s, const run_options *options, error *e)
{
    static job_phase *const phases[] = {load};
    attach a;
    json *o = NULL, *unused = json_new_object();
    begin(&a, s, options);
    if (job_run_phases(&a.job, phases, 1, e)) {
        o = json_new_object();
        json_put_integer(o, "count", (int64_t)a.file.points.count);
        json_put_number(o, "area", area_of(&a.file.points));
        report_put_box(o, bbox_of_points(a.file.points.position, a.file.points.count, NULL));
        json_put_integer(o, "memory_bytes", job_peak_memory(&a.job));
        json_put_null(o, "seconds");
        json_put_string(o, "seconds_missing", "points are placed without a solve");
        json_put_integer(o, "threads", threads_count(a.job.pool));
        json *warnings = json_put_array(o, "warnings");
        source_describe(&a.job.source, unused, unused, warnings);
        report_warn_of_build(warnings, s);
        json_put_array(o, "advice");
    }
    json_free(unused);
    progress_end(&a.job.progress);
    end(&a);
    return o;
}
