// SPDX-License-Identifier: Apache-2.0
#include "client/job_table.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/clock.h"
#include "base/core/memory.h"
#include "base/core/terminal_text.h"
#include "client/command.h"
#include "client/print.h"

/* Maximum number of attempts of a job that `show` prints. */
#define ATTEMPTS_SHOWN 10

static const char *text_of(json_at object, const char *key, const char *otherwise)
{
    return json_string(json_member(&object, key), otherwise);
}

static double number_of(json_at object, const char *key)
{
    return json_number(json_member(&object, key), 0);
}

/* The name of a job for lists: its own, that of its input, or "-". */
static const char *name_of(json_at job)
{
    const char *name = text_of(job, "name", "");
    return *name ? name : text_of(job, "input", "-");
}

/* The time in this member, in milliseconds; 0: none. */
static int64_t time_of(json_at object, const char *key)
{
    int64_t wall_ms = 0;
    const char *text = text_of(object, key, NULL);
    return text && clock_parse_utc(text, &wall_ms) ? wall_ms : 0;
}

/* Prints a duration as "250ms", "1.9s", "45s", "12m", "3h" or "4d", rounded down to two or more digits. */
static char *print_span(int64_t ms, char *text, size_t size)
{
    int64_t s = ms > 0 ? ms / 1000 : 0;
    if (s < 1)
        snprintf(text, size, "%lldms", (long long)(ms > 0 ? ms : 0));
    else if (s < 10)
        snprintf(text, size, "%lld.%llds", (long long)s, (long long)(ms % 1000 / 100));
    else if (s < 120)
        snprintf(text, size, "%llds", (long long)s);
    else if (s < 2 * 3600)
        snprintf(text, size, "%lldm", (long long)(s / 60));
    else if (s < 2 * 86400)
        snprintf(text, size, "%lldh", (long long)(s / 3600));
    else
        snprintf(text, size, "%lldd", (long long)(s / 86400));
    return text;
}

char *job_table_new_age(json_at object, const char *key)
{
    char text[24];
    const int64_t at = time_of(object, key);
    return mem_strdup(at ? print_span(clock_wall_ms() - at, text, sizeof text) : "-");
}

/* Prints the duration of an object from its start to its end or to now; "-" if it has not started. */
static char *print_duration(json_at object, char *text, size_t size)
{
    int64_t from = time_of(object, "started"), to = time_of(object, "finished");
    if (!from) {
        snprintf(text, size, "-");
        return text;
    }
    return print_span((to ? to : clock_wall_ms()) - from, text, size);
}

/* Prints the number of frames that have ended and were not cancelled, "12/100". */
static int print_frames(json_at tasks, char *text, size_t size)
{
    return snprintf(text, size, "%.0f/%.0f",
                    number_of(tasks, "all") - number_of(tasks, "waiting") - number_of(tasks, "running") -
                        number_of(tasks, "cancelled"),
                    number_of(tasks, "all"));
}

/* Prints the ended and the cancelled frames, "12/100, 88 cancelled"; of a running single job its share,
 * "45%". */
static void print_progress(json_at job, char *text, size_t size)
{
    json_at tasks = json_member(&job, "tasks"), progress = json_member(&job, "progress");
    const double cancelled = number_of(tasks, "cancelled");
    if (json_bool(json_member(&job, "array"), false)) {
        const size_t used = (size_t)print_frames(tasks, text, size);
        if (cancelled > 0) snprintf(text + used, size - used, ", %.0f cancelled", cancelled);
    } else if (json_type_of(progress) == JSON_OBJECT)
        snprintf(text, size, "%.0f%%", 100 * number_of(progress, "fraction"));
    else
        snprintf(text, size, "-");
}

table job_table_new(void)
{
    static const char *const titles[] = {"ID",   "STATE",    "OUTCOME",  "OWNER", "AGE",
                                         "TIME", "PROGRESS", "PRIORITY", "NAME"};
    return table_new(titles, sizeof titles / sizeof *titles);
}

void job_table_add(table *t, json_at job)
{
    char age[24], took[24], progress[48];
    print_progress(job, progress, sizeof progress);
    table_add(t, mem_strdup(text_of(job, "id", "?")));
    table_add(t, mem_strdup(text_of(job, "state", "?")));
    table_add(t, mem_printf("%s%s", text_of(job, "outcome", "-"),
                            print_is_undelivered(job) ? ", not delivered" : ""));
    table_add(t, mem_strdup(text_of(job, "owner", "?")));
    table_add(t, mem_strdup(print_span(clock_wall_ms() - time_of(job, "created"), age, sizeof age)));
    table_add(t, mem_strdup(print_duration(job, took, sizeof took)));
    table_add(t, mem_strdup(progress));
    table_add(t, mem_printf("%.0f", number_of(job, "priority")));
    table_add(t, mem_strdup(name_of(job)));
}

