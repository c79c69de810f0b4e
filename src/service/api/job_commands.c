// SPDX-License-Identifier: Apache-2.0
#include "service/api/job_commands.h"

#include <stdlib.h>
#include <string.h>

#include "service/api/job_json.h"
#include "service/api/job_lookup.h"
#include "service/api/jobs.h"
#include "base/core/log.h"
#include "base/core/memory.h"
#include "service/http/parameter.h"
#include "spec/spec.h"

const char *const job_commands_patch_members[] = {"priority", "labels",      "retention_s",
                                                  "accept",   "max_running", NULL};

/* The sentence of an error that states to which jobs a command applies. */
static const char *rule_of(queue_command command)
{
    return command == QUEUE_CANCEL   ? "Cancel only jobs that have not ended"
           : command == QUEUE_PAUSE  ? "Pause only jobs that have not ended"
           : command == QUEUE_RESUME ? "Resume only paused jobs"
           : command == QUEUE_RETRY
               ? "Retry only ended jobs with tasks that did not succeed; a job that failed because of another one is "
                 "retried with that one (`hexadctl retry ID --dependents`)"
               : "Deliver only results of jobs with output.directory";
}

static void tell(const http_context *c, const http_request *request, queue_command command, const char *what,
                 reply *r)
{
    error e = {0};
    queue_job job = {0};
    bool found = false, changed = false;
    queue_state now = QUEUE_QUEUED;
    if (!job_lookup_find_own(c, request, &job, r)) return;
    bool ended = queue_state_is_final(job.state),
         wants_end = command == QUEUE_RETRY || command == QUEUE_DELIVER;
    if (!executor_apply_command(c->x, job.id, command, &found, &changed, &now, &e)) {
        reply_set_error(r, &e, NULL);
    } else if (!found) {
        job_lookup_refuse(job.id, r);
    } else if (!changed && (wants_end || ended || queue_state_is_final(now))) {
        reply_set_problem(r, "conflict", NULL, "cannot %s the job %s: its state is %s. %s.", what, job.id,
                          queue_state_name(now), rule_of(command));
    } else {
        log_write(LOG_LEVEL_INFO, "job command job=%s command=%s user=%s", job.id, what,
                  request->caller->user);
        jobs_answer(c, request, job.id, now == QUEUE_CANCELLING || command == QUEUE_DELIVER ? 202 : 200, r);
    }
    queue_job_clear(&job);
}

void job_commands_cancel(const http_context *c, const http_request *request, reply *r)
{
    tell(c, request, QUEUE_CANCEL, "cancel", r);
}

void job_commands_pause(const http_context *c, const http_request *request, reply *r)
{
    tell(c, request, QUEUE_PAUSE, "pause", r);
}

void job_commands_resume(const http_context *c, const http_request *request, reply *r)
{
    tell(c, request, QUEUE_RESUME, "resume", r);
}

/* Adds the member `dependents` to the answer: how many were retried, and which were not. Frees the lists of
 * `retried`. */
static void put_dependents(queue_retried *retried, reply *r)
{
    json *document = json_new_object();
    json_put_integer(document, "retried", (int64_t)retried->count);
    json *others = json_put_array(document, "others");
    for (size_t i = 0; i < retried->other_count; i++) json_append_string(others, retried->others[i]);
    free(retried->others);
    reply_add_member(r, "dependents", document);
}

/* Retries the job and its dependents. If the job cannot be retried (it was before), only its dependents
 * are. */
static void retry_all(const http_context *c, const http_request *request, reply *r)
{
    error e = {0};
    queue_job job = {0};
    queue_retried retried = {0};
    bool found = false, changed = false, admin = request->caller->scopes & SCOPE_ADMIN;
    queue_state now = QUEUE_QUEUED;
    if (!job_lookup_find_own(c, request, &job, r)) return;
    if (!executor_apply_command(c->x, job.id, QUEUE_RETRY, &found, &changed, &now, &e) ||
        !queue_retry_dependents(c->q, job.id, admin ? NULL : request->caller->user, &retried, &e)) {
        reply_set_error(r, &e, NULL);
    } else if (!changed && !retried.count) {
        reply_set_problem(r, "conflict", NULL, "the job %s and its dependents have no failed tasks to retry",
                          job.id);
        free(retried.others);
    } else {
        executor_wake(c->x);
        log_write(LOG_LEVEL_INFO, "job command job=%s command=retry dependents=%zu user=%s", job.id,
                  retried.count, request->caller->user);
        jobs_answer(c, request, job.id, 200, r);
        put_dependents(&retried, r);
    }
    queue_job_clear(&job);
}

void job_commands_retry(const http_context *c, const http_request *request, reply *r)
{
    if (parameter_integer(request, "dependents", 0))
        retry_all(c, request, r);
    else
        tell(c, request, QUEUE_RETRY, "retry", r);
    if (r->status == 200) jobs_wait(c, request, request->parameter[0], r);
}

void job_commands_deliver(const http_context *c, const http_request *request, reply *r)
{
    tell(c, request, QUEUE_DELIVER, "deliver", r);
}

/* Parses the members of a patch as members of the group `queue` of a spec that is valid otherwise, so that
 * the table of the spec checks them. If one is invalid, returns NULL and appends the faults to `errors`. */
