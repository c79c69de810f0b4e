// SPDX-License-Identifier: Apache-2.0
#include "service/api/metrics.h"

#include <stdio.h>
#include <stdlib.h>

#include "config.h"

#include "base/core/clock.h"

/* Writes the lines HELP and TYPE, which precede the values of a metric. */
static void put_head(FILE *out, const char *name, const char *type, const char *prose)
{
    fprintf(out, "# HELP %s %s\n# TYPE %s %s\n", name, prose, name, type);
}

static void put_gauge(FILE *out, const char *name, const char *prose, int64_t value)
{
    put_head(out, name, "gauge", prose);
    fprintf(out, "%s %lld\n", name, (long long)value);
}

static void put_seconds(FILE *out, const char *name, const char *prose, int64_t value_ms)
{
    put_head(out, name, "gauge", prose);
    fprintf(out, "%s %.3f\n", name, clock_seconds(value_ms));
}

static void put_counter(FILE *out, const char *name, const char *prose, uint_fast64_t value)
{
    put_head(out, name, "counter", prose);
    fprintf(out, "%s %llu\n", name, (unsigned long long)value);
}

static void put_histogram(FILE *out, const char *name, const char *prose, const histogram *h)
{
    unsigned long long all = 0;
    put_head(out, name, "histogram", prose);
    for (int i = 0; i < HISTOGRAM_BOUNDS; i++)
        fprintf(out, "%s_bucket{le=\"%g\"} %llu\n", name, histogram_bounds_s[i], all += h->count[i]);
    all += h->count[HISTOGRAM_BOUNDS];
    fprintf(out, "%s_bucket{le=\"+Inf\"} %llu\n%s_sum %.3f\n%s_count %llu\n", name, all, name,
            clock_seconds(h->sum_ms), name, all);
}

/* Milliseconds since a time of the wall clock. 0 for a time of 0, and if the clock was set back. */
static int64_t age_ms(int64_t wall_ms)
{
    int64_t age = clock_wall_ms() - wall_ms;
    return wall_ms && age > 0 ? age : 0;
}

static void put_service(const http_context *c, FILE *out)
{
    put_head(out, "hexad_build_info", "gauge", "The running version.");
    fprintf(out, "hexad_build_info{version=\"%s\"} 1\n", PACKAGE_VERSION);
    put_seconds(out, "hexad_start_time_seconds", "When the service was started.", c->started_ms);
    put_gauge(out, "hexad_draining", "Whether the service accepts no jobs.", !executor_takes_jobs(c->x));
    bool held = false;
    if (queue_is_held(c->q, &held, NULL))
        put_gauge(out, "hexad_held", "Whether the queue is held: jobs are accepted and not started.", held);
}

static void put_queue(const http_context *c, FILE *out)
{
    int64_t count[QUEUE_STATE_COUNT];
    queue_figures f;
    if (!queue_count(c->q, count, NULL) || !queue_get_figures(c->q, &f, NULL))
        return; /* a metric whose value is unknown is omitted */
    put_head(out, "hexad_jobs", "gauge", "Jobs in each state.");
    for (int s = 0; s < QUEUE_STATE_COUNT; s++)
        fprintf(out, "hexad_jobs{state=\"%s\"} %lld\n", queue_state_name((queue_state)s),
                (long long)count[s]);
    put_seconds(out, "hexad_oldest_waiting_job_age_seconds",
                "How long the first queued job has waited; 0: no job is queued.", age_ms(f.waiting_since_ms));
    put_gauge(out, "hexad_jobs_undelivered",
              "Jobs whose results could not be copied to output.directory and were not downloaded.",
              f.undelivered);
    put_gauge(out, "hexad_webhooks_waiting",
              "Ends of jobs whose webhook has not been called successfully yet.", f.deliveries);
    put_seconds(out, "hexad_webhooks_oldest_age_seconds",
                "The age of the oldest of these ends; 0: there is none.", age_ms(f.delivery_since_ms));
    put_gauge(out, "hexad_database_size_bytes", "Size of the database.", f.database_bytes);
}

static void put_load(const http_context *c, FILE *out)
{
    executor_load load = executor_get_load(c->x);
    put_gauge(out, "hexad_attempts_running", "Running attempts.", load.attempts);
    put_gauge(out, "hexad_attempts_limit", "Attempts that may run at once.", load.workers);
    put_gauge(out, "hexad_threads_used", "Threads of the running attempts.", load.threads);
    put_gauge(out, "hexad_threads_limit", "Threads that attempts may use.", load.all_threads);
    put_gauge(out, "hexad_memory_reserved_bytes", "Memory reserved for the running attempts.",
              load.memory_mb << 20);
    put_gauge(out, "hexad_memory_limit_bytes", "Memory that attempts may use.", load.all_memory_mb << 20);
}

/* Whether attempts with this outcome can have this error code. Other pairs are omitted while their count
 * is 0. */
static bool is_usual(meter_outcome outcome, error_code code)
{
    switch (outcome) {
    case METER_CONVERGED:
    case METER_UNRESOLVED:
    case METER_NOT_CONVERGED:
        return code == ERROR_NONE;
    case METER_CANCELLED:
        return code == ERROR_CANCELLED;
    case METER_TIMED_OUT:
        return code == ERROR_LIMIT_TIME;
    case METER_RETRIED:
        return code == ERROR_NONE || code == ERROR_INTERNAL || code == ERROR_INTERRUPTED ||
               error_is_of_storage(code);
    default:
        return code != ERROR_NONE;
    }
}

