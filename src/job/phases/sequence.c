// SPDX-License-Identifier: Apache-2.0
#include "job/phases/sequence.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/compare.h"
#include "base/core/elementary.h"
#include "base/core/memory.h"
#include "base/core/worker_contract.h"
#include "files/late_hash.h"

/* Maximum size of a report, bytes; it has a line for each sweep. */
static const size_t REPORT_LIMIT = 64u << 20;
/* A frame is eased if its excess energy exceeds that of a frame without transferred points by MORE_DISORDER, and that
 * of the last eased frame by MORE_STRAIN. Otherwise the points of a surface that does not deform, on which easing
 * does not help, would move in each frame. */
static const double MORE_DISORDER = 1.1, MORE_STRAIN = 1.03;
/* A frame with more births and deaths than this fraction of the points is not eased: the sweeps between its portions
 * move the points already (frame_transfer). */
static const double MANY_CHANGES = 1.0 / 600;
static const char what[] = "the points of the frame before";

static FILE *open_result(const char *directory, const char *name, error *e)
{
    char *path = mem_printf("%s/%s", directory, name);
    FILE *file = fopen(path, "rbe");
    if (!file)
        error_set(e, ERROR_INPUT_MISSING, "the previous frame: cannot open %s: %s. Check --previous.", path,
                  strerror(errno));
    free(path);
    return file;
}

bool sequence_open(const char *directory, sequence_files *out, error *e)
{
    sequence_files f = {.summary = open_result(directory, WORKER_SUMMARY_NAME, NULL)};
    if ((f.points = open_result(directory, "points.ply", e)) &&
        (f.report = open_result(directory, "report.json", e))) {
        *out = f;
        return true;
    }
    sequence_close(&f);
    return false;
}

void sequence_close(sequence_files *files)
{
    if (files->points) fclose(files->points);
    if (files->report) fclose(files->report);
    if (files->summary) fclose(files->summary);
    *files = (sequence_files){0};
}

static bool set_damaged(const char *name, error *e)
{
    return error_set(e, ERROR_INPUT_DAMAGED,
                     "the previous frame: its %s is damaged: its bytes have changed since it was written "
                     "(SHA-256). Submit the job again.",
                     name);
}

/* Reads a JSON document; NULL: it is none. `hex` is the hash of its bytes. */
static json *read_document(FILE *file, char hex[STORE_HASH_SIZE])
{
    char *text = mem_alloc(REPORT_LIMIT);
    rewind(file);
    size_t length = fread(text, 1, REPORT_LIMIT, file);
    json *document = length < REPORT_LIMIT && !ferror(file) ? json_parse(text, length, NULL) : NULL;
    store_hash(text, length, hex);
    free(text);
    return document;
}

static json *read_report(const sequence_files *files, error *e)
{
    char hex[STORE_HASH_SIZE], unused[STORE_HASH_SIZE];
    json *document = read_document(files->report, hex),
         *summary = files->summary ? read_document(files->summary, unused) : NULL;
    const char *stated = json_string(json_root(json_find(summary, "/report_sha256")), hex);
    if (strcmp(stated, hex) != 0) {
        set_damaged("report.json", e);
        json_free(document);
        document = NULL;
    } else if (!document) {
        error_set(e, ERROR_INPUT_DAMAGED,
                  "the previous frame: its report.json is not a report. Check --previous.");
    }
    json_free(summary);
    return document;
}

/* The hash of points.ply that the report states; "": none. */
static void find_hash(json_at root, char hex[STORE_HASH_SIZE])
{
    json_at outputs = json_member(&root, "outputs");
    *hex = '\0';
    for (json_at o = json_first(&outputs); o.node; o = json_next(&o))
        if (strcmp(json_string(json_member(&o, "name"), ""), "points.ply") == 0)
            snprintf(hex, STORE_HASH_SIZE, "%s", json_string(json_member(&o, "sha256"), ""));
}