void job_table_print_identity(json_at job, FILE *file)
{
    char age[24];
    const char *name = text_of(job, "name", "");
    terminal_text_put(file, text_of(job, "id", "?"));
    if (*name) {
        fputc(' ', file);
        terminal_text_put(file, name);
    }
    terminal_text_print(file, ", submitted %s ago\n",
                        print_span(clock_wall_ms() - time_of(job, "created"), age, sizeof age));
}

table job_table_new_attempts(void)
{
    static const char *const titles[] = {"FRAME", "ATTEMPT", "STARTED", "TIME",  "WAITED",
                                         "EXIT",  "MEMORY",  "HOST",    "REASON"};
    return table_new(titles, sizeof titles / sizeof *titles);
}

void job_table_add_attempt(table *t, json_at attempt)
{
    json_at frame = json_member(&attempt, "frame"), status = json_member(&attempt, "exit_status"),
            killed = json_member(&attempt, "signal"), memory = json_member(&attempt, "peak_memory_bytes"),
            waited = json_member(&attempt, "waited_ms");
    char took[24], before[24];
    table_add(t, frame.node ? mem_printf("%.0f", json_number(frame, 0)) : mem_strdup("-"));
    table_add(t, mem_printf("%.0f", number_of(attempt, "number")));
    table_add(t, mem_strdup(text_of(attempt, "started", "-")));
    table_add(t, mem_strdup(print_duration(attempt, took, sizeof took)));
    table_add(t, mem_strdup(waited.node ? print_span((int64_t)json_number(waited, 0), before, sizeof before)
                                        : "-"));
    table_add(t, killed.node   ? mem_printf("signal %.0f", json_number(killed, 0))
                 : status.node ? mem_printf("%.0f", json_number(status, 0))
                               : mem_strdup("-"));
    table_add(t, memory.node ? mem_printf("%.0f MiB", json_number(memory, 0) / (1 << 20)) : mem_strdup("-"));
    table_add(t, mem_strdup(text_of(attempt, "host", "-")));
    table_add(t, mem_strdup(text_of(attempt, "reason", "-")));
}

table job_table_new_frames(void)
{
    static const char *const titles[] = {"FRAME", "STATE", "ATTEMPT", "ERROR"};
    return table_new(titles, sizeof titles / sizeof *titles);
}

void job_table_add_frame(table *t, json_at task)
{
    json_at fault = json_member(&task, "error");
    const char *file = text_of(task, "file", NULL);
    table_add(t, mem_printf("%.0f%s%s%s", number_of(task, "frame"), file ? " (" : "", file ? file : "",
                            file ? ")" : ""));
    table_add(t, mem_strdup(text_of(task, "state", "?")));
    table_add(t, mem_printf("%.0f", number_of(task, "attempt")));
    table_add(t, mem_strdup(text_of(fault, "message", "-")));
}

/* ---- one job */

static void print_line(const char *title, const char *text)
{
    terminal_text_print(stdout, "  %-10s", title);
    terminal_text_put(stdout, text);
    putchar('\n');
}

/* Prints a list of words unless it is empty. */
static void print_words(const char *title, json_at list)
{
    for (json_at item = json_first(&list); item.node; item = json_next(&item)) {
        if (item.index == 0)
            terminal_text_print(stdout, "  %-9s ", title);
        else
            fputs(", ", stdout);
        terminal_text_put(stdout, json_string(item, "?"));
    }
    if (json_size(list)) putchar('\n');
}

/* Prints "2026-01-31T18:00:00.000Z" and its distance from another time. */
static void print_moment(json_at job, const char *key, int64_t since_ms, const char *before,
                         const char *behind)
{
    char span[24];
    int64_t at = time_of(job, key);
    if (!at) return;
    int64_t ms = since_ms > at ? since_ms - at : at - since_ms;
    terminal_text_print(stdout, "  %-10s%s (%s%s%s)\n", key, text_of(job, key, "?"), before,
                        print_span(ms, span, sizeof span), behind);
}

