// SPDX-License-Identifier: Apache-2.0
#include "client/print.h"

#include <stdarg.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/core/memory.h"
#include "base/core/terminal_text.h"
#include "base/core/user_name.h"
#include "client/command.h"

int print_failure(const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    char *text = mem_print_list(format, arguments);
    va_end(arguments);
    terminal_text_print(stderr, "hexadctl: %s\n", text);
    free(text);
    return COMMAND_FAILED;
}

int print_unreachable(const error *e)
{
    print_failure("%s", e->message);
    return COMMAND_UNREACHABLE;
}

static void print_fault(json_at fault)
{
    const char *pointer = json_string(json_member(&fault, "pointer"), "");
    terminal_text_put(stderr, *pointer ? pointer : "the whole document");
    fputs(": ", stderr);
    terminal_text_put(stderr, json_string(json_member(&fault, "detail"), ""));
    fputc('\n', stderr);
}

/* Prints the refusal of a user of the Unix socket. The server sends its number only. */
static int print_refused_user(const char *allow_command)
{
    char name[USER_NAME_SIZE];
    user_name_of(geteuid(), name);
    print_failure(
        "the user \"%s\" may not use this service: run `%s %s` as root, or set HEXAD_TOKEN to a token", name,
        allow_command, name);
    return COMMAND_USAGE;
}

int print_refused_spec(const client_reply *reply, const char *file)
{
    json_at root = json_root(reply->document), errors = json_member(&root, "errors");
    char status[160];
    snprintf(status, sizeof status,
             "the server answered with status %ld and no explanation: check that the address is "
             "that of hexad",
             reply->status);
    const char *token = getenv("HEXAD_TOKEN");
    bool has_token = token && *token;
    /* a refusal on a Unix socket includes the advice */
    if (reply->status == 401 && (has_token || !reply->local)) {
        print_failure(
            "%s: set HEXAD_TOKEN to a%s token, which the administrator creates on the machine of the server "
            "with \"hexadctl token add USER\" (and --file FILE if the setting token_file or state_dir is not "
            "the default)",
            has_token ? "the token in HEXAD_TOKEN is unknown or revoked"
                      : "the server requires a token and HEXAD_TOKEN is not set",
            has_token ? " new" : "");
        return COMMAND_USAGE;
    }
    const char *allow_command = json_string(json_member(&root, "allow_command"), NULL);
    if (allow_command) return print_refused_user(allow_command);
    fputs("hexadctl: ", stderr);
    if (file) {
        terminal_text_put(stderr, file);
        fputs(": ", stderr);
    }
    if (json_size(errors) == 1) {
        print_fault(json_first(&errors));
    } else if (json_size(errors) > 1) {
        fprintf(stderr, "%zu faults:\n", json_size(errors));
        for (json_at fault = json_first(&errors); fault.node; fault = json_next(&fault)) {
            fputs("  ", stderr);
            print_fault(fault);
        }
    } else {
        terminal_text_put(stderr, json_string(json_member(&root, "detail"), status));
        fputc('\n', stderr);
    }
    if (reply->status == 404 || reply->status == 409) return COMMAND_MISSING;
    return reply->status >= 400 && reply->status < 500 ? COMMAND_USAGE : COMMAND_FAILED;
}

int print_refused(const client_reply *reply)
{
    return print_refused_spec(reply, NULL);
}

bool print_is_undelivered(json_at job)
{
    json_at copy = json_member(&job, "delivery");
    return strcmp(json_string(json_member(&copy, "state"), ""), "failed") == 0;
}

/* Prints the line of a job without the line break. */
static void print_job_text(json_at job)
{
    json_at fault = json_member(&job, "error"), copy = json_member(&job, "delivery");
    const char *outcome = json_string(json_member(&job, "outcome"), NULL);
    terminal_text_put(stdout, json_string(json_member(&job, "id"), "?"));
    putchar(' ');
    terminal_text_put(stdout, json_string(json_member(&job, "state"), "?"));
    if (outcome) {
        putchar(' ');
        terminal_text_put(stdout, outcome);
        if (!json_bool(json_member(&job, "accepted"), true)) fputs(" (not accepted)", stdout);
    }
    if (json_type_of(fault) == JSON_OBJECT) {
        const char *why = json_string(json_member(&fault, "code"), "?");
        /* "cancelled" is a state and an error code */
        if (strcmp(why, json_string(json_member(&job, "state"), "")) != 0) {
            putchar(' ');
            terminal_text_put(stdout, why);
        }
        fputs(": ", stdout);
        terminal_text_put(stdout, json_string(json_member(&fault, "message"), ""));
    }
    if (print_is_undelivered(job)) {
        fputs(" not delivered: ", stdout);
        terminal_text_put(stdout, json_string(json_member(&copy, "message"), ""));
    }
}

void print_job(json_at job)
{
    print_job_text(job);
    putchar('\n');
}

void print_delivered_job(json_at job)
{
    print_job_text(job);
    puts(print_is_undelivered(job) ? "" : " delivered");
}

static void print_note(FILE *file, const char *kind, json_at text)
{
    terminal_text_print(file, "%s: ", kind);
    terminal_text_put(file, json_string(text, "?"));
    fputc('\n', file);
}

void print_size(FILE *file, const char *title, json_at notes)
{
    json_at count = json_member(&notes, "count"), spacing = json_member(&notes, "spacing");
    if (json_type_of(count) != JSON_NUMBER) return;
    terminal_text_print(file, "%s%.0f points", title, json_number(count, 0));
    if (json_type_of(spacing) == JSON_NUMBER) fprintf(file, ", spacing %.3g", json_number(spacing, 0));
    fputc('\n', file);
}

void print_ratings(FILE *file, const char *title, json_at notes)
{
    json_at ratings = json_member(&notes, "ratings");
    for (json_at item = json_first(&ratings); item.node; item = json_next(&item)) {
        json_at value = json_member(&item, "value");
        fputs(item.index == 0 ? title : ", ", file);
        terminal_text_put(file, item.key);
        if (json_type_of(value) == JSON_NUMBER) fprintf(file, " %.3g ", json_number(value, 0));
        terminal_text_put(file, json_string(json_member(&item, "rating"), " not measured"));
    }
    if (json_size(ratings)) fputc('\n', file);
}

void print_notes(FILE *file, json_at notes)
{
    json_at reasons = json_member(&notes, "outcome_reasons"), warnings = json_member(&notes, "warnings"),
            advice = json_member(&notes, "advice");
    for (json_at reason = json_first(&reasons); reason.node; reason = json_next(&reason)) {
        print_note(file, "outcome", json_member(&reason, "message"));
    }
    for (json_at warning = json_first(&warnings); warning.node; warning = json_next(&warning))
        print_note(file, "warning", warning);
    for (json_at item = json_first(&advice); item.node; item = json_next(&item)) {
        print_note(file, "advice", json_member(&item, "message"));
    }
}

void print_page(const char *text)
{
    terminal_text_write(stdout, TERMINAL_TEXT_PAGE, text, strlen(text));
}

void print_document(const json *document)
{
    char *text = json_print_pretty(document);
    fputs(text, stdout);
    free(text);
}
