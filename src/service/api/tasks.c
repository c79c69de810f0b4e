// SPDX-License-Identifier: Apache-2.0
#include "service/api/tasks.h"

#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "service/api/job_json.h"
#include "service/api/job_lookup.h"
#include "base/core/memory.h"
#include "base/core/worker_contract.h"
#include "service/http/parameter.h"
#include "service/results/result.h"

#define PAGE_DEFAULT 50 /* elements of a page without `limit`; parameters.c documents the same number */

void tasks_list(const http_context *c, const http_request *request, reply *r)
{
    error e = {0};
    queue_job job = {0};
    queue_task *tasks = NULL;
    size_t count = 0, limit = (size_t)parameter_integer(request, "limit", PAGE_DEFAULT);
    int after = (int)parameter_integer(request, "after", -1);
    if (!job_lookup_find_own(c, request, &job, r)) return;
    if (!queue_list_tasks(c->q, job.id, after, (int)limit + 1, &tasks, &count, &e)) {
        reply_set_error(r, &e, NULL);
    } else {
        json *document = json_new_object(), *list = json_put_array(document, "tasks");
        for (size_t i = 0; i < count && i < limit; i++)
            job_json_put_notes(job_json_append_task(list, &tasks[i], c->inputs, request->caller->user),
                               c->work_dir, job.id, tasks[i].frame, tasks[i].state == QUEUE_SUCCEEDED);
        if (count > limit)
            json_put_integer(document, "next", tasks[limit - 1].number);
        else
            json_put_null(document, "next");
        reply_set_json(r, 200, document);
    }
    queue_tasks_free(tasks, count);
    queue_job_clear(&job);
}

/* The parameter `after` of a list of attempts is task * ATTEMPTS_OF_A_TASK + number of the attempt. */
#define ATTEMPTS_OF_A_TASK ((int64_t)1 << 31)

void tasks_list_attempts(const http_context *c, const http_request *request, reply *r)
{
    error e = {0};
    queue_job job = {0};
    queue_attempt *attempts = NULL;
    size_t count = 0, limit = (size_t)parameter_integer(request, "limit", PAGE_DEFAULT);
    int64_t after = parameter_integer(request, "after", 0);
    if (!job_lookup_find_own(c, request, &job, r)) return;
    if (!queue_list_attempts(c->q, job.id, (int)(after / ATTEMPTS_OF_A_TASK),
                             (int)(after % ATTEMPTS_OF_A_TASK), (int)limit + 1, &attempts, &count, &e)) {
        reply_set_error(r, &e, NULL);
    } else {
        json *document = json_new_object(), *list = json_put_array(document, "attempts");
        for (size_t i = 0; i < count && i < limit; i++) job_json_append_attempt(list, &job, &attempts[i]);
        if (count > limit)
            json_put_integer(document, "next",
                             attempts[limit - 1].task * ATTEMPTS_OF_A_TASK + attempts[limit - 1].number);
        else
            json_put_null(document, "next");
        reply_set_json(r, 200, document);
    }
    queue_attempts_free(attempts, count);
    queue_job_clear(&job);
}

/* Opens the log of an attempt: in its directory or, if the attempt gave the result, in the directory of
 * the result. */
static int open_log(const http_context *c, const queue_job *job, int frame, int attempt, int64_t *bytes)
{
    char *own = result_attempt_directory(c->work_dir, job->id, frame, attempt);
    char *kept = result_directory(c->work_dir, job->id, frame);
    int fd = result_open_file(own, "worker.log", bytes, NULL);
    if (fd < 0) fd = result_open_file(kept, "worker.log", bytes, NULL);
    free(own);
    free(kept);
    return fd;
}

/* Reads the query parameters `frame`, which an array requires, and `attempt`; without it, the last
 * attempt. *attempt is 0 if the attempt does not exist. On failure sets a problem and returns false. */
