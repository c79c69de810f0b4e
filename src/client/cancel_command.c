// SPDX-License-Identifier: Apache-2.0
/* cancel_command: the command cancel of hexadctl, for one job or for all jobs with a label. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"
#include "base/core/terminal_text.h"
#include "client/command.h"
#include "client/list_query.h"
#include "client/print.h"

/* Cancels a job of the list. *cancelled is incremented, unless the job has ended in the meantime or belongs
 * to another user. */
static int cancel_one(client *c, const char *id, size_t *cancelled)
{
    error e = {0};
    client_reply reply = {0};
    int code = COMMAND_OK;
    char *path = command_job_path(id, "/cancel");
    if (!path) return COMMAND_FAILED;
    if (!client_call(c, "POST", path, NULL, 0, &reply, &e))
        code = print_unreachable(&e);
    else if (reply.status < 300)
        ++*cancelled;
    else if (reply.status != 403 && reply.status != 404 && reply.status != 409)
        code = print_refused(&reply);
    client_reply_clear(&reply);
    free(path);
    return code;
}

/* Cancels the unfinished jobs that the options select. */
static int cancel_all(client *c, const command_options *options)
{
    command_options chosen = *options;
    json *jobs = NULL;
    size_t cancelled = 0;
    chosen.state = "blocked,paused,queued,running";
    int code = list_query_read_all(c, &chosen, &jobs);
    json_at list = json_root(jobs);
    const size_t count = json_size(list);
    /* newest first: otherwise a dependent job would fail when the job that it depends on ends */
    for (json_at job = json_first(&list); code == COMMAND_OK && job.node; job = json_next(&job))
        code = cancel_one(c, json_string(json_member(&job, "id"), ""), &cancelled);
    json_free(jobs);
    if (options->json)
        printf("{\"cancelled\":%zu}\n", cancelled);
    else
        terminal_text_print(stdout, "%zu job%s cancelled\n", cancelled, cancelled == 1 ? "" : "s");
    if (code == COMMAND_OK && cancelled < count)
        fprintf(stderr, "%zu other jobs were not cancelled: they have ended or belong to other users\n",
                count - cancelled);
    return code;
}

int command_cancel(client *c, const char *argument, const command_options *options)
{
    json *document = NULL;
    if (!argument == !options->label.count || options->label.count > 1) {
        print_failure("cancel: give either the IDs of jobs or one --label");
        return COMMAND_USAGE;
    }
    if (!argument) return cancel_all(c, options);
    if (options->owner) {
        print_failure("cancel: --owner requires --label; with the ID of a job, omit it");
        return COMMAND_USAGE;
    }
    char *path = command_job_path(argument, "/cancel");
    int code = path ? command_ask(c, "POST", path, NULL, &document) : COMMAND_USAGE;
    if (code == COMMAND_OK && options->json)
        print_document(document);
    else if (code == COMMAND_OK)
        print_job(json_root(document));
    json_free(document);
    free(path);
    return code;
}
