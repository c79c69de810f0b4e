#include "api/status.h"

#include <stdio.h>
#include <string.h>

#include "config.h"

#include "api/job_json.h"
#include "base/log.h"

void status_health(const http_context *c, const http_request *request, reply *r)
{
    (void)request;
    json *document = json_new_object();
    json_put_string(document, "status", executor_takes_jobs(c->x) ? "ok" : "draining");
    reply_set_json(r, 200, document);
}

/* ---- readiness: a list of conditions, each checked by its own function */

typedef struct finding {
    const char *state; /* one word, "ok" when the condition is met */
    const char *code;  /* of the problem that stops the service from accepting jobs; NULL: none */
    char detail[sizeof((error *)0)->message];
} finding;

static void look_at_jobs(const http_context *c, finding *f)
{
    if (executor_takes_jobs(c->x)) return;
    f->state = "draining";
    f->code = "unavailable";
    snprintf(f->detail, sizeof f->detail, "the service is draining and accepts no jobs");
}

static void look_at_database(const http_context *c, finding *f)
{
    health_report known;
    error e = {0};
    queue_get_health(c->q, &known);
    if (queue_allows_changes(c->q, &e)) {
        if (known.checking) f->state = "checking"; /* no damage is known */
        return;
    }
    f->state = "damaged";
    f->code = error_code_name(e.code);
    memcpy(f->detail, e.message, sizeof f->detail);
}

static void look_at_storage(const http_context *c, finding *f)
{
    executor_space space = executor_get_space(c->x);
    if (space.free_bytes >= space.floor_bytes) return;
    f->state = "full";
    f->code = "unavailable";
    snprintf(f->detail, sizeof f->detail,
             "storage_full: %lld MiB are free on the disk of state_dir; jobs start again at %lld"
             " MiB (setting free_space_mb)",
             (long long)space.free_bytes >> 20, (long long)space.floor_bytes >> 20);
}

static const struct condition {
    const char *name;
    void (*look)(const http_context *c, finding *f);
} conditions[] = {{"jobs", look_at_jobs}, {"storage", look_at_storage}, {"database", look_at_database}};