static bool choose_attempt(const http_context *c, const http_request *request, const queue_job *job,
                           int *frame, int *attempt, reply *r)
{
    error e = {0};
    bool found = false;
    queue_task *tasks = NULL, task = {0};
    size_t count = 0;
    *frame = (int)parameter_integer(request, "frame", QUEUE_NO_FRAME);
    if (job->array && *frame == QUEUE_NO_FRAME) {
        reply_set_problem(r, "request_invalid", NULL,
                          "the job %s has frames: choose one (query parameter frame, option --frame)",
                          job->id);
        return false;
    }
    if (*frame != QUEUE_NO_FRAME) {
        if (!queue_get_frame(c->q, job->id, *frame, &task, &found, &e)) goto failed;
        if (!found) {
            reply_set_problem(r, "not_found", NULL,
                              "the job %s has no frame %d: choose one of its queue.frames", job->id, *frame);
            return false;
        }
    } else {
        if (!queue_list_tasks(c->q, job->id, -1, 1, &tasks, &count, &e)) goto failed;
        found = count > 0;
    }
    int last = count ? tasks[0].attempt : task.attempt;
    *attempt = found ? (int)parameter_integer(request, "attempt", last) : 0;
    if (*attempt > last) *attempt = 0;
    queue_tasks_free(tasks, count);
    queue_task_clear(&task);
    return true;
failed:
    reply_set_error(r, &e, NULL);
    return false;
}

/* Answers that there is no log of the attempt; 0: the attempt does not exist. */
static void refuse_log(const queue_job *job, int attempt, job_json_viewer viewer, reply *r)
{
    const char *from = job_json_cached_from(job, viewer);
    if (attempt > 0 && from)
        reply_set_problem(
            r, "not_found", NULL,
            "the job %s has no log: it was given the result of the equal job %s. Read the log of that job.",
            job->id, from);
    else if (attempt > 0 && job->cached_from)
        reply_set_problem(
            r, "not_found", NULL,
            "the job %s has no log: it was given the result of an equal job. A job with another "
            "solver.seed computes its own.",
            job->id);
    else
        reply_set_problem(r, "not_found", NULL,
                          "the job %s has no log: the attempt has not started, or its log was removed. List "
                          "the attempts of the job.",
                          job->id);
}

void tasks_show_log(const http_context *c, const http_request *request, reply *r)
{
    queue_job job = {0};
    int frame = QUEUE_NO_FRAME, attempt = 0;
    int64_t bytes = 0;
    if (!job_lookup_find_own(c, request, &job, r)) return;
    if (choose_attempt(c, request, &job, &frame, &attempt, r)) {
        int fd = attempt > 0 ? open_log(c, &job, frame, attempt, &bytes) : -1;
        if (fd >= 0)
            reply_set_file(r, "text/plain", fd, bytes);
        else
            refuse_log(&job, attempt, job_json_viewer_of(request->caller, job.owner), r);
    }
    queue_job_clear(&job);
}

/* The worker removes the snapshot before its attempt ends, so it exists only while the attempt runs. */
void tasks_send_snapshot(const http_context *c, const http_request *request, reply *r)
{
    queue_job job = {0};
    int frame = QUEUE_NO_FRAME, attempt = 0;
    int64_t bytes = 0;
    if (!job_lookup_find_own(c, request, &job, r)) return;
    if (choose_attempt(c, request, &job, &frame, &attempt, r)) {
        char *directory = result_attempt_directory(c->work_dir, job.id, frame, attempt);
        int fd = attempt > 0 ? result_open_file(directory, WORKER_SNAPSHOT_NAME, &bytes, NULL) : -1;
        if (fd >= 0)
            reply_set_file(r, "model/ply", fd, bytes);
        else
            reply_set_problem(
                r, "not_found", NULL,
                "the job %s has no snapshot: no attempt is relaxing points, or it started less than "
                "2 s ago. Try again later.",
                job.id);
        free(directory);
    }
    queue_job_clear(&job);
}
