// SPDX-License-Identifier: Apache-2.0
/* Why jobs wait although workers are free: holds, drains, and the limits of users. */
#include <math.h>
#include <string.h>

#include "base/core/terminal_text.h"
#include "client/command.h"

void command_explain_waiting(client *c, FILE *file)
{
    error e = {0};
    client_reply reply = {0};
    if (client_call(c, "GET", "/readyz", NULL, 0, &reply, &e)) {
        json_at root = json_root(reply.document), checks = json_member(&root, "checks");
        const char *detail = json_string(json_member(&root, "detail"), NULL);
        if (strcmp(json_string(json_member(&checks, "queue"), ""), "held") == 0)
            fputs("held: jobs are accepted, and none starts until \"hexadctl release\"\n", file);
        if (detail) {
            terminal_text_put(file, detail);
            fputc('\n', file);
        }
    }
    client_reply_clear(&reply);
}

static const char *owner_of(json_at worker)
{
    return json_string(json_member(&worker, "owner"), "");
}

/* Prints a line for each owner, at its first attempt. */
void command_print_user_limits(const json *document, const char *owner, FILE *file)
{
    json_at root = json_root(document), load = json_member(&root, "load"),
            list = json_member(&root, "workers");
    const double most = json_number(json_member(&load, "user_running"), INFINITY);
    for (json_at worker = json_first(&list); worker.node; worker = json_next(&worker)) {
        const char *name = owner_of(worker);
        size_t before = 0, count = 0;
        for (json_at other = json_first(&list); other.node; other = json_next(&other)) {
            const bool same = strcmp(owner_of(other), name) == 0;
            count += same;
            before += same && other.index < worker.index;
        }
        if (before || (double)count < most || (owner && strcmp(owner, name) != 0)) continue;
        terminal_text_put(file, name);
        fprintf(file, ": %zu of %.0f running attempts (setting user_running): other jobs of this user wait\n",
                count, most);
    }
}

void command_explain_user_limits(client *c, const char *owner, FILE *file)
{
    error e = {0};
    client_reply reply = {0};
    if (client_call(c, "GET", "/v1/workers", NULL, 0, &reply, &e) && reply.status == 200)
        command_print_user_limits(reply.document, owner, file);
    client_reply_clear(&reply);
}