static void print_tasks(json_at job)
{
    json_at tasks = json_member(&job, "tasks"), progress = json_member(&job, "progress");
    char text[200];
    if (json_bool(json_member(&job, "array"), false)) {
        static const char *const parts[] = {"succeeded", "failed",  "timed_out",
                                            "cancelled", "running", "waiting"};
        size_t used = (size_t)print_frames(tasks, text, sizeof text);
        used += (size_t)snprintf(text + used, sizeof text - used, " frames have ended");
        for (size_t i = 0; i < sizeof parts / sizeof *parts; i++) {
            double n = number_of(tasks, parts[i]);
            if (n > 0) used += (size_t)snprintf(text + used, sizeof text - used, ", %.0f %s", n, parts[i]);
        }
        print_line("frames", text);
        return;
    }
    if (json_type_of(progress) != JSON_OBJECT) return;
    snprintf(text, sizeof text, "%.0f%% %.40s", 100 * number_of(progress, "fraction"),
             text_of(progress, "phase", ""));
    print_line("progress", text);
}

static void print_attempts(json_at job)
{
    json_at attempts = json_member(&job, "attempts");
    size_t all = (size_t)number_of(job, "attempt"), shown = json_size(attempts);
    if (!shown) return;
    if (shown <= ATTEMPTS_SHOWN) {
        table t = job_table_new_attempts();
        for (json_at attempt = json_first(&attempts); attempt.node; attempt = json_next(&attempt))
            job_table_add_attempt(&t, attempt);
        putchar('\n');
        table_print(&t);
        table_clear(&t);
    }
    if (all > shown || shown > ATTEMPTS_SHOWN)
        terminal_text_print(stdout, "  %-10s%zu; \"hexadctl attempts %s\" lists them\n", "attempts", all,
                            text_of(job, "id", "ID"));
}

static void print_dependents(json_at page)
{
    json_at jobs = json_member(&page, "jobs");
    for (json_at job = json_first(&jobs); job.node; job = json_next(&job)) {
        fputs(job.index == 0 ? "  needed by " : ", ", stdout);
        terminal_text_put(stdout, text_of(job, "id", "?"));
        putchar(' ');
        terminal_text_put(stdout, text_of(job, "state", "?"));
    }
    if (text_of(page, "next", NULL)) fputs(", and more", stdout);
    if (json_size(jobs)) putchar('\n');
}

void job_table_print(json_at job, json_at dependents)
{
    json_at spec = json_member(&job, "spec"), queue = json_member(&spec, "queue");
    int64_t now = clock_wall_ms(), created = time_of(job, "created"), started = time_of(job, "started");
    char number[32];
    snprintf(number, sizeof number, "%.0f", number_of(job, "priority"));
    print_job(job);
    if (text_of(job, "name", NULL)) print_line("name", text_of(job, "name", ""));
    print_line("owner", text_of(job, "owner", "?"));
    print_words("labels", json_member(&job, "labels"));
    print_line("priority", number);
    if (json_bool(json_member(&job, "paused"), false)) print_line("paused", "no attempt starts");
    print_words("depends on", json_member(&queue, "depends_on"));
    print_words("after", json_member(&queue, "after"));
    print_dependents(dependents);
    print_moment(job, "created", now, "", " ago");
    print_moment(job, "started", created, "waited ", "");
    print_moment(job, "finished", started ? started : created, "took ", "");
    if (text_of(job, "cached_from", NULL)) print_line("result of", text_of(job, "cached_from", ""));
    print_tasks(job);
    print_size(stdout, "  points    ", json_member(&job, "notes"));
    print_ratings(stdout, "  packing   ", json_member(&job, "notes"));
    print_notes(stdout, json_member(&job, "notes"));
    print_attempts(job);
}

table job_table_new_workers(void)
{
    static const char *const titles[] = {"JOB", "ATTEMPT", "USER", "NAME", "HOST", "THREADS", "MEMORY"};
    return table_new(titles, sizeof titles / sizeof *titles);
}

void job_table_add_worker(table *t, json_at worker)
{
    table_add(t, mem_strdup(text_of(worker, "job", "?")));
    table_add(t, mem_printf("%.0f", number_of(worker, "attempt")));
    table_add(t, mem_strdup(text_of(worker, "owner", "?")));
    table_add(t, mem_strdup(name_of(worker)));
    table_add(t, mem_strdup(text_of(worker, "host", "-")));
    table_add(t, mem_printf("%.0f", number_of(worker, "threads")));
    table_add(t, mem_printf("%.0f MiB", number_of(worker, "memory_mb")));
}
