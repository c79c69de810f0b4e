// SPDX-License-Identifier: Apache-2.0
#include "service/api/job_picture.h"

#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

#include "service/api/job_lookup.h"
#include "service/api/png_reply.h"
#include "service/api/thumbnail_process.h"
#include "base/core/build_part.h"
#include "base/core/clock.h"
#include "base/core/memory.h"
#include "base/core/worker_contract.h"
#include "io/pictures/contact_sheet.h"
#include "service/results/result.h"

/* Tasks that one query reads. */
enum { TASKS_PAGE = 1000 };
/* Time limit for reading all previews of a sheet, in milliseconds: hexadctl gives up after 60 s without a
 * byte. */
enum { DRAW_MS = 20000 };

typedef struct frames {
    int *item;
    size_t count;
} frames;

static void add_succeeded(frames *f, const queue_task *tasks, size_t count)
{
    f->item = mem_resize(f->item, (f->count + count) * sizeof *f->item);
    for (size_t i = 0; i < count; i++)
        if (tasks[i].state == QUEUE_SUCCEEDED) f->item[f->count++] = tasks[i].frame;
}

/* Lists the frames that have succeeded; f->item must be freed, also after an error. */
static bool list_frames(queue *q, const char *id, frames *f, error *e)
{
    for (int after = -1;;) {
        queue_task *tasks = NULL;
        size_t count = 0;
        if (!queue_list_tasks(q, id, after, TASKS_PAGE, &tasks, &count, e)) return false;
        if (count) {
            add_succeeded(f, tasks, count);
            after = tasks[count - 1].number;
        }
        queue_tasks_free(tasks, count);
        if (count < TASKS_PAGE) return true;
    }
}

static int open_preview(const http_context *c, const char *id, int frame, int64_t *bytes)
{
    char *directory = result_directory(c->work_dir, id, frame);
    int fd = result_open_file(directory, WORKER_PREVIEW_NAME, bytes, NULL);
    free(directory);
    return fd;
}

static bool read_thumbnail(const http_context *c, const char *id, int frame, int64_t until_ms, thumbnail *out,
                           error *e)
{
    char *directory = result_directory(c->work_dir, id, frame);
    bool ok = thumbnail_process_read(c, directory, until_ms, out, e);
    free(directory);
    return ok;
}

/* Numbers of frames of a sheet. */
typedef struct drawing {
    int shown, drawn; /* frames on the sheet; frames whose picture was drawn */
    int late;         /* frames whose preview was not read before the time limit or the stop of the service */
} drawing;

static void draw(const http_context *c, const queue_job *job, const frames *f, contact_sheet *sheet,
                 drawing *d)
{
    const int64_t until_ms = clock_monotonic_ms() + DRAW_MS;
    thumbnail *picture = mem_alloc(sizeof *picture);
    for (int i = 0; i < d->shown; i++) {
        size_t at = d->shown > 1 ? (size_t)i * (f->count - 1) / (size_t)(d->shown - 1) : 0;
        error e = {0};
        bool has = read_thumbnail(c, job->id, f->item[at], until_ms, picture, &e);
        contact_sheet_put(sheet, i, has ? picture : NULL, f->item[at]);
        d->drawn += has;
        d->late += e.code == ERROR_LIMIT_TIME;
    }
    free(picture);
}

static void put_title(contact_sheet *sheet, const drawing *d, int all)
{
    char title[96];
    if (d->late)
        snprintf(title, sizeof title, "%d of %d frames; %d were not read in time", d->shown, all, d->late);
    else
        snprintf(title, sizeof title, "%d of %d frames", d->shown, all);
    contact_sheet_put_title(sheet, title);
}

static void send_frames(const http_context *c, const queue_job *job, reply *r)
{
    error e = {0};
    frames f = {0};
    contact_sheet *sheet = NULL;
    if (build_part_missing(BUILD_PART_PREVIEW)) {
        reply_set_problem(r, "not_supported", NULL, "%s", build_part_missing(BUILD_PART_PREVIEW));
        return;
    }
    bool ok = list_frames(c->q, job->id, &f, &e);
    drawing d = {.shown = f.count < CONTACT_SHEET_MOST ? (int)f.count : CONTACT_SHEET_MOST};
    if (ok && d.shown) {
        sheet = contact_sheet_new(d.shown);
        draw(c, job, &f, sheet, &d);
        put_title(sheet, &d, job->tasks.all);
    }
    if (ok && d.late && wait_list_is_dismissed(c->waiting))
        reply_set_unavailable(r, "the service is stopping");
    else if (ok && !d.drawn && d.late)
        reply_set_unavailable(r, "no preview was read in time; try again later");
    else if (ok && !d.drawn)
        reply_set_problem(r, "not_found", NULL, "no frame of the job %s has a " WORKER_PREVIEW_NAME, job->id);
    else if (!ok || !png_reply_set(r, &sheet->canvas, &e))
        reply_set_error(r, &e, NULL);
    contact_sheet_free(sheet);
    free(f.item);
}

static void send_preview(const http_context *c, const queue_job *job, reply *r)
{
    int64_t bytes = 0;
    int fd = job->state == QUEUE_SUCCEEDED ? open_preview(c, job->id, QUEUE_NO_FRAME, &bytes) : -1;
    if (fd >= 0)
        reply_set_file(r, "image/png", fd, bytes);
    else
        reply_set_problem(r, "not_found", NULL, "the job %s has no " WORKER_PREVIEW_NAME, job->id);
}

void job_picture_send(const http_context *c, const http_request *request, reply *r)
{
    queue_job job = {0};
    if (!job_lookup_find_own(c, request, &job, r)) return;
    if (job.array)
        send_frames(c, &job, r);
    else
        send_preview(c, &job, r);
    queue_job_clear(&job);
}
