// SPDX-License-Identifier: Apache-2.0
#include "service/api/status.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "config.h"

#include "service/api/job_json.h"
#include "base/core/log.h"

void status_health(const http_context *c, const http_request *request, reply *r)
{
    (void)request;
    json *document = json_new_object();
    json_put_string(document, "status", executor_takes_jobs(c->x) ? "ok" : "draining");
    reply_set_json(r, 200, document);
}

/* ---- readiness: a list of conditions, each checked by its own function */

typedef struct condition_report {
    const char *state; /* one word, "ok" if the condition is met */
    const char *code;  /* code of the problem; NULL: the service accepts jobs nevertheless */
    char detail[sizeof((error *)0)->message];
} condition_report;

static void look_at_jobs(const http_context *c, condition_report *out)
{
    if (executor_takes_jobs(c->x)) return;
    out->state = "draining";
    out->code = "unavailable";
    snprintf(
        out->detail, sizeof out->detail,
        executor_is_draining(c->x)
            ? "the service is stopping and accepts no jobs"
            : "an administrator drained the service, which accepts no jobs until it is restarted: run hexadctl undrain");
}

/* A held queue does not prevent the service from accepting jobs. */
static void look_at_queue(const http_context *c, condition_report *out)
{
    bool held = false;
    if (queue_is_held(c->q, &held, NULL) && held) out->state = "held";
}

static void look_at_database(const http_context *c, condition_report *out)
{
    health_report known;
    error e = {0};
    queue_get_health(c->q, &known);
    if (queue_allows_changes(c->q, &e)) {
        if (known.checking) out->state = "checking"; /* no damage is known */
        return;
    }
    out->state = "damaged";
    out->code = error_code_name(e.code);
    memcpy(out->detail, e.message, sizeof out->detail);
}

static void look_at_state(const http_context *c, condition_report *out)
{
    error e = {0};
    if (queue_has_place(c->q, &e)) return;
    out->state = "lost";
    out->code = error_code_name(e.code);
    memcpy(out->detail, e.message, sizeof out->detail);
}

static void look_at_storage(const http_context *c, condition_report *out)
{
    error e = {0};
    executor_space space = executor_get_space(c->x);
    bool full = space.free_bytes < space.floor_bytes;
    if (!full && executor_can_write(c->x, &e)) return;
    out->state = full ? "full" : "unwritable";
    out->code = "unavailable";
    if (!full)
        snprintf(out->detail, sizeof out->detail, "%.900s. Jobs are accepted and wait meanwhile", e.message);
    else
        snprintf(
            out->detail, sizeof out->detail,
            "storage_full: %lld MiB are free on the disk of %s, and no job starts below %lld MiB (setting "
            "free_space_mb): delete files or jobs",
            (long long)space.free_bytes >> 20, space.directory, (long long)space.floor_bytes >> 20);
}

static void look_at_results(const http_context *c, condition_report *out)
{
    queue_usage usage;
    if (!queue_get_usage(c->q, &usage, NULL)) return;
    free(usage.user);
    if (!usage.full) return;
    out->state = "full";
    out->code = "unavailable";
    snprintf(
        out->detail, sizeof out->detail,
        "results_full: the results of all users have reached their bound (setting results_mb or results_count), "
        "and none that was fetched is left to delete: fetch results, so that hexad may delete them");
}

/* An unwritable output root does not prevent readiness: jobs without output.directory can run. */
static void look_at_outputs(const http_context *c, condition_report *out)
{
    if (output_place_unwritable(c->outputs)) out->state = "unwritable";
}

/* Without tokens the service accepts jobs from the users of the Unix socket. */
static void look_at_tokens(const http_context *c, condition_report *out)
{
    if (!access_can_read_tokens(c->access)) out->state = "unreadable";
}

static const struct condition {
    const char *name;
    void (*look)(const http_context *c, condition_report *out);
} conditions[] = {{"jobs", look_at_jobs},         {"queue", look_at_queue},     {"tokens", look_at_tokens},
                  {"outputs", look_at_outputs},   {"results", look_at_results}, {"storage", look_at_storage},
                  {"database", look_at_database}, {"state", look_at_state}};

/* Reports all conditions. The conditions are in the order of severity, so the code of the last failed one is
 * reported. */
void status_ready(const http_context *c, const http_request *request, reply *r)
{
    (void)request;
    condition_report worst = {0};
    json *checks = json_new_object(), *document = json_new_object();
    for (size_t i = 0; i < sizeof conditions / sizeof *conditions; i++) {
        condition_report report = {.state = "ok"};
        conditions[i].look(c, &report);
        json_put_string(checks, conditions[i].name, report.state);
        if (report.code) worst = report;
    }
    if (!worst.code) {
        json_put_string(document, "status", "ok");
        reply_set_json(r, 200, document);
    } else {
        json_free(document);
        if (strcmp(worst.code, "unavailable") == 0)
            reply_set_unavailable(r, worst.detail);
        else
            reply_set_problem(r, worst.code, NULL, "%s", worst.detail);
    }
    reply_add_member(r, "checks", checks);
}

void status_version(const http_context *c, const http_request *request, reply *r)
{
    (void)c;
    (void)request;
    json *document = json_new_object();
    json_put_string(document, "name", PACKAGE_NAME);
    json_put_string(document, "version", PACKAGE_VERSION);
    json_put_string(document, "api", "v1");
    reply_set_json(r, 200, document);
}

