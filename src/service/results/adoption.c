// SPDX-License-Identifier: Apache-2.0
#include "service/results/adoption.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "base/core/log.h"
#include "base/core/memory.h"
#include "base/core/worker_contract.h"
#include "base/json/json.h"
#include "service/results/result.h"
#include "files/file.h"

/* Jobs that one transaction adds to the queue. */
#define AT_ONCE 100

static void clear(queue_adoption *j)
{
    free(j->name);
    free(j->labels);
    free(j->spec);
    for (size_t i = 0; i < j->task_count; i++) free(j->tasks[i].file);
    free(j->tasks);
    *j = (queue_adoption){0};
}

static char *copy_labels(json_at asked)
{
    json *labels = json_new_array();
    json_at list = json_member(&asked, "labels");
    for (json_at element = json_first(&list); element.node; element = json_next(&element)) {
        const char *label = json_string(element, NULL);
        if (label) json_append_string(labels, label);
    }
    char *text = json_print(labels);
    json_free(labels);
    return text;
}

/* The whole part of a number in a report; `otherwise` if it is missing, not a number or outside of [least,
 * most]. */
static int64_t integer_of(json_at object, const char *key, int64_t least, int64_t most, int64_t otherwise)
{
    double number = json_number(json_member(&object, key), (double)otherwise);
    return number >= (double)least && number <= (double)most ? (int64_t)number : otherwise;
}

/* Whether a file of the result has several hard links, so that another job may share it. */
static bool is_shared(const char *directory, const result *r)
{
    struct stat info;
    bool shared = false;
    for (size_t i = 0; !shared && i <= r->output_count; i++) {
        const char *name = i < r->output_count ? r->output[i].name : WORKER_REPORT_NAME;
        char *path = mem_printf("%s/%s", directory, name);
        shared = lstat(path, &info) == 0 && info.st_nlink > 1;
        free(path);
    }
    return shared;
}

/* Removes members that may belong to another user: jobs share the result, and the report does not name its
 * job. */
static void remove_job_data(json *spec)
{
    static const char *const private[][2] = {
        {"", "name"}, {"/queue", "labels"}, {"/queue", "webhook"}, {"/output", "directory"}};
    for (size_t i = 0; i < sizeof private / sizeof *private; i++) {
        json *group = json_find(spec, private[i][0]);
        if (group) json_remove(group, private[i][1]);
    }
}

/* Moves the name of the frame's file from the spec of a report to *file, which the caller frees. */
static void take_file(json *report, char **file)
{
    const char *name = json_string(json_root(json_find(report, "/spec/queue/files/0")), NULL);
    if (!name) return;
    *file = mem_strdup(name);
    json_remove(json_find(report, "/spec/queue"), "files");
}

/* Reads the job from the report of a directory, unless an earlier frame gave it. *finished_ms: when the
 * report was written (wall clock). False if the report has no spec. */
static bool take_report(const char *directory, json *report, bool shared, queue_adoption *j,
                        int64_t *finished_ms)
{
    struct stat info;
    char *path = mem_printf("%s/" WORKER_REPORT_NAME, directory);
    json_at root = json_root(report), spec = json_member(&root, "spec");
    bool ok = stat(path, &info) == 0 && json_type_of(spec) == JSON_OBJECT;
    if (ok && shared) remove_job_data(json_find(report, "/spec"));
    if (ok) *finished_ms = (int64_t)info.st_mtim.tv_sec * 1000 + info.st_mtim.tv_nsec / 1000000;
    if (ok && !j->spec) {
        json_at limits = json_member(&spec, "limits"), asked = json_member(&spec, "queue");
        const char *name = json_string(json_member(&spec, "name"), NULL);
        j->name = name ? mem_strdup(name) : NULL;
        j->labels = copy_labels(asked);
        j->spec = json_print(spec.node);
        j->priority = (int)integer_of(asked, "priority", INT32_MIN, INT32_MAX, 0);
        j->max_attempts = (int)integer_of(limits, "max_attempts", 1, INT32_MAX, 1);
        j->threads = (int)integer_of(root, "threads", 1, INT32_MAX, 1);
        j->memory_mb = integer_of(limits, "memory_mb", 0, INT32_MAX, 0);
    }
    free(path);
    return ok;
}

/* Adds the result to the job if it is complete and its directory is not a symbolic link. Otherwise logs a
 * warning. */
static bool add_task(const char *work_dir, const queue_directory *found, queue_adoption *j)
{
    struct stat info;
    result r = {0};
    error why = {0};
    queue_adopted_task task = {.frame = found->frame};
    char *directory = result_directory(work_dir, found->id, found->frame);
    json *report = lstat(directory, &info) == 0 && S_ISDIR(info.st_mode)
                       ? result_read_report(directory, &r, &why)
                       : NULL;
    if (report) take_file(report, &task.file);
    bool ok = report && result_compare_at_start(directory, &r, &why) &&
              take_report(directory, report, is_shared(directory, &r), j, &task.finished_ms);
    if (ok) {
        task.outcome = r.outcome;
        j->tasks = mem_resize(j->tasks, (j->task_count + 1) * sizeof *j->tasks);
        j->tasks[j->task_count++] = task;
    } else {
        free(task.file);
        log_write(LOG_LEVEL_WARNING, "cannot adopt a result: %s: %s", directory,
                  *why.message ? why.message : "it is not a directory, or its report has no spec");
    }
    json_free(report);
    result_clear(&r);
    free(directory);
    return ok;
}

static bool put(queue *q, queue_adoption *jobs, size_t *count, size_t *adopted, error *e)
{
    bool ok = !*count || queue_adopt(q, jobs, *count, e);
    if (ok) *adopted += *count;
    for (size_t i = 0; i < *count; i++) clear(&jobs[i]);
    *count = 0;
    return ok;
}

/* Whether a result belongs to the job of the first result with its id. If the first one has no frame, the job
 * is not an array, and results of frames with the same id do not belong to it. */
static bool belongs(const queue_directory *first, const queue_directory *d)
{
    return strcmp(first->id, d->id) == 0 && (first == d || first->frame != QUEUE_NO_FRAME);
}

bool adoption_run(queue *q, const char *work_dir, const queue_directory *results, size_t count,
                  size_t *adopted, error *e)
{
    queue_adoption jobs[AT_ONCE] = {0};
    size_t used = 0, next = 0;
    bool ok = true;
    *adopted = 0;
    for (size_t i = 0; ok && i < count; i = next) {
        queue_adoption *j = &jobs[used];
        bool unknown = *results[i].id; /* otherwise the name has another form */
        for (next = i; next < count && strcmp(results[i].id, results[next].id) == 0; next++)
            unknown &= !results[next].known && !results[next].to_be_removed;
        /* if the job is in the queue, its unknown frames are not adopted */
        for (size_t k = i; unknown && k < next; k++)
            if (belongs(&results[i], &results[k])) add_task(work_dir, &results[k], j);
        if (!j->task_count) {
            clear(j);
            continue;
        }
        snprintf(j->id, sizeof j->id, "%s", results[i].id);
        if (++used == AT_ONCE) ok = put(q, jobs, &used, adopted, e);
    }
    return ok && put(q, jobs, &used, adopted, e);
}
