// SPDX-License-Identifier: Apache-2.0
#include "client/job_name.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/clock.h"
#include "base/core/memory.h"
#include "base/core/nearest_name.h"
#include "base/core/terminal_text.h"
#include "base/core/ulid.h"
#include "client/command.h"
#include "client/list_query.h"
#include "client/print.h"

#define ID_LENGTH (ULID_SIZE - 1)

/* Jobs whose ids begin with a text. */
typedef struct matches {
    const char *beginning;
    json *jobs;
} matches;

/* Whether the name has the length and the characters of an id. */
static bool is_id(const char *name)
{
    return strlen(name) == ID_LENGTH && strspn(name, ULID_ALPHABET) == ID_LENGTH;
}

bool job_name_is_short(const char *name)
{
    return strcmp(name, JOB_NAME_LATEST) == 0 ||
           (*name && strlen(name) < ID_LENGTH && strspn(name, ULID_ALPHABET) == strlen(name));
}

/* The earliest or the latest time of a job whose id begins with the text, in the form that a query of the
 * list accepts. */
static char *moment_of(const char *beginning, char filler, int64_t later_ms)
{
    char id[ULID_SIZE], text[CLOCK_TEXT_SIZE];
    snprintf(id, sizeof id, "%s", beginning);
    for (size_t i = strlen(id); i < ID_LENGTH; i++) id[i] = filler;
    id[ID_LENGTH] = '\0';
    if (!ulid_is_valid(id)) return NULL;
    return mem_strdup(clock_format_utc(ulid_time_ms(id) + later_ms, text));
}

static void take_matches(matches *m, json_at page)
{
    json_at jobs = json_member(&page, "jobs");
    size_t length = strlen(m->beginning);
    for (json_at job = json_first(&jobs); job.node; job = json_next(&job)) {
        if (strncmp(json_string(json_member(&job, "id"), ""), m->beginning, length) == 0)
            json_append(m->jobs, json_copy(job.node));
    }
}

/* Collects the matches among the jobs that the options select. If `first_only`, stops at the first page with
 * a match. */
static int collect(client *c, const command_options *chosen, bool first_only, matches *m)
{
    char *cursor = NULL;
    int code = COMMAND_OK;
    for (bool more = true; more && code == COMMAND_OK;) {
        json *page = NULL;
        char *path = list_query_path(c, chosen, cursor);
        code = command_ask(c, "GET", path, NULL, &page);
        json_at root = json_root(page);
        const char *next = json_string(json_member(&root, "next"), NULL);
        take_matches(m, root);
        free(cursor);
        cursor = next ? mem_strdup(next) : NULL;
        more = next && !(first_only && json_size(json_root(m->jobs)) > 0);
        json_free(page);
        free(path);
    }
    free(cursor);
    return code;
}

static int refuse_several(const matches *m)
{
    json_at jobs = json_root(m->jobs);
    print_failure("%s is the beginning of %zu job IDs: give more characters", m->beginning, json_size(jobs));
    for (json_at job = json_first(&jobs); job.node; job = json_next(&job)) {
        fputs("  ", stderr);
        terminal_text_put(stderr, json_string(json_member(&job, "id"), "?"));
        fputc(' ', stderr);
        terminal_text_put(stderr, json_string(json_member(&job, "state"), "?"));
        fputc(' ', stderr);
        terminal_text_put(stderr, json_string(json_member(&job, "name"), ""));
        fputc('\n', stderr);
    }
    return COMMAND_USAGE;
}

/* Finds the caller's only match, or its newest job. */
static int find(client *c, const char *user, const char *name, char **id)
{
    bool latest = strcmp(name, JOB_NAME_LATEST) == 0;
    matches m = {.beginning = latest ? "" : name, .jobs = json_new_array()};
    char *since = latest ? NULL : moment_of(name, '0', 0), *until = latest ? NULL : moment_of(name, 'z', 1);
    const command_options chosen = {
        .owner = user, .since = since, .until = until, .limit = latest ? "1" : "500"};
    int code = latest || (since && until) ? collect(c, &chosen, latest, &m) : COMMAND_OK;
    json_at jobs = json_root(m.jobs), first = json_first(&jobs);
    if (code == COMMAND_OK && json_size(jobs) > 1) {
        code = refuse_several(&m);
    } else if (code == COMMAND_OK && json_size(jobs) == 1) {
        *id = mem_strdup(json_string(json_member(&first, "id"), ""));
    } else if (code == COMMAND_OK) {
        if (latest)
            print_failure("the user %s has no jobs: submit one, or give an ID", user);
        else
            print_failure(
                "no job of this user has an ID that begins with %s: run \"hexadctl list\" for the IDs", name);
        code = COMMAND_MISSING;
    }
    json_free(m.jobs);
    free(since);
    free(until);
    return code;
}

/* Prints the error for a name that is neither an id nor the beginning of one. */
static int refuse_word(const char *name)
{
    char *lower = mem_strdup(name);
    for (char *c = lower; *c; c++)
        if (*c >= 'A' && *c <= 'Z') *c = (char)(*c - 'A' + 'a');
    nearest_name n = nearest_name_to(lower, strlen(lower));
    nearest_name_offer(&n, JOB_NAME_LATEST);
    print_failure(
        "%s is not an id of a job: give its 26 characters, the first %d characters or more, or " JOB_NAME_LATEST
        "%s",
        name, JOB_NAME_PREFIX_LEAST, n.name ? "; did you mean " JOB_NAME_LATEST "?" : "");
    size_t letters = strspn(lower, "0123456789abcdefghijklmnopqrstuvwxyz");
    bool word = *lower && letters == strlen(lower); /* the exit code is the same as for an unknown id */
    free(lower);
    return word ? COMMAND_MISSING : COMMAND_USAGE;
}

int job_name_resolve(client *c, const char *name, char **id)
{
    json *session = NULL;
    if (is_id(name)) {
        *id = mem_strdup(name);
        return COMMAND_OK;
    }
    if (!job_name_is_short(name)) return refuse_word(name);
    if (strcmp(name, JOB_NAME_LATEST) != 0 && strlen(name) < JOB_NAME_PREFIX_LEAST) {
        print_failure("%s is too short for the beginning of a job ID: give at least %d characters", name,
                      JOB_NAME_PREFIX_LEAST);
        return COMMAND_USAGE;
    }
    int code = command_ask(c, "GET", "/v1/session", NULL, &session);
    json_at root = json_root(session);
    if (code == COMMAND_OK) code = find(c, json_string(json_member(&root, "user"), ""), name, id);
    json_free(session);
    return code;
}
