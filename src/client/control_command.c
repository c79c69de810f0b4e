// SPDX-License-Identifier: Apache-2.0
/* control_command: commands of hexadctl that control jobs and the service: pause, resume, retry, deliver,
 * delete, priority, watch, workers, usage, hold, release, drain and undrain.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"
#include "base/core/terminal_text.h"
#include "client/command.h"
#include "client/job_table.h"
#include "client/print.h"

/* Posts a command for one job. On success *document is the job; the caller frees it. */
static int post_command(client *c, const char *id, const char *what, json **document)
{
    char *path = command_job_path(id, what);
    int code = path ? command_ask(c, "POST", path, NULL, document) : COMMAND_USAGE;
    free(path);
    return code;
}

/* Posts a command, prints the job, and calls `explain` for it unless `explain` is NULL. */
static int post_and_explain(client *c, const char *id, const char *what, void (*explain)(json_at job),
                            const command_options *options)
{
    json *document = NULL;
    int code = post_command(c, id, what, &document);
    if (code == COMMAND_OK && options->json) {
        print_document(document);
    } else if (code == COMMAND_OK) {
        print_job(json_root(document));
        if (explain) explain(json_root(document));
    }
    json_free(document);
    return code;
}

static int tell_and_print(client *c, const char *id, const char *what, const command_options *options)
{
    return post_and_explain(c, id, what, NULL, options);
}

int command_resume(client *c, const char *argument, const command_options *options)
{
    return tell_and_print(c, argument, "/resume", options);
}

static void print_dependents(json_at job)
{
    json_at dependents = json_member(&job, "dependents"), others = json_member(&dependents, "others");
    double count = json_number(json_member(&dependents, "retried"), 0);
    terminal_text_print(stdout, "%.0f dependent job%s retried\n", count, count == 1 ? "" : "s");
    for (json_at other = json_first(&others); other.node; other = json_next(&other))
        terminal_text_print(stdout, "%s was not retried: it depends on another failed job\n",
                            json_string(other, "?"));
}

int command_retry(client *c, const char *argument, const command_options *options)
{
    if (!options->dependents) return tell_and_print(c, argument, "/retry", options);
    return post_and_explain(c, argument, "/retry?dependents=1", print_dependents, options);
}

int command_deliver(client *c, const char *argument, const command_options *options)
{
    json *document = NULL;
    int code = post_command(c, argument, "/deliver", &document);
    json_free(document);
    if (code != COMMAND_OK) return code;
    char *path = command_job_path(argument, "");
    code = command_wait_for_copy(c, path, options);
    free(path);
    return code;
}

/* Prints what a pause means for running and waiting tasks. */
static void explain_pause(json_at job)
{
    json_at tasks = json_member(&job, "tasks");
    double running = json_number(json_member(&tasks, "running"), 0),
           waiting = json_number(json_member(&tasks, "waiting"), 0);
    bool array = json_bool(json_member(&job, "array"), false);
    if (running > 0 && array)
        terminal_text_print(stdout, "%.0f running frame%s continue%s; ", running, running == 1 ? "" : "s",
                            running == 1 ? "s" : "");
    else if (running > 0)
        fputs("the running attempt continues; ", stdout);
    if (array)
        terminal_text_print(stdout, "%.0f frame%s wait%s until \"hexadctl resume\"\n", waiting,
                            waiting == 1 ? "" : "s", waiting == 1 ? "s" : "");
    else
        puts("no attempt starts until \"hexadctl resume\"");
}

int command_pause(client *c, const char *argument, const command_options *options)
{
    return post_and_explain(c, argument, "/pause", explain_pause, options);
}

int command_delete(client *c, const char *argument, const command_options *options)
{
    json *document = NULL;
    char *path = command_job_path(argument, "");
    int code = path ? command_ask(c, "DELETE", path, NULL, &document) : COMMAND_USAGE;
    if (code == COMMAND_OK && !options->json) terminal_text_print(stdout, "%s deleted\n", argument);
    json_free(document);
    free(path);
    return code;
}

int command_priority(client *c, const char *argument, const command_options *options)
{
    json *document = NULL;
    char *end = NULL, *path = command_job_path(argument, "");
    long priority = options->priority ? strtol(options->priority, &end, 10) : 0;
    int code = COMMAND_USAGE;
    if (!options->priority) {
        print_failure(
            "priority: the option --priority N is missing: run \"hexadctl priority ID --priority N\"");
    } else if (!*options->priority || *end) {
        print_failure("priority: --priority must be a whole number (given %s)", options->priority);
    } else if (path) {
        char *body = mem_printf("{\"priority\":%ld}", priority);
        code = command_ask(c, "PATCH", path, body, &document);
        free(body);
    }
    if (code == COMMAND_OK && options->json) print_document(document);
    json_free(document);
    free(path);
    return code;
}

int command_watch(client *c, const char *argument, const command_options *options)
{
    (void)options; /* events are always JSON */
    error e = {0};
    int64_t last = 0;
    client_reply reply = {0};
    char *path = argument ? command_job_path(argument, "/events") : mem_strdup("/v1/events");
    int code = COMMAND_USAGE;
    if (path) {
        code = COMMAND_OK;
        if (!client_follow(c, path, &last, stdout, &reply, &e))
            code = print_unreachable(&e);
        else if (reply.status >= 300)
            code = print_refused(&reply);
    }
    client_reply_clear(&reply);
    free(path);
    return code;
}

