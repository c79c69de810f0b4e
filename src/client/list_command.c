// SPDX-License-Identifier: Apache-2.0
/* list_command: the commands list, show and attempts of hexadctl. */
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"
#include "base/core/terminal_text.h"
#include "base/core/worker_contract.h"
#include "client/command.h"
#include "client/job_table.h"
#include "client/list_query.h"
#include "client/print.h"
#include "files/file.h"

#define JOBS_DEFAULT 50
/* Maximum number of failed frames of an array that `show` prints. */
#define FAILURES_SHOWN 20
/* Maximum number of dependent jobs that `show` prints. */
#define DEPENDENTS_SHOWN 20

/* A list that is read in pages. With --json its entries are collected in a document, otherwise as rows of
 * a table. */
typedef struct listing {
    const char *key; /* the member of a page that has the entries */
    void (*add)(table *t, json_at entry);
    table rows;
    json *entries; /* NULL: rows of a table */
    char *next;    /* the cursor of the next page; NULL: this was the last page */
} listing;

/* Adds the entries of a page; returns their number. */
static size_t take_page(listing *l, const json *page)
{
    json_at root = json_root(page), list = json_member(&root, l->key), next = json_member(&root, "next");
    for (json_at entry = json_first(&list); entry.node; entry = json_next(&entry)) {
        if (l->entries)
            json_append(l->entries, json_copy(entry.node));
        else
            l->add(&l->rows, entry);
    }
    free(l->next);
    l->next = json_type_of(next) == JSON_STRING   ? mem_strdup(json_string(next, ""))
              : json_type_of(next) == JSON_NUMBER ? mem_printf("%.0f", json_number(next, 0))
                                                  : NULL;
    return json_size(list);
}

/* Prints the listing. With --json it has the form of a single page of the server. */
static void print_listing(listing *l)
{
    if (l->entries) {
        json *document = json_new_object();
        json_put(document, l->key, l->entries);
        json_put_string(document, "next", l->next);
        l->entries = NULL;
        print_document(document);
        json_free(document);
    } else {
        table_print(&l->rows);
    }
}

static void listing_clear(listing *l)
{
    json_free(l->entries);
    table_clear(&l->rows);
    free(l->next);
}

/* Parses the limit of a list. 0, after a message, if the text is not a valid limit. */
static long read_limit(const char *text)
{
    char *end = NULL;
    long limit = text ? strtol(text, &end, 10) : JOBS_DEFAULT;
    if (!text || (*text && !*end && limit > 0)) return limit;
    print_failure("list: --limit must be a whole number of at least 1 (given %s)", text);
    return 0;
}

static bool check_moment(const char *option, const char *given)
{
    if (!given || list_query_is_moment(given)) return true;
    print_failure("list: %s must be a date or time, such as 2026-01-31 or 2026-01-31T18:00:00Z, or an "
                  "age, such as 30s, 90m, 2h or 1d (given %s)",
                  option, given);
    return false;
}

int command_list(client *c, const char *argument, const command_options *options)
{
    (void)argument;
    long left = read_limit(options->limit);
    command_options asked = *options;
    if (options->label.count > 1) print_failure("list: --label is given several times: give it once");
    if (!left || options->label.count > 1 || !check_moment("--since", options->since) ||
        !check_moment("--until", options->until))
        return COMMAND_USAGE;
    int code = COMMAND_OK;
    listing l = {.key = "jobs", .add = job_table_add, .entries = options->json ? json_new_array() : NULL};
    if (!options->json) l.rows = job_table_new();
    for (bool more = true; code == COMMAND_OK && more; more = l.next && left > 0) {
        json *page = NULL;
        char limit[24];
        snprintf(limit, sizeof limit, "%ld", left < COMMAND_PAGE_MOST ? left : COMMAND_PAGE_MOST);
        asked.limit = limit;
        char *path = list_query_path(c, &asked, l.next);
        code = command_ask(c, "GET", path, NULL, &page);
        if (code == COMMAND_OK) left -= (long)take_page(&l, page);
        json_free(page);
        free(path);
    }
    if (l.next && !options->json)
        fputs("hexadctl: the list continues: raise --limit to see more jobs\n", stderr);
    if (code == COMMAND_OK) print_listing(&l);
    if (code == COMMAND_OK && !options->json) {
        command_explain_user_limits(c, NULL, stderr);
        command_explain_waiting(c, stderr);
    }
    listing_clear(&l);
    return code;
}

static bool is_failure(json_at task)
{
    const char *state = json_string(json_member(&task, "state"), "");
    return strcmp(state, "failed") == 0 || strcmp(state, "timed_out") == 0;
}

