#include "client/say.h"

#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "client/command.h"

void say_text(FILE *file, const char *text)
{
    for (const char *c = text; *c; c++) fputc((unsigned char)*c < 0x20 || *c == 0x7F ? '?' : *c, file);
}

int say_complaint(const char *what)
{
    fputs("hexadctl: ", stderr);
    say_text(stderr, what);
    fputc('\n', stderr);
    return COMMAND_FAILED;
}

int say_unreachable(const error *e)
{
    say_complaint(e->message);
    return COMMAND_UNREACHABLE;
}

int say_refused(const client_reply *reply)
{
    json_at root = json_root(reply->document);
    json_at errors = json_member(&root, "errors");
    char status[32];
    snprintf(status, sizeof status, "the server answered %ld", reply->status);
    say_complaint(json_string(json_member(&root, "detail"), status));
    for (size_t i = 0; i < json_size(errors); i++) {
        json_at fault = json_element(&errors, i);
        const char *pointer = json_string(json_member(&fault, "pointer"), "");
        fputs("  ", stderr);
        say_text(stderr, *pointer ? pointer : "(the whole spec)");
        fputs(": ", stderr);
        say_text(stderr, json_string(json_member(&fault, "detail"), ""));
        fputc('\n', stderr);
    }
    if (reply->status == 404 || reply->status == 409) return COMMAND_MISSING;
    return reply->status >= 400 && reply->status < 500 ? COMMAND_USAGE : COMMAND_FAILED;
}

void say_document(const json *document)
{
    char *text = json_print_pretty(document);
    fputs(text, stdout);
    free(text);
}

char *say_job_path(const char *id, const char *rest)
{
    if (!*id || strspn(id, "0123456789abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ") != strlen(id)) {
        say_complaint("that is not the id of a job");
        return NULL;
    }
    return mem_printf("/v1/jobs/%s%s", id, rest);
}