static int print_whole(client *c, const char *method, const char *path)
{
    json *document = NULL;
    int code = command_ask(c, method, path, NULL, &document);
    if (code == COMMAND_OK) print_document(document);
    json_free(document);
    return code;
}

int command_workers(client *c, const char *argument, const command_options *options)
{
    (void)argument;
    json *document = NULL;
    if (options->json) return print_whole(c, "GET", "/v1/workers");
    int code = command_ask(c, "GET", "/v1/workers", NULL, &document);
    json_at root = json_root(document), load = json_member(&root, "load"),
            list = json_member(&root, "workers");
    if (code == COMMAND_OK) {
        printf("%.0f of %.0f attempts, %.0f of %.0f threads, %.0f of %.0f MiB\n",
               json_number(json_member(&load, "attempts"), 0),
               json_number(json_member(&load, "attempts_limit"), 0),
               json_number(json_member(&load, "threads"), 0),
               json_number(json_member(&load, "threads_limit"), 0),
               json_number(json_member(&load, "memory_mb"), 0),
               json_number(json_member(&load, "memory_mb_limit"), 0));
        table t = job_table_new_workers();
        for (json_at worker = json_first(&list); worker.node; worker = json_next(&worker))
            job_table_add_worker(&t, worker);
        if (json_first(&list).node) table_print(&t);
        table_clear(&t);
        command_print_user_limits(document, NULL, stdout);
        command_explain_waiting(c, stdout);
    }
    json_free(document);
    return code;
}

static void print_usage_row(json_at row, const char *name)
{
    static const char *const columns[] = {"bytes", "results", "upload_bytes"};
    for (size_t i = 0; i < 3; i++) {
        char *limit = mem_printf("%s_limit", columns[i]);
        const bool is_size = i != 1;
        double unit = is_size ? 1 << 20 : 1;
        json_at most = json_member(&row, limit);
        printf("%10.*f", is_size, json_number(json_member(&row, columns[i]), 0) / unit);
        if (json_type_of(most) == JSON_NUMBER)
            printf(" of %-10.*f  ", is_size, json_number(most, 0) / unit);
        else
            terminal_text_print(stdout, "    %-10s  ", "");
        free(limit);
    }
    terminal_text_put(stdout, name);
    putchar('\n');
}

int command_usage(client *c, const char *argument, const command_options *options)
{
    (void)argument;
    json *document = NULL;
    if (options->json) return print_whole(c, "GET", "/v1/usage");
    int code = command_ask(c, "GET", "/v1/usage", NULL, &document);
    json_at root = json_root(document), list = json_member(&root, "users");
    if (code == COMMAND_OK) {
        terminal_text_print(stdout, "%10s%16s%10s%16s%10s%16s%s\n", "MIB", "", "RESULTS", "", "UPLOAD_MIB",
                            "", "USER");
        print_usage_row(json_member(&root, "all"), "(all)");
        for (json_at row = json_first(&list); row.node; row = json_next(&row)) {
            print_usage_row(row, json_string(json_member(&row, "user"), "?"));
        }
        if (json_bool(json_member(&root, "full"), false))
            puts("results_full: no job starts until results are fetched or jobs deleted");
    }
    json_free(document);
    return code;
}

/* Whether /readyz has this state of a part of the service. */
static bool is_in_state(client *c, const char *part, const char *state)
{
    error e = {0};
    client_reply reply = {0};
    const bool answered = client_call(c, "GET", "/readyz", NULL, 0, &reply, &e);
    json_at root = json_root(reply.document), checks = json_member(&root, "checks");
    const bool is = answered && strcmp(json_string(json_member(&checks, part), ""), state) == 0;
    client_reply_clear(&reply);
    return is;
}

/* Begins or ends a drain or a hold of the service. `ended`: the state after the end; NULL: it begins. */
static int change_service(client *c, const char *path, const char *ended, const command_options *options)
{
    if (options->json) return print_whole(c, "POST", path);
    json *document = NULL;
    int code = command_ask(c, "POST", path, NULL, &document);
    json_at root = json_root(document);
    double running = json_number(json_member(&root, "running"), 0);
    if (code == COMMAND_OK) {
        const bool drains = strcmp(json_string(json_member(&root, "status"), ""), "draining") == 0;
        if (ended && !drains) puts(ended);
        terminal_text_print(stdout, "%.0f attempt%s run%s\n", running, running == 1 ? "" : "s",
                            running == 1 ? "s" : "");
        command_explain_waiting(c, stdout);
    }
    json_free(document);
    return code;
}

int command_drain(client *c, const char *argument, const command_options *options)
{
    (void)argument;
    return change_service(c, "/v1/admin/drain", NULL, options);
}

int command_hold(client *c, const char *argument, const command_options *options)
{
    (void)argument;
    return change_service(c, "/v1/admin/hold", NULL, options);
}

int command_release(client *c, const char *argument, const command_options *options)
{
    (void)argument;
    const bool held = options->json || is_in_state(c, "queue", "held");
    return change_service(c, "/v1/admin/release", held ? "the hold is ended" : "the queue was not held",
                          options);
}

int command_undrain(client *c, const char *argument, const command_options *options)
{
    (void)argument;
    const bool drained = options->json || is_in_state(c, "jobs", "draining");
    return change_service(c, "/v1/admin/resume",
                          drained ? "the drain is ended: the service accepts jobs"
                                  : "the service was not drained: it accepts jobs",
                          options);
}