static bool read_numbers(sequence *s, const sequence_files *files, char points_hex[STORE_HASH_SIZE], error *e)
{
    json *document = read_report(files, e);
    if (!document) return false;
    json_at root = json_root(document), at = json_member(&root, "sequence");
    double frame = json_number(json_member(&at, "frame"), -1),
           next = json_number(json_member(&at, "next_id"), -1),
           excess = json_number(json_member(&at, "energy_excess_alone"), 0),
           eased = json_number(json_member(&at, "energy_excess_eased"), 0);
    bool good = frame >= 0 && frame <= INT32_MAX && next >= 0 && next <= UINT32_MAX;
    find_hash(root, points_hex);
    json_free(document);
    if (!good)
        return error_set(e, ERROR_INPUT_DAMAGED,
                         "the previous frame: its job is not a coherent sequence. Run it again with "
                         "queue.coherent.");
    s->previous_frame = (int)frame;
    s->next_id = (uint32_t)next;
    s->excess_alone = excess;
    s->excess_eased = eased;
    return true;
}

/* Reads points.ply while it is hashed. */
static bool read_points(sequence *s, FILE *file, const char *stated, bool beside, error *e)
{
    store_facts facts = {0};
    error fault = {0};
    late_hash *hash = late_hash_begin(fileno(file), beside);
    const bool ok = ply_read(file, &s->before, &fault) || error_prefix(&fault, "the frame before");
    if (!late_hash_end(hash, &facts, e)) return false;
    if (*stated && strcmp(stated, facts.sha256) != 0) return set_damaged("points.ply", e);
    if (!ok && e) *e = fault;
    return ok;
}

bool sequence_begin(sequence *s, int frame, const sequence_files *files, bool beside, error *e)
{
    char stated[STORE_HASH_SIZE];
    *s = (sequence){.frame = frame, .previous_frame = -1};
    if (!files) return true;
    if (!read_numbers(s, files, stated, e)) return false;
    if (s->previous_frame == frame)
        return error_set(e, ERROR_INPUT_DAMAGED,
                         "the previous frame: --previous is frame %d, the frame to be run. Give the results "
                         "of the frame before it.",
                         frame);
    if (!read_points(s, files->points, stated, beside, e)) return false;
    if (s->before.points.id && s->before.points.normal && s->before.points.count > 0) return true;
    return error_set(e, ERROR_INPUT_DAMAGED,
                     "the previous frame: its points.ply has no id or no normals. Run it again without "
                     "output.ply.properties.");
}

/* Keeps the ids of the points and their positions before and after the transfer. */
static bool remember(sequence *s, const frame_transfer *c, error *e)
{
    size_t n = c->count;
    s->died = c->died;
    if (n == 0) return true; /* the previous frame has no points: this one is treated as a first frame */
    if (!(s->start = mem_array(n, sizeof *s->start, what, e)) ||
        !(s->origin = mem_array(n, sizeof *s->origin, what, e)) ||
        !(s->id = mem_array(n, sizeof *s->id, what, e)))
        return false;
    memcpy(s->start, c->landed, n * sizeof *s->start);
    memcpy(s->origin, c->origin, n * sizeof *s->origin);
    for (size_t i = 0; i < n; i++)
        s->id[i] =
            c->parent[i] == FRAME_TRANSFER_NONE ? FRAME_TRANSFER_NONE : s->before.points.id[c->parent[i]];
    s->born = c->born;
    s->carried = n - c->born;
    s->motion = c->motion;
    return true;
}

bool sequence_transfer(sequence *s, const field *f, const surface *scan, frame_transfer_params params,
                       threads *pool, frame_transfer *out, error *e)
{
    params.previous_count = s->before.points.count;
    params.position = s->before.points.position;
    params.normal = s->before.points.normal;
    bool ok = frame_transfer_points(f, scan, &params, pool, out, e) && remember(s, out, e);
    ply_file_free(&s->before);
    return ok;
}

double sequence_max_excess(const sequence *s, size_t count)
{
    const double changes = (double)(s->born + s->died);
    if (!s->start || changes > MANY_CHANGES * (double)count) return 0;
    return fmax(MORE_DISORDER * s->excess_alone, MORE_STRAIN * s->excess_eased);
}

