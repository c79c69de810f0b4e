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
    const char *prefix; /* "": all ids */
    json *jobs;
} matches;

/* Whether the name has the length and the characters of an id. */
static bool is_id(const char *name)
{
    return strlen(name) == ID_LENGTH && strspn(name, ULID_ALPHABET) == ID_LENGTH;
}

bool job_name_is_short(const char *name)
{
    return !is_id(name);
}

/* Whether the name may be the beginning of an id. */
static bool is_prefix(const char *name)
{
    size_t length = strlen(name);
    return length >= JOB_NAME_PREFIX_LEAST && length < ID_LENGTH && strspn(name, ULID_ALPHABET) == length;
}

/* The earliest or the latest time of a job whose id begins with the text, in the form that a query of the
 * list accepts. */
static char *moment_of(const char *prefix, char filler, int64_t later_ms)
{
    char id[ULID_SIZE], text[CLOCK_TEXT_SIZE];
    snprintf(id, sizeof id, "%s", prefix);
    for (size_t i = strlen(id); i < ID_LENGTH; i++) id[i] = filler;
    id[ID_LENGTH] = '\0';
    if (!ulid_is_valid(id)) return NULL;
    return mem_strdup(clock_format_utc(ulid_time_ms(id) + later_ms, text));
}

static void take_matches(matches *m, json_at page)
{
    json_at jobs = json_member(&page, "jobs");
    size_t length = strlen(m->prefix);
    for (json_at job = json_first(&jobs); job.node; job = json_next(&job)) {
        if (strncmp(json_string(json_member(&job, "id"), ""), m->prefix, length) == 0)
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

static int refuse_several(const char *name, const matches *m)
{
    json_at jobs = json_root(m->jobs);
    print_failure("%s is the %s of %zu jobs: give %s", name, *m->prefix ? "beginning of the IDs" : "name",
                  json_size(jobs), *m->prefix ? "more characters" : "an ID");
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

/* Sets *id if exactly one of the jobs that the options select matches; without a match it remains NULL.
 * Several matches are refused, unless `first_only`. */
static int find(client *c, const command_options *chosen, const char *name, const char *prefix,
                bool first_only, char **id)
{
    matches m = {.prefix = prefix, .jobs = json_new_array()};
    int code = collect(c, chosen, first_only, &m);
    json_at jobs = json_root(m.jobs), first = json_first(&jobs);
    if (code == COMMAND_OK && json_size(jobs) > 1 && !first_only)
        code = refuse_several(name, &m);
    else if (code == COMMAND_OK && first.node)
        *id = mem_strdup(json_string(json_member(&first, "id"), ""));
    json_free(m.jobs);
    return code;
}

static int find_latest(client *c, const char *user, char **id)
{
    const command_options chosen = {.owner = user, .limit = "1"};
    int code = find(c, &chosen, JOB_NAME_LATEST, "", true, id);
    if (code != COMMAND_OK || *id) return code;
    print_failure("the user %s has no jobs: submit one, or give an ID", user);
    return COMMAND_MISSING;
}

static int find_beginning(client *c, const char *user, const char *name, char **id)
{
    char *since = moment_of(name, '0', 0), *until = moment_of(name, 'z', 1);
    const command_options chosen = {.owner = user, .since = since, .until = until, .limit = "500"};
    int code = since && until ? find(c, &chosen, name, name, false, id) : COMMAND_OK;
    free(since);
    free(until);
    return code;
}

static int find_named(client *c, const char *user, const char *name, char **id)
{
    const command_options chosen = {.owner = user, .name = name, .limit = "500"};
    return find(c, &chosen, name, "", false, id);
}

static int refuse_unknown(const char *user, const char *name)
{
    char *lower = mem_strdup(name);
    for (char *c = lower; *c; c++)
        if (*c >= 'A' && *c <= 'Z') *c = (char)(*c - 'A' + 'a');
    nearest_name n = nearest_name_to(lower, strlen(lower));
    nearest_name_offer(&n, JOB_NAME_LATEST);
    free(lower);
    print_failure(
        "the user %s has no job %s: give the 26 characters of an ID, its first %d characters or more, the name "
        "of a job, or " JOB_NAME_LATEST
        "%s. \"hexadctl list --name NAME\" prints the IDs of the jobs of all users",
        user, name, JOB_NAME_PREFIX_LEAST, n.name ? "; did you mean " JOB_NAME_LATEST "?" : "");
    return COMMAND_MISSING;
}

int job_name_resolve(client *c, const char *name, char **id)
{
    json *session = NULL;
    if (is_id(name)) {
        *id = mem_strdup(name);
        return COMMAND_OK;
    }
    int code = command_ask(c, "GET", "/v1/session", NULL, &session);
    json_at root = json_root(session);
    const char *user = json_string(json_member(&root, "user"), "");
    char *found = NULL;
    if (code == COMMAND_OK && strcmp(name, JOB_NAME_LATEST) == 0) {
        code = find_latest(c, user, &found);
    } else if (code == COMMAND_OK) {
        if (is_prefix(name)) code = find_beginning(c, user, name, &found);
        if (code == COMMAND_OK && !found && *name) code = find_named(c, user, name, &found);
        if (code == COMMAND_OK && !found) code = refuse_unknown(user, name);
    }
    if (code == COMMAND_OK) *id = found;
    json_free(session);
    return code;
}
