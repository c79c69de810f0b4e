// SPDX-License-Identifier: Apache-2.0
/* wait_command: waits for the end of a job, and for copies of its results. */
#include <poll.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/clock.h"
#include "base/core/memory.h"
#include "client/command.h"
#include "client/print.h"
#include "client/progress_bar.h"

/* The interval between two polls of a job grows from FIRST_WAIT_MS to LONGEST_WAIT_MS. */
#define FIRST_WAIT_MS 50
#define LONGEST_WAIT_MS 1000
/* How long `wait` tolerates an unreachable server. A restart of the daemon takes less. */
#define UNREACHABLE_MS 15000

static int code_of_end(json_at job)
{
    const char *state = json_string(json_member(&job, "state"), "");
    const char *outcome = json_string(json_member(&job, "outcome"), "");
    if (strcmp(state, "cancelled") == 0) return COMMAND_CANCELLED;
    if (strcmp(state, "succeeded") != 0) return COMMAND_FAILED;
    return strcmp(outcome, "converged") == 0    ? COMMAND_OK
           : strcmp(outcome, "unresolved") == 0 ? COMMAND_UNRESOLVED
                                                : COMMAND_NOT_CONVERGED;
}

/* Prints the ended job and returns its exit code. */
static int end_wait(client *c, const json *document, const command_options *options)
{
    json_at job = json_root(document);
    if (options->json)
        print_document(document);
    else
        print_job(job);
    char *title =
        options->several ? mem_printf("%s: ", json_string(json_member(&job, "id"), "?")) : mem_strdup("");
    print_size(stderr, title, json_member(&job, "notes"));
    free(title);
    print_ratings(stderr, "packing: ", json_member(&job, "notes"));
    print_notes(stderr, json_member(&job, "notes"));
    int code = command_print_frame_outcomes(c, job, stderr);
    bool accepted = options->accept && json_bool(json_member(&job, "accepted"), false);
    return code == COMMAND_OK && !accepted ? code_of_end(job) : code;
}

static bool is_copied(json_at job)
{
    json_at copy = json_member(&job, "delivery");
    return strcmp(json_string(json_member(&copy, "state"), ""), "pending") != 0;
}

static int end_wait_for_copy(client *c, const json *document, const command_options *options)
{
    json_at job = json_root(document);
    (void)c;
    if (options->json)
        print_document(document);
    else
        print_delivered_job(job);
    return print_is_undelivered(job) ? COMMAND_FAILED : COMMAND_OK;
}

/* What the wait is for, whether it shows the progress of the job, and the function that prints the job and
 * returns the exit code. */
typedef struct wait_condition {
    bool shows_progress;
    bool (*is_reached)(json_at job);
    int (*end)(client *c, const json *document, const command_options *options);
} wait_condition;

static bool is_queued(json_at job)
{
    return strcmp(json_string(json_member(&job, "state"), ""), "queued") == 0;
}

static int wait_for(client *c, const char *path, const wait_condition *g, const command_options *options)
{
    int wait_ms = FIRST_WAIT_MS, code = COMMAND_OK;
    bool is_explained = false; /* why the job is still queued at the longest interval */
    int64_t heard_ms = clock_monotonic_ms();
    bool done = false;
    progress_bar m;
    progress_bar_init(&m);
    m.identify = options->several;
    while (!done) {
        error e = {0};
        client_reply reply = {0};
        if (!client_call(c, "GET", path, NULL, 0, &reply, &e)) {
            done = clock_monotonic_ms() - heard_ms > UNREACHABLE_MS;
            if (done) code = print_unreachable(&e);
        } else if (reply.status >= 300 || !reply.document) {
            progress_bar_clear(&m);
            code = print_refused(&reply);
            done = true;
        } else {
            json_at job = json_root(reply.document);
            heard_ms = clock_monotonic_ms();
            done = g->is_reached(job);
            if (!done && g->shows_progress) {
                if (wait_ms == LONGEST_WAIT_MS && is_queued(job) && !is_explained) {
                    progress_bar_clear(&m);
                    command_explain_waiting(c, stderr);
                    is_explained = true;
                }
                progress_bar_show(&m, job);
            }
            if (done) {
                progress_bar_clear(&m);
                code = g->end(c, reply.document, options);
            }
        }
        client_reply_clear(&reply);
        if (!done) poll(NULL, 0, wait_ms);
        wait_ms = wait_ms * 3 / 2 < LONGEST_WAIT_MS ? wait_ms * 3 / 2 : LONGEST_WAIT_MS;
    }
    return code;
}

int command_wait_for(client *c, const char *path, const command_options *options)
{
    return wait_for(c, path, &(wait_condition){true, command_has_ended, end_wait}, options);
}

int command_wait_for_copy(client *c, const char *path, const command_options *options)
{
    return wait_for(c, path, &(wait_condition){false, is_copied, end_wait_for_copy}, options);
}

int command_wait(client *c, const char *argument, const command_options *options)
{
    char *path = command_job_path(argument, "");
    int code = path ? command_wait_for(c, path, options) : COMMAND_USAGE;
    free(path);
    return code;
}