static bool measure_drift(sequence *s, const solver_points *p, error *e)
{
    double *drift = mem_array(p->count, sizeof *drift, what, e);
    size_t n = 0;
    if (!drift) return false;
    for (size_t i = 0; i < p->count; i++)
        if (s->id[i] != FRAME_TRANSFER_NONE)
            drift[n++] = vec3_norm(vec3_sub(p->position[i], s->start[i])) / p->spacing[i];
    qsort(drift, n, sizeof *drift, compare_doubles);
    if (n > 0) {
        s->drift_median = drift[n / 2];
        s->drift_p95 = drift[(size_t)(0.95 * (double)(n - 1))];
        s->drift_max = drift[n - 1];
    }
    free(drift);
    return true;
}

/* In a first frame, and if the surface is a different one, all points are new and have velocity 0. */
static bool begin_first(sequence *s, size_t count, error *e)
{
    if (!(s->id = mem_array(count, sizeof *s->id, what, e))) return false;
    for (size_t i = 0; i < count; i++) s->id[i] = FRAME_TRANSFER_NONE;
    s->born = count;
    return true;
}

bool sequence_end(sequence *s, const solver_points *p, error *e)
{
    double frames = s->frame - s->previous_frame;
    if (!(s->velocity = mem_array(p->count, sizeof *s->velocity, what, e))) return false;
    if (!s->start && !begin_first(s, p->count, e)) return false;
    for (size_t i = 0; s->start && i < p->count; i++) {
        if (p->replaced[i]) { /* relocated: it counts as a new point */
            s->died += s->id[i] != FRAME_TRANSFER_NONE;
            s->born += s->id[i] != FRAME_TRANSFER_NONE;
            s->carried -= s->id[i] != FRAME_TRANSFER_NONE;
            s->id[i] = FRAME_TRANSFER_NONE;
        } else
            s->velocity[i] = vec3_scale(vec3_sub(p->position[i], s->origin[i]), 1 / frames);
    }
    if (s->start && !measure_drift(s, p, e)) return false;
    if (s->born > FRAME_TRANSFER_NONE - s->next_id)
        return error_set(e, ERROR_INTERNAL, "the sequence needs more than %u point ids: split it",
                         FRAME_TRANSFER_NONE);
    for (size_t i = 0; i < p->count; i++)
        if (s->id[i] == FRAME_TRANSFER_NONE) s->id[i] = s->next_id++;
    return true;
}

static void put_vec3(json *object, const char *key, vec3 v)
{
    json *array = json_put_array(object, key);
    json_append_number(array, v.x);
    json_append_number(array, v.y);
    json_append_number(array, v.z);
}

void sequence_describe(const sequence *s, double energy_excess, bool is_eased, json *report)
{
    json *object = json_put_object(report, "sequence");
    json_put_integer(object, "frame", s->frame);
    json_put_integer(object, "next_id", s->next_id);
    json_put_number(object, "energy_excess_alone", s->start ? s->excess_alone : energy_excess);
    json_put_number(object, "energy_excess_eased", s->start && !is_eased ? s->excess_eased : energy_excess);
    if (s->previous_frame >= 0) json_put_integer(object, "previous_frame", s->previous_frame);
    json_put_integer(object, "carried", (int64_t)s->carried);
    json_put_integer(object, "born", (int64_t)s->born);
    json_put_integer(object, "died", (int64_t)s->died);
    if (!s->start) return;
    json *moved = json_put_object(object, "motion");
    put_vec3(moved, "center", s->motion.centre);
    put_vec3(moved, "translation", s->motion.translation);
    put_vec3(moved, "rotation", s->motion.rotation);
    json_put_number(moved, "scale", elementary_exp(s->motion.growth));
    json *drift = json_put_object(object, "drift");
    json_put_number(drift, "median", s->drift_median);
    json_put_number(drift, "p95", s->drift_p95);
    json_put_number(drift, "max", s->drift_max);
}

void sequence_free(sequence *s)
{
    ply_file_free(&s->before);
    free(s->start);
    free(s->origin);
    free(s->id);
    free(s->velocity);
    *s = (sequence){0};
}