static spec *read_members(json_at patch, json *errors)
{
    static const char valid[] =
        "{\"version\":1,\"surface\":{\"analytic\":{\"shape\":\"sphere\",\"radius\":1}},"
        "\"sampling\":{\"count\":4}}";
    static const char group_pointer[] = "/queue";
    spec_faults faults = {0};
    json *document = json_parse(valid, sizeof valid - 1, NULL), *group = json_put_object(document, "queue");
    for (size_t i = 0; job_commands_patch_members[i]; i++) {
        json_at at = json_member(&patch, job_commands_patch_members[i]);
        if (at.node) json_put(group, job_commands_patch_members[i], json_copy(at.node));
    }
    spec *s = spec_parse(document, &faults, NULL);
    json_free(document);
    for (size_t i = 0; i < faults.count; i++)
        reply_append_fault(errors, faults.item[i].pointer + strlen(group_pointer), faults.item[i].detail);
    return s;
}

static void check_names(json_at patch, json *errors)
{
    size_t unknown = 0;
    for (json_at member = json_first(&patch); member.node && unknown < SPEC_MAX_FAULTS;
         member = json_next(&member)) {
        char pointer[256];
        size_t k = 0;
        while (job_commands_patch_members[k] && strcmp(job_commands_patch_members[k], member.key) != 0) k++;
        if (job_commands_patch_members[k]) continue;
        unknown++;
        reply_append_fault(
            errors, json_pointer(&member, pointer, sizeof pointer),
            "cannot be changed: change only priority, labels, retention_s, accept or max_running");
    }
}

/* Reads the revision in If-Match; -1: any. If it is not an ETag of a job, sets a problem and returns
 * false. */
static bool read_match(const http_request *request, int64_t *revision, reply *r)
{
    const char *match = request->header[HTTP_IF_MATCH];
    *revision = -1;
    if (!match || strcmp(match, "*") == 0 || job_json_read_tag(match, revision)) return true;
    reply_set_problem(r, "precondition_failed", NULL,
                      "If-Match differs from the ETag of this job: get the job again and repeat the change");
    return false;
}

static void apply(const http_context *c, const http_request *request, const queue_job *job,
                  const queue_edit *edit, int64_t revision, reply *r)
{
    error e = {0};
    queue_edited edited = QUEUE_EDITED;
    if (!queue_change(c->q, job->id, revision, edit, &edited, &e)) {
        reply_set_error(r, &e, NULL);
    } else if (edited == QUEUE_NOT_THERE) {
        job_lookup_refuse(job->id, r);
    } else if (edited == QUEUE_STALE) {
        reply_set_problem(r, "precondition_failed", NULL,
                          "the job %s has changed since it was read: get it again and repeat the change",
                          job->id);
    } else {
        if (edit->priority) executor_move(c->x, job->id, *edit->priority);
        executor_wake(c->x);
        jobs_answer(c, request, job->id, 200, r);
    }
}

void job_commands_edit(const http_context *c, const http_request *request, reply *r)
{
    error e = {0};
    queue_job job = {0};
    int64_t revision = -1;
    json *errors = json_new_array(), *document = NULL;
    spec *s = NULL;
    char *labels = NULL;
    if (!job_lookup_find_own(c, request, &job, r) || !read_match(request, &revision, r)) goto done;
    document = json_parse(request->body, request->length, &e);
    if (!document) {
        reply_set_problem(r, "json_invalid", NULL, "%s", e.message);
        goto done;
    }
    json_at patch = json_root(document);
    if (json_type_of(patch) == JSON_OBJECT) {
        s = read_members(patch, errors);
        check_names(patch, errors);
    } else {
        reply_append_fault(errors, "", "must be an object");
    }
    if (json_size(json_root(errors)) > 0) {
        reply_set_problem(r, "spec_invalid", errors,
                          "the change is not valid: correct the members that `errors` lists");
        errors = NULL;
        goto done;
    }
    bool prioritised = json_member(&patch, "priority").node != NULL;
    if (prioritised && !jobs_admit_priority(c, request, s->priority, "/priority", r)) goto done;
    json_at given = json_member(&patch, "labels");
    if (given.node) labels = json_print(given.node);
    const unsigned accept = job_json_outcomes(s->accept);
    const queue_edit edit = {
        .priority = prioritised ? &s->priority : NULL,
        .labels = labels,
        .retention_s = json_member(&patch, "retention_s").node ? &s->retention_s : NULL,
        .accept = json_member(&patch, "accept").node ? &accept : NULL,
        .max_running = json_member(&patch, "max_running").node ? &s->max_running : NULL,
    };
    apply(c, request, &job, &edit, revision, r);
done:
    free(labels);
    spec_free(s);
    json_free(errors);
    json_free(document);
    queue_job_clear(&job);
}

void job_commands_delete(const http_context *c, const http_request *request, reply *r)
{
    error e = {0};
    queue_job job = {0};
    bool found = false, deleted = false;
    if (!job_lookup_find_own(c, request, &job, r)) return;
    if (!executor_delete(c->x, job.id, &found, &deleted, &e)) {
        reply_set_error(r, &e, NULL);
    } else if (!found) {
        job_lookup_refuse(job.id, r);
    } else if (!deleted) {
        reply_set_problem(r, "conflict", NULL, "the job %s has not ended: cancel it first", job.id);
    } else {
        log_write(LOG_LEVEL_INFO, "job deleted job=%s user=%s", job.id, request->caller->user);
        reply_set_empty(r, 204);
    }
    queue_job_clear(&job);
}
