// SPDX-License-Identifier: Apache-2.0
/* Measures the points of one job both ways, in one process: with certain cells from the points alone, and with all
 * cells from the triangles of the surface (measures_input.exact). Prints one line of JSON.
 *
 *     two_ways SPEC.json DIRECTORY [COUNT]
 *
 * The modules are loaded from the directory of the program or the library directory. It is started again as the reader
 * of meshes and of headers of volumes. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "base/core/memory.h"
#include "base/json/json.h"
#include "base/core/reader.h"
#include "files/file.h"
#include "io/meshes/mesh_reader.h"
#include "io/volumes/volume_header.h"
#include "job/phases/job.h"
#include "job/phases/run_options.h"
#include "job/report/outcome.h"
#include "spec/spec.h"

typedef struct taken {
    measures measures;
    outcome_kind outcome;
    double cpu_s;
} taken;

/* Set before the phases run. */
static run_options options = {.progress_fd = -1, .threads = 1, .memory_mb = 16384};
static taken ways[2];

static double cpu_seconds(void)
{
    struct timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static bool start(job *j, error *e)
{
    return job_survey(j, e) && job_place(j, &j->solution, e);
}

/* The outcome as far as measures decide it. */
static outcome_kind outcome_of(const job *j)
{
    const outcome_input in = {.measures = &j->solution.measures,
                              .step_tolerance = 1,
                              .is_blue_noise = j->spec->pattern == SPEC_PATTERN_BLUE_NOISE,
                              .gain_tolerance = 1,
                              .energy_tolerance = 1,
                              .require = j->spec->require};
    return outcome_evaluate(&in).outcome;
}

static bool measure_both(job *j, error *e)
{
    for (int way = 0; way < 2; way++) {
        options.exact_measures = way == 1;
        const double begin = cpu_seconds();
        if (!job_measure(j, &j->solution, e)) return false;
        ways[way] = (taken){j->solution.measures, outcome_of(j), cpu_seconds() - begin};
        if (way == 1) break;
        free(j->solution.spacing_local);
        free(j->solution.farthest);
        free(j->solution.degree);
        free(j->solution.order_known.piece);
        free(j->solution.order_known.spacing);
        j->solution.order_known = (point_order_known){0};
        j->solution.degree = NULL;
    }
    return true;
}

static void print_number(const char *name, double value)
{
    if (isfinite(value))
        printf(", \"%s\": %.9g", name, value);
    else
        printf(", \"%s\": null", name);
}

static void print_way(const char *name, const taken *t)
{
    const measures *m = &t->measures;
    printf("\"%s\": {\"outcome\": \"%s\"", name, outcome_names[t->outcome]);
    const struct {
        const char *name;
        double value;
    } all[] = {{"hex_fraction", m->hex_fraction},
               {"edge_cv", m->edge_cv},
               {"area_cv", m->area_cv},
               {"energy_excess", m->energy_excess},
               {"disorder", m->disorder},
               {"min_spacing_ratio", m->min_spacing_ratio},
               {"coverage", m->coverage},
               {"missing_share", m->missing_share},
               {"close_share", m->close_share},
               {"unmeasured_share", m->unmeasured_share},
               {"defect_share", m->defect_share},
               {"coincident", (double)m->coincident},
               {"thin_count", (double)m->thin_count},
               {"euler", m->euler},
               {"parts_without_points", (double)m->parts_without_points}};
    for (size_t k = 0; k < sizeof all / sizeof *all; k++) print_number(all[k].name, all[k].value);
    print_number("cpu_s", t->cpu_s);
    printf("}");
}

static spec *load(const char *path, error *e)
{
    size_t length;
    char *text = store_file_read(path, (size_t)1 << 24, &length, e);
    json *document = text ? json_parse(text, length, e) : NULL;
    spec *s = document ? spec_parse(document, NULL, e) : NULL;
    json_free(document);
    free(text);
    return s;
}

int main(int count, char **words)
{
    static job_phase *const phases[] = {job_load, start, job_solve, measure_both};
    error e = {0};
    if (count > 1 && strcmp(words[1], VOLUME_HEADER_COMMAND) == 0)
        return reader_run_module(VOLUME_HEADER_MODULE, "header_reader_main", count - 1, words + 1);
    if (count > 1 &&
        (strcmp(words[1], MESH_READER_COMMAND) == 0 || strcmp(words[1], MESH_VALUES_COMMAND) == 0 ||
         strcmp(words[1], MESH_POLYGONS_COMMAND) == 0))
        return reader_run_module(MESH_READER_MODULE, "mesh_reader_main", count - 1, words + 1);
    if (count < 3) return 2;
    mem_begin();
    options.output = words[2];
    spec *s = load(words[1], &e);
    job j = {.spec = s, .options = &options};
    bool ok = s && store_directory_create(words[2], &e);
    if (ok) progress_begin(&j.progress, -1, false, (progress_listener){0});
    if (ok) snapshot_begin(&j.snapshot, NULL);
    ok = ok && job_run_phases(&j, phases, sizeof phases / sizeof *phases, &e);
    if (!ok) {
        fprintf(stderr, "%s\n", e.message);
        return 1;
    }
    printf("{\"points\": %zu", solver_result_points(j.solution.solver)->count);
    print_number("certain_share", ways[0].measures.certain_share);
    printf(", ");
    print_way("certain", &ways[0]);
    printf(", ");
    print_way("exact", &ways[1]);
    printf("}\n");
    return 0;
}
