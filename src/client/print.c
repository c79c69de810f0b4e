#include "client/print.h"

#include <stdlib.h>
#include <string.h>

#include "client/command.h"

void print_text(FILE *file, const char *text)
{
    for (const char *c = text; *c; c++) fputc((unsigned char)*c < 0x20 || *c == 0x7F ? '?' : *c, file);
}

int print_failure(const char *what)
{
    fputs("hexadctl: ", stderr);
    print_text(stderr, what);
    fputc('\n', stderr);
    return COMMAND_FAILED;
}

int print_unreachable(const error *e)
{
    print_failure(e->message);
    return COMMAND_UNREACHABLE;
}

int print_refused(const client_reply *reply)
{
    json_at root = json_root(reply->document);
    json_at errors = json_member(&root, "errors");
    char status[32];
    snprintf(status, sizeof status, "the server answered %ld", reply->status);
    print_failure(json_string(json_member(&root, "detail"), status));
    for (size_t i = 0; i < json_size(errors); i++) {
        json_at fault = json_element(&errors, i);
        const char *pointer = json_string(json_member(&fault, "pointer"), "");
        fputs("  ", stderr);
        print_text(stderr, *pointer ? pointer : "(the whole spec)");
        fputs(": ", stderr);
        print_text(stderr, json_string(json_member(&fault, "detail"), ""));
        fputc('\n', stderr);
    }
    if (reply->status == 404 || reply->status == 409) return COMMAND_MISSING;
    return reply->status >= 400 && reply->status < 500 ? COMMAND_USAGE : COMMAND_FAILED;
}

void print_document(const json *document)
{
    char *text = json_print_pretty(document);
    fputs(text, stdout);
    free(text);
}