static void put_attempts(const http_context *c, FILE *out)
{
    const meter *m = executor_get_meter(c->x);
    put_head(out, "hexad_attempts_total", "counter",
             "Attempts that have ended, by outcome and code of the error. After an attempt with the outcome"
             " retried the task is tried again.");
    for (int o = 0; o < METER_OUTCOME_COUNT; o++)
        for (int k = 0; k < ERROR_CODE_COUNT; k++)
            if (is_usual((meter_outcome)o, (error_code)k) || m->attempts[o][k])
                fprintf(out, "hexad_attempts_total{outcome=\"%s\",code=\"%s\"} %llu\n",
                        meter_outcome_name((meter_outcome)o), error_code_name((error_code)k),
                        (unsigned long long)m->attempts[o][k]);
    put_histogram(out, "hexad_attempt_duration_seconds", "How long attempts ran.", &m->durations);
    put_histogram(out, "hexad_job_wait_seconds",
                  "Time from the submission of a job to the first attempt of each of its tasks.", &m->waits);
    put_counter(out, "hexad_cache_hits_total", "Jobs that were given the result of an equal one.",
                m->cache_hits);
    put_counter(out, "hexad_cache_misses_total", "Jobs without an equal job whose result could be used.",
                m->cache_misses);
}

static void put_webhooks(const http_context *c, FILE *out)
{
    static const char name[] = "hexad_webhook_calls_total";
    put_head(out, name, "counter",
             "Calls of webhooks, by result. After given_up there are no further calls for this end.");
    fprintf(out, "%s{result=\"delivered\"} %llu\n", name, (unsigned long long)c->calls->delivered);
    fprintf(out, "%s{result=\"failed\"} %llu\n", name, (unsigned long long)c->calls->failed);
    fprintf(out, "%s{result=\"given_up\"} %llu\n", name, (unsigned long long)c->calls->given_up);
}

static void put_database(const http_context *c, FILE *out)
{
    health_report known;
    queue_get_health(c->q, &known);
    put_gauge(out, "hexad_database_damaged", "Whether damage was found in the database.", known.damaged);
    put_seconds(out, "hexad_database_last_check_timestamp_seconds",
                "When the last check of the database ended; 0: none has ended yet.", known.checked_ms);
    put_seconds(out, "hexad_database_last_check_duration_seconds", "How long that check took.",
                known.check_took_ms);
    put_gauge(out, "hexad_state_lost",
              "Whether the state directory is not at its path, so that nothing is stored.",
              !queue_has_place(c->q, NULL));
}

static void put_storage(const http_context *c, FILE *out)
{
    executor_space space = executor_get_space(c->x);
    store_inputs_space sent = store_inputs_get_space(c->inputs);
    put_gauge(out, "hexad_storage_size_bytes", "Size of the fullest disk of the state directory.",
              space.size_bytes);
    put_gauge(out, "hexad_storage_free_bytes", "Free space on that disk.", space.free_bytes);
    put_gauge(out, "hexad_storage_floor_bytes", "No job starts with less free space.", space.floor_bytes);
    put_gauge(out, "hexad_storage_writable",
              "Whether the last write to each of attempts/, results/ and inputs/ succeeded.",
              executor_can_write(c->x, NULL));
    put_gauge(out, "hexad_inputs_size_bytes", "Size of the files that clients have sent.", sent.used_bytes);
    put_gauge(out, "hexad_inputs_limit_bytes", "The size that these files may have.", sent.limit_bytes);
}

static void put_results(const http_context *c, FILE *out)
{
    queue_usage usage;
    if (queue_get_usage(c->q, &usage, NULL)) {
        free(usage.user);
        put_gauge(out, "hexad_results_size_bytes", "Space that results and logs of ended jobs take.",
                  usage.all.bytes);
        put_gauge(out, "hexad_results", "Results of ended jobs that are kept.", usage.all.results);
        if (usage.bounds.all.bytes < INT64_MAX)
            put_gauge(out, "hexad_results_limit_bytes", "The space that they may take.",
                      usage.bounds.all.bytes);
        put_gauge(out, "hexad_results_full",
                  "Whether results have reached a bound and no job may be deleted automatically.",
                  usage.full);
    }
    put_counter(out, "hexad_jobs_evicted_total",
                "Jobs that were deleted because results had reached a bound.", executor_count_evicted(c->x));
}

static void put_http(const http_context *c, FILE *out)
{
    put_head(out, "hexad_http_answers_total", "counter", "Answers, by the first digit of their status.");
    for (int i = 2; i < 6; i++)
        fprintf(out, "hexad_http_answers_total{class=\"%dxx\"} %llu\n", i,
                (unsigned long long)c->counters->answers[i]);
    put_gauge(out, "hexad_http_connections", "Open connections.", (int64_t)c->counters->connections);
    put_counter(out, "hexad_http_refused_connections_total",
                "Connections that were refused because of a limit.", c->counters->refused);
}

void metrics_show(const http_context *c, const http_request *request, reply *r)
{
    static void (*const parts[])(const http_context *c, FILE *out) = {
        put_service,  put_queue,   put_load,    put_attempts, put_webhooks,
        put_database, put_storage, put_results, put_http,
    };
    (void)request;
    char *text = NULL;
    size_t size = 0;
    FILE *out = open_memstream(&text, &size);
    for (size_t i = 0; i < sizeof parts / sizeof *parts; i++) parts[i](c, out);
    fclose(out);
    reply_set_text(r, "text/plain; version=0.0.4; charset=utf-8", text);
}
