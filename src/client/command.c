// SPDX-License-Identifier: Apache-2.0
#include "client/command.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"
#include "client/print.h"
#include "client/progress_bar.h"

char *command_job_path(const char *id, const char *rest)
{
    if (!*id || strspn(id, "0123456789abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ") != strlen(id)) {
        print_failure("%s is not a job ID: run \"hexadctl list\" for the IDs", id);
        return NULL;
    }
    return mem_printf("/v1/jobs/%s%s", id, rest);
}

int command_ask(client *c, const char *method, const char *path, const char *body, json **document)
{
    return command_ask_showing(c, method, path, body, NULL, document);
}

int command_ask_showing(client *c, const char *method, const char *path, const char *body, const char *text,
                        json **document)
{
    error e = {0};
    client_reply reply = {0};
    int code = COMMAND_OK;
    progress_bar bar;
    progress_bar_init(&bar);
    if (text) progress_bar_show_text(&bar, text);
    const bool answered = client_call(c, method, path, body, body ? strlen(body) : 0, &reply, &e);
    progress_bar_clear(&bar);
    if (!answered) return print_unreachable(&e);
    if (reply.status >= 300) {
        code = print_refused(&reply);
    } else {
        *document = reply.document;
        reply.document = NULL;
    }
    client_reply_clear(&reply);
    return code;
}

json *command_next_tasks(client *c, const char *id, double *after, int *code)
{
    json *page = NULL;
    if (isnan(*after)) return NULL;
    char *path = *after < 0
                     ? mem_printf("/v1/jobs/%s/tasks?limit=%d", id, COMMAND_PAGE_MOST)
                     : mem_printf("/v1/jobs/%s/tasks?limit=%d&after=%.0f", id, COMMAND_PAGE_MOST, *after);
    *code = command_ask(c, "GET", path, NULL, &page);
    json_at root = json_root(page);
    *after = json_number(json_member(&root, "next"), NAN);
    free(path);
    return page;
}

bool command_has_ended(json_at job)
{
    const char *state = json_string(json_member(&job, "state"), "");
    return strcmp(state, "succeeded") == 0 || strcmp(state, "failed") == 0 ||
           strcmp(state, "cancelled") == 0 || strcmp(state, "timed_out") == 0;
}
