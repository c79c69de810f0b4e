// SPDX-License-Identifier: Apache-2.0
#include "service/results/audit.h"

#include <dirent.h>
#include <errno.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"
#include "base/core/terminal_text.h"
#include "service/results/inventory.h"
#include "service/results/result.h"

/* Jobs or tasks that one query reads. */
#define PAGE 500

typedef struct audit {
    queue *q;
    const char *work_dir;
    FILE *out;
    size_t results, findings;
} audit;

static bool look_at_task(audit *a, const char *id, const queue_task *task, error *e)
{
    if (task->state != QUEUE_SUCCEEDED) return true;
    error why = {0};
    result r = {0};
    char *directory = result_directory(a->work_dir, id, task->frame);
    bool whole = result_read(directory, &r, &why), seen = whole || why.code != ERROR_INTERNAL;
    a->results++;
    if (!whole && seen) {
        terminal_text_print(a->out, "result of %s: %s\n", id, why.message);
        a->findings++;
    }
    result_clear(&r);
    free(directory);
    if (!seen && e) *e = why;
    return seen;
}

static bool look_at_job(audit *a, const queue_job *job, error *e)
{
    bool ok = true, more = true;
    for (int after = -1; ok && more;) {
        queue_task *tasks = NULL;
        size_t count = 0;
        ok = queue_list_tasks(a->q, job->id, after, PAGE, &tasks, &count, e);
        for (size_t i = 0; ok && i < count; i++) ok = look_at_task(a, job->id, &tasks[i], e);
        more = count == PAGE;
        if (count) after = tasks[count - 1].number;
        queue_tasks_free(tasks, count);
    }
    return ok;
}

static bool look_at_jobs(audit *a, error *e)
{
    queue_filter filter = {.state = -1, .limit = PAGE};
    bool ok = true, more = true;
    while (ok && more) {
        queue_job *jobs = NULL;
        size_t count = 0;
        ok = queue_list(a->q, &filter, &jobs, &count, e);
        for (size_t i = 0; ok && i < count; i++)
            if (jobs[i].tasks.succeeded) ok = look_at_job(a, &jobs[i], e);
        more = count == PAGE;
        if (count) filter.after_seq = jobs[count - 1].seq;
        queue_jobs_free(jobs, count);
    }
    return ok;
}

static bool look_at_directory(audit *a, const char *name, error *e)
{
    queue_directory d;
    if (inventory_read_name(name, &d)) {
        if (!queue_find_directories(a->q, &d, 1, e)) return false;
        if (d.known || d.to_be_removed) return true;
    }
    terminal_text_print(a->out, "results/%s: no such job in the queue\n", name);
    a->findings++;
    return true;
}

static bool look_for_strangers(audit *a, error *e)
{
    char *path = mem_printf("%s/results", a->work_dir);
    DIR *listing = opendir(path);
    bool ok = listing || errno == ENOENT || error_set(e, ERROR_INTERNAL, "%s: %s", path, strerror(errno));
    for (struct dirent *entry; ok && listing && (entry = readdir(listing));)
        if (entry->d_name[0] != '.') ok = look_at_directory(a, entry->d_name, e);
    if (listing) closedir(listing);
    free(path);
    return ok;
}

bool audit_results(queue *q, const char *work_dir, FILE *out, size_t *results, size_t *findings, error *e)
{
    audit a = {.q = q, .work_dir = work_dir, .out = out};
    bool ok = look_at_jobs(&a, e) && look_for_strangers(&a, e);
    *results += a.results;
    *findings += a.findings;
    return ok;
}
