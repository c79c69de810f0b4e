// SPDX-License-Identifier: Apache-2.0
#include "service/results/audit.h"

#include <dirent.h>
#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/core/clock.h"
#include "base/core/memory.h"
#include "base/core/terminal_text.h"
#include "service/results/inventory.h"
#include "service/results/result.h"
#include "service/uploads/upload_store.h"

/* Jobs or tasks that one query reads. */
#define PAGE 500

/* Interval of progress, in ms. */
enum { PROGRESS_MS = 1000 };

typedef struct audit {
    queue *q;
    const char *work_dir;
    FILE *out;
    audit_tally *tally;
    bool contents;
    int64_t read_bytes, all_bytes; /* of results; with `contents` */
    int64_t shown_ms;              /* time of the last progress */
} audit;

/* Prints progress; on a terminal over the last one. */
static void show_progress(audit *a, bool is_last)
{
    const int64_t now = clock_monotonic_ms();
    const bool terminal = isatty(STDERR_FILENO);
    if (!a->contents || (!is_last && now - a->shown_ms < PROGRESS_MS)) return;
    a->shown_ms = now;
    if (terminal) fputc('\r', stderr);
    fprintf(stderr, "compared %zu results, %lld of about %lld MiB, and %zu uploads", a->tally->results,
            (long long)a->read_bytes >> 20, (long long)a->all_bytes >> 20, a->tally->uploads);
    if (!terminal || is_last) fputc('\n', stderr);
}

static bool compare(audit *a, const char *directory, const result *r, error *e)
{
    for (size_t i = 0; i < r->output_count; i++) a->read_bytes += r->output[i].bytes;
    return result_compare(directory, r, NULL, e);
}

static bool look_at_task(audit *a, const char *id, const queue_task *task, error *e)
{
    if (task->state != QUEUE_SUCCEEDED) return true;
    error why = {0};
    result r = {0};
    char *directory = result_directory(a->work_dir, id, task->frame);
    bool whole = result_read(directory, &r, &why) && (!a->contents || compare(a, directory, &r, &why));
    bool seen = whole || why.code != ERROR_INTERNAL;
    a->tally->results++;
    if (!whole && seen) {
        terminal_text_print(a->out, "result of %s: %s\n", strrchr(directory, '/') + 1, why.message);
        a->tally->findings++;
    }
    show_progress(a, false);
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
    a->tally->findings++;
    return true;
}

static void look_at_upload(void *context, const char *name, const error *why)
{
    audit *a = context;
    a->tally->uploads++;
    a->tally->findings += why->code != ERROR_NONE;
    if (why->code == ERROR_INPUT_DAMAGED)
        terminal_text_print(
            a->out,
            "upload %s is damaged: start hexad, run \"hexadctl delete-upload --all %s\", and send "
            "the file again\n",
            name, name);
    else if (why->code != ERROR_NONE)
        terminal_text_print(a->out, "upload %s cannot be compared: %s. Check the file and its disk\n", name,
                            why->message);
    show_progress(a, false);
}

static bool look_at_uploads(audit *a, error *e)
{
    char *directory = mem_printf("%s/inputs", a->work_dir);
    bool ok = store_inputs_compare(directory, look_at_upload, a, e);
    free(directory);
    return ok;
}

static bool look_for_strangers(audit *a, error *e)
{
    char *path = mem_printf("%s/results", a->work_dir);
    DIR *listing = opendir(path);
    struct dirent *entry = NULL;
    bool ok = listing || errno == ENOENT || error_set(e, ERROR_INTERNAL, "%s: %s", path, strerror(errno));
    while (ok && listing && (errno = 0, entry = readdir(listing)))
        if (entry->d_name[0] != '.') ok = look_at_directory(a, entry->d_name, e);
    if (ok && listing && !entry && errno) ok = error_set(e, ERROR_INTERNAL, "%s: %s", path, strerror(errno));
    if (listing) closedir(listing);
    free(path);
    return ok;
}

bool audit_results(queue *q, const char *work_dir, bool contents, FILE *out, audit_tally *tally, error *e)
{
    queue_usage usage = {0};
    audit a = {.q = q, .work_dir = work_dir, .contents = contents, .out = out, .tally = tally};
    bool ok = queue_get_usage(q, &usage, e);
    a.all_bytes = usage.all.bytes;
    free(usage.user);
    ok = ok && look_at_jobs(&a, e) && look_for_strangers(&a, e) && (!contents || look_at_uploads(&a, e));
    show_progress(&a, true);
    return ok;
}
