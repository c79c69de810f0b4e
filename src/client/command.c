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

json *command_find(client *c, const char *path)
{
    error e = {0};
    client_reply reply = {0};
    json *document = NULL;
    if (client_call(c, "GET", path, NULL, 0, &reply, &e) && reply.status == 200) {
        document = reply.document;
        reply.document = NULL;
    }
    client_reply_clear(&reply);
    return document;
}

int command_read_all(client *c, const char *path, const char *member, json **all)
{
    json *entries = json_new_array();
    char *cursor = NULL;
    int code = COMMAND_OK;
    do {
        json *page = NULL;
        char *page_path = mem_printf("%s%s%s", path, cursor ? "&cursor=" : "", cursor ? cursor : "");
        code = command_ask(c, "GET", page_path, NULL, &page);
        json_at root = json_root(page), list = json_member(&root, member);
        for (json_at entry = json_first(&list); entry.node; entry = json_next(&entry))
            json_append(entries, json_copy(entry.node));
        free(page_path);
        free(cursor);
        const char *next = json_string(json_member(&root, "next"), NULL);
        cursor = next ? client_escape(c, next) : NULL;
        json_free(page);
    } while (code == COMMAND_OK && cursor);
    free(cursor);
    if (code == COMMAND_OK)
        *all = entries;
    else
        json_free(entries);
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

bool command_compare(FILE *received, const char *name, const char *sha256, error *e)
{
    char hex[STORE_HASH_SIZE];
    uint64_t bytes = 0;
    if (fflush(received) != 0) return error_set(e, ERROR_INTERNAL, "%s cannot be written", name);
    return store_file_hash(fileno(received), hex, &bytes, e) &&
           (strcmp(hex, sha256) == 0 ||
            error_set(e, ERROR_INPUT_DAMAGED,
                      "%s: the received bytes do not have the SHA-256 that the service states: the file is "
                      "damaged in the service, or on the way. Submit the job again, which computes it again; "
                      "to fetch it again helps only against damage on the way.",
                      name));
}