void status_workers(const http_context *c, const http_request *request, reply *r)
{
    error e = {0};
    queue_claimed *running = NULL;
    size_t count = 0;
    if (!queue_list_unsettled(c->q, &running, &count, &e)) {
        reply_set_error(r, &e, NULL);
        return;
    }
    executor_load load = executor_get_load(c->x);
    json *document = json_new_object(), *o = json_put_object(document, "load");
    json_put_integer(o, "attempts", load.attempts);
    json_put_integer(o, "attempts_limit", load.workers);
    json_put_integer(o, "threads", load.threads);
    json_put_integer(o, "threads_limit", load.all_threads);
    json_put_integer(o, "memory_mb", load.memory_mb);
    json_put_integer(o, "memory_mb_limit", load.all_memory_mb);
    if (load.most_of_owner)
        json_put_integer(o, "user_running", load.most_of_owner);
    else
        json_put_null(o, "user_running");
    json *list = json_put_array(document, "workers");
    for (size_t i = 0; i < count; i++) {
        char host[ENGINE_HOST_SIZE];
        bool known = executor_find_host(c->x, running[i].job.id, running[i].task.number, host);
        job_json_append_worker(list, &running[i], job_json_viewer_of(request->caller, running[i].job.owner),
                               known ? host : NULL);
    }
    queue_claimed_free(running, count);
    reply_set_json(r, 200, document);
}

static void put_limit(json *o, const char *key, int64_t limit)
{
    if (limit == INT64_MAX)
        json_put_null(o, key);
    else
        json_put_integer(o, key, limit);
}

static void put_sum(json *o, const queue_sum *sum, const queue_sum *limit)
{
    json_put_integer(o, "bytes", sum->bytes);
    put_limit(o, "bytes_limit", limit->bytes);
    json_put_integer(o, "results", sum->results);
    put_limit(o, "results_limit", limit->results);
}

/* Appends what a user holds. */
static void append_user(const http_context *c, const char *user, const queue_sum *sum, const queue_sum *limit,
                        json *list)
{
    json *o = json_append_object(list);
    const int64_t most = ledger_get_limits(c->counts, LEDGER_UPLOAD_BYTES).holder;
    json_put_string(o, "user", user);
    put_sum(o, sum, limit);
    json_put_integer(o, "upload_bytes", store_inputs_count_bytes(c->inputs, user));
    put_limit(o, "upload_bytes_limit", most ? most : INT64_MAX);
}

void status_usage(const http_context *c, const http_request *request, reply *r)
{
    error e = {0};
    queue_usage usage;
    const char *caller = request->caller->user;
    const store_inputs_space uploads = store_inputs_get_space(c->inputs);
    if (!queue_get_usage(c->q, &usage, &e)) {
        reply_set_error(r, &e, NULL);
        return;
    }
    json *document = json_new_object(), *all = json_put_object(document, "all");
    put_sum(all, &usage.all, &usage.bounds.all);
    json_put_integer(all, "upload_bytes", uploads.used_bytes);
    json_put_integer(all, "upload_bytes_limit", uploads.limit_bytes);
    json_put_bool(document, "full", usage.full);
    json *list = json_put_array(document, "users");
    bool listed = false;
    for (size_t i = 0; i < usage.count; i++) {
        listed = listed || strcmp(usage.user[i].name, caller) == 0;
        append_user(c, usage.user[i].name, &usage.user[i].sum, &usage.bounds.user, list);
    }
    if (!listed && store_inputs_count_bytes(c->inputs, caller) > 0)
        append_user(c, caller, &(queue_sum){0}, &usage.bounds.user, list);
    free(usage.user);
    reply_set_json(r, 200, document);
}

static void append_token(void *context, const token *t)
{
    json *o = json_append_object(context), *scopes;
    json_put_string(o, "id", t->id);
    json_put_string(o, "user", t->user);
    scopes = json_put_array(o, "scopes");
    for (unsigned scope = SCOPE_READ; scope <= SCOPE_ADMIN; scope *= 2)
        if (t->scopes & scope) json_append_string(scopes, scope_name(scope));
    job_json_put_time(o, "created", t->created_ms);
    if (t->max_priority == TOKEN_ANY_PRIORITY)
        json_put_null(o, "max_priority");
    else
        json_put_integer(o, "max_priority", t->max_priority);
}

void status_tokens(const http_context *c, const http_request *request, reply *r)
{
    (void)request;
    json *document = json_new_object();
    access_list_tokens(c->access, append_token, json_put_array(document, "tokens"));
    reply_set_json(r, 200, document);
}

static void drain(const http_context *c, const http_request *request, bool on, reply *r)
{
    executor_close(c->x, on);
    log_write(LOG_LEVEL_INFO, "%s user=%s", on ? "drained" : "resumed", request->caller->user);
    json *document = json_new_object();
    json_put_string(document, "status", executor_takes_jobs(c->x) ? "ok" : "draining");
    json_put_integer(document, "running", executor_get_load(c->x).attempts);
    reply_set_json(r, 200, document);
}

void status_drain(const http_context *c, const http_request *request, reply *r)
{
    drain(c, request, true, r);
}

void status_resume(const http_context *c, const http_request *request, reply *r)
{
    drain(c, request, false, r);
}

static void hold(const http_context *c, const http_request *request, bool on, reply *r)
{
    error e = {0};
    if (!queue_hold(c->q, on, &e)) {
        reply_set_error(r, &e, NULL);
        return;
    }
    executor_wake(c->x);
    log_write(LOG_LEVEL_INFO, "queue %s user=%s", on ? "held" : "released", request->caller->user);
    json *document = json_new_object();
    json_put_bool(document, "held", on);
    json_put_integer(document, "running", executor_get_load(c->x).attempts);
    reply_set_json(r, 200, document);
}

void status_hold(const http_context *c, const http_request *request, reply *r)
{
    hold(c, request, true, r);
}

void status_release(const http_context *c, const http_request *request, reply *r)
{
    hold(c, request, false, r);
}
