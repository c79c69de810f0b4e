#include "client/command.h"

#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"
#include "client/print.h"

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
    error e = {0};
    client_reply reply = {0};
    int code = COMMAND_OK;
    if (!client_call(c, method, path, body, body ? strlen(body) : 0, &reply, &e))
        return print_unreachable(&e);
    if (reply.status >= 300) {
        code = print_refused(&reply);
    } else {
        *document = reply.document;
        reply.document = NULL;
    }
    client_reply_clear(&reply);
    return code;
}

bool command_has_ended(json_at job)
{
    const char *state = json_string(json_member(&job, "state"), "");
    return strcmp(state, "succeeded") == 0 || strcmp(state, "failed") == 0 ||
           strcmp(state, "cancelled") == 0 || strcmp(state, "timed_out") == 0;
}