/* The worst condition comes last and is the one that is reported. */
void status_ready(const http_context *c, const http_request *request, reply *r)
{
    (void)request;
    finding worst = {0};
    json *checks = json_new_object(), *document = json_new_object();
    for (size_t i = 0; i < sizeof conditions / sizeof *conditions; i++) {
        finding f = {.state = "ok"};
        conditions[i].look(c, &f);
        json_put_string(checks, conditions[i].name, f.state);
        if (f.code) worst = f;
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

/* Writes the head of a metric in the text format of Prometheus. */
static void put_figure(FILE *text, const char *name, const char *type, const char *prose)
{
    fprintf(text, "# HELP %s %s\n# TYPE %s %s\n", name, prose, name, type);
}

static void put_jobs(const http_context *c, FILE *out)
{
    int64_t count[QUEUE_STATE_COUNT];
    if (!queue_count(c->q, count, NULL)) return; /* an unknown metric is left out */
    put_figure(out, "hexad_jobs", "gauge", "Jobs in each state.");
    for (int s = 0; s < QUEUE_STATE_COUNT; s++)
        fprintf(out, "hexad_jobs{state=\"%s\"} %lld\n", queue_state_name((queue_state)s),
                (long long)count[s]);
}

static void put_load(const http_context *c, FILE *out)
{
    executor_load load = executor_get_load(c->x);
    put_figure(out, "hexad_attempts_running", "gauge", "Running attempts.");
    fprintf(out, "hexad_attempts_running %d\n", load.attempts);
    put_figure(out, "hexad_attempts_limit", "gauge", "Attempts that may run at once.");
    fprintf(out, "hexad_attempts_limit %d\n", load.workers);
    put_figure(out, "hexad_threads_used", "gauge", "Threads of the running attempts.");
    fprintf(out, "hexad_threads_used %d\n", load.threads);
    put_figure(out, "hexad_threads_limit", "gauge", "Threads that attempts may use.");
    fprintf(out, "hexad_threads_limit %d\n", load.all_threads);
    put_figure(out, "hexad_memory_reserved_bytes", "gauge", "Memory reserved for the running attempts.");
    fprintf(out, "hexad_memory_reserved_bytes %lld\n", (long long)load.memory_mb << 20);
    put_figure(out, "hexad_memory_limit_bytes", "gauge", "Memory that attempts may use.");
    fprintf(out, "hexad_memory_limit_bytes %lld\n", (long long)load.all_memory_mb << 20);
}

static void put_database(const http_context *c, FILE *out)
{
    health_report known;
    queue_get_health(c->q, &known);
    put_figure(out, "hexad_database_damaged", "gauge", "Whether damage was found in the database.");
    fprintf(out, "hexad_database_damaged %d\n", known.damaged);
    put_figure(out, "hexad_database_last_check_timestamp_seconds", "gauge",
               "When the last check of the database ended; 0: none has ended yet.");
    fprintf(out, "hexad_database_last_check_timestamp_seconds %.3f\n", (double)known.checked_ms / 1000);
    put_figure(out, "hexad_database_last_check_duration_seconds", "gauge", "How long that check took.");
    fprintf(out, "hexad_database_last_check_duration_seconds %.3f\n", (double)known.check_took_ms / 1000);
}

static void put_storage(const http_context *c, FILE *out)
{
    executor_space space = executor_get_space(c->x);
    put_figure(out, "hexad_storage_free_bytes", "gauge",
               "Free space on the fullest disk of the state directory.");
    fprintf(out, "hexad_storage_free_bytes %lld\n", (long long)space.free_bytes);
    put_figure(out, "hexad_storage_floor_bytes", "gauge", "No job starts with less free space.");
    fprintf(out, "hexad_storage_floor_bytes %lld\n", (long long)space.floor_bytes);
}

void status_metrics(const http_context *c, const http_request *request, reply *r)
{
    (void)request;
    char *text = NULL;
    size_t size = 0;
    FILE *out = open_memstream(&text, &size);
    put_figure(out, "hexad_build_info", "gauge", "The running version.");
    fprintf(out, "hexad_build_info{version=\"%s\"} 1\n", PACKAGE_VERSION);
    put_figure(out, "hexad_start_time_seconds", "gauge", "When the service was started.");
    fprintf(out, "hexad_start_time_seconds %.3f\n", (double)c->started_ms / 1000);
    put_figure(out, "hexad_draining", "gauge", "Whether the service accepts no jobs.");
    fprintf(out, "hexad_draining %d\n", !executor_takes_jobs(c->x));
    put_jobs(c, out);
    put_load(c, out);
    put_database(c, out);
    put_storage(c, out);
    put_figure(out, "hexad_http_answers_total", "counter", "Answers, by the first digit of their status.");
    for (int i = 2; i < 6; i++)
        fprintf(out, "hexad_http_answers_total{class=\"%dxx\"} %llu\n", i,
                (unsigned long long)c->counters->answers[i]);
    put_figure(out, "hexad_http_connections", "gauge", "Open connections.");
    fprintf(out, "hexad_http_connections %llu\n", (unsigned long long)c->counters->connections);
    put_figure(out, "hexad_http_refused_connections_total", "counter",
               "Connections that were refused because of a limit.");
    fprintf(out, "hexad_http_refused_connections_total %llu\n", (unsigned long long)c->counters->refused);
    fclose(out);
    reply_set_text(r, "text/plain; version=0.0.4; charset=utf-8", text);
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
    (void)request;
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
    json *list = json_put_array(document, "workers");
    for (size_t i = 0; i < count; i++) {
        const queue_task *task = &running[i].task;
        o = json_append_object(list);
        json_put_string(o, "job", running[i].job.id);
        json_put_string(o, "owner", running[i].job.owner);
        if (task->frame != QUEUE_NO_FRAME) json_put_integer(o, "frame", task->frame);
        json_put_integer(o, "attempt", task->attempt);
        job_json_put_time(o, "started", task->started_ms);
        json_put_integer(o, "threads", running[i].job.threads);
        json_put_integer(o, "memory_mb", running[i].job.memory_mb);
    }
    queue_claimed_free(running, count);
    reply_set_json(r, 200, document);
}

static void hold(const http_context *c, const http_request *request, bool on, reply *r)
{
    executor_hold(c->x, on);
    log_write(LOG_LEVEL_INFO, "%s user=%s", on ? "drained" : "resumed", request->caller->user);
    json *document = json_new_object();
    json_put_string(document, "status", executor_takes_jobs(c->x) ? "ok" : "draining");
    json_put_integer(document, "running", executor_get_load(c->x).attempts);
    reply_set_json(r, 200, document);
}

void status_drain(const http_context *c, const http_request *request, reply *r)
{
    hold(c, request, true, r);
}

void status_resume(const http_context *c, const http_request *request, reply *r)
{
    hold(c, request, false, r);
}