/* Prints the first FAILURES_SHOWN of the `left` failed frames. */
static int show_failures(client *c, const char *id, double left)
{
    table rows = job_table_new_frames();
    double after = TASKS_FROM_THE_FIRST, shown = 0;
    int code = COMMAND_OK;
    for (json *page;
         shown < left && shown < FAILURES_SHOWN && (page = command_next_tasks(c, id, &after, &code));
         json_free(page)) {
        json_at root = json_root(page), tasks = json_member(&root, "tasks");
        for (json_at task = json_first(&tasks); task.node && shown < FAILURES_SHOWN;
             task = json_next(&task)) {
            if (!is_failure(task)) continue;
            job_table_add_frame(&rows, task);
            shown++;
        }
    }
    if (shown > 0) putchar('\n');
    if (shown > 0) table_print(&rows);
    if (shown < left) printf("and %.0f more\n", left - shown);
    table_clear(&rows);
    return code;
}

/* The first page of the jobs that depend on this one, which the caller frees. NULL if the service is older
 * and cannot list them. */
static json *list_dependents(client *c, const char *id)
{
    char *path = mem_printf("/v1/jobs?depends_on=%s&limit=%d", id, DEPENDENTS_SHOWN);
    json *page = command_find(c, path);
    free(path);
    return page;
}

static void show_job(client *c, json_at job, const char *id)
{
    json *dependents = list_dependents(c, id);
    job_table_print(job, json_root(dependents));
    json_free(dependents);
}

/* Downloads the preview of a job, or of a frame of an array, to a file. */
static int save_picture(client *c, const char *id, const char *given_frame, const char *path)
{
    error e = {0};
    store_file file = {0};
    client_reply reply = {0};
    int code = COMMAND_FAILED;
    char *frame = given_frame ? client_escape(c, given_frame) : NULL,
         *href = mem_printf("/v1/jobs/%s/results/%s%s%s", id, WORKER_PREVIEW_NAME, frame ? "?frame=" : "",
                            frame ? frame : "");
    store_file_clear(path); /* left by a killed process */
    if (!store_file_begin(path, &file, &e))
        print_failure("%s", e.message);
    else if (!client_download(c, href, file.stream, &reply, &e))
        code = print_unreachable(&e);
    else if (reply.status != 200)
        code = print_refused(&reply);
    else if (fflush(file.stream) != 0 || !store_file_commit(&file, &e))
        print_failure("%s cannot be written: %s", path, e.code ? e.message : strerror(errno));
    else
        code = COMMAND_OK;
    if (code == COMMAND_OK) terminal_text_print(stderr, "hexadctl: the picture was written to %s\n", path);
    store_file_abort(&file);
    client_reply_clear(&reply);
    free(href);
    free(frame);
    return code;
}

int command_show(client *c, const char *argument, const command_options *options)
{
    json *document = NULL;
    char *path = command_job_path(argument, "");
    int code = path ? command_ask(c, "GET", path, NULL, &document) : COMMAND_USAGE;
    if (code == COMMAND_OK && options->json)
        print_document(document);
    else if (code == COMMAND_OK)
        show_job(c, json_root(document), argument);
    json_at job = json_root(document), tasks = json_member(&job, "tasks");
    double failed =
        json_number(json_member(&tasks, "failed"), 0) + json_number(json_member(&tasks, "timed_out"), 0);
    if (code == COMMAND_OK && !options->json && failed > 0 && json_bool(json_member(&job, "array"), false))
        code = show_failures(c, argument, failed);
    if (code == COMMAND_OK && !options->json) code = command_print_frame_outcomes(c, job, stdout);
    if (code == COMMAND_OK && !options->json && !command_has_ended(job)) {
        if (json_number(json_member(&tasks, "waiting"), 0) > 0)
            command_explain_user_limits(c, json_string(json_member(&job, "owner"), ""), stderr);
        command_explain_waiting(c, stderr);
    }
    if (code == COMMAND_OK && options->picture)
        code = save_picture(c, argument, options->frame, options->picture);
    json_free(document);
    free(path);
    return code;
}

int command_attempts(client *c, const char *argument, const command_options *options)
{
    char *base = command_job_path(argument, "/attempts");
    if (!base) return COMMAND_USAGE;
    int code = COMMAND_OK;
    listing l = {
        .key = "attempts", .add = job_table_add_attempt, .entries = options->json ? json_new_array() : NULL};
    if (!options->json) l.rows = job_table_new_attempts();
    for (bool more = true; code == COMMAND_OK && more; more = l.next != NULL) {
        json *page = NULL;
        char *path = mem_printf("%s?limit=%d%s%s", base, COMMAND_PAGE_MOST, l.next ? "&after=" : "",
                                l.next ? l.next : "");
        code = command_ask(c, "GET", path, NULL, &page);
        if (code == COMMAND_OK) take_page(&l, page);
        json_free(page);
        free(path);
    }
    if (code == COMMAND_OK) print_listing(&l);
    listing_clear(&l);
    free(base);
    return code;
}
