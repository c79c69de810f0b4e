/* Commands that change a job or the service, and those that follow one. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "client/command.h"
#include "client/print.h"

/* Sends a request; on success the document is the caller's, where there is one. */
static int ask(client *c, const char *method, const char *path, const char *body, json **document)
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

int command_delete(client *c, const char *argument, const command_options *options)
{
    (void)options;
    json *document = NULL;
    char *path = command_job_path(argument, "");
    int code = path ? ask(c, "DELETE", path, NULL, &document) : COMMAND_USAGE;
    json_free(document);
    free(path);
    return code;
}

int command_priority(client *c, const char *argument, const command_options *options)
{
    json *document = NULL;
    char *end = NULL, *path = command_job_path(argument, "");
    long priority = options->priority ? strtol(options->priority, &end, 10) : 0;
    int code = COMMAND_USAGE;
    if (!options->priority || !*options->priority || *end) {
        print_failure("the priority is missing: hexadctl priority ID --priority N");
    } else if (path) {
        char *body = mem_printf("{\"priority\":%ld}", priority);
        code = ask(c, "PATCH", path, body, &document);
        free(body);
    }
    if (code == COMMAND_OK && options->json) print_document(document);
    json_free(document);
    free(path);
    return code;
}

int command_watch(client *c, const char *argument, const command_options *options)
{
    (void)options; /* events are JSON anyway */
    error e = {0};
    int64_t last = 0;
    long status = 0;
    char *path = command_job_path(argument, "/events");
    int code = COMMAND_USAGE;
    if (path) {
        code = COMMAND_OK;
        if (!client_follow(c, path, &last, stdout, &status, &e))
            code = print_unreachable(&e);
        else if (status >= 300)
            code = print_refused(&(client_reply){.status = status});
    }
    free(path);
    return code;
}

int command_log(client *c, const char *argument, const command_options *options)
{
    (void)options;
    error e = {0};
    long status = 0;
    char *path = command_job_path(argument, "/log"), *text = NULL;
    size_t size = 0;
    int code = COMMAND_USAGE;
    if (path) {
        FILE *stream = open_memstream(&text, &size);
        bool ok = client_download(c, path, stream, &status, &e);
        fclose(stream);
        code = !ok             ? print_unreachable(&e)
               : status >= 300 ? print_refused(&(client_reply){.status = status})
                               : COMMAND_OK;
        if (code == COMMAND_OK) fwrite(text, 1, size, stdout);
    }
    free(text);
    free(path);
    return code;
}

static int print_whole(client *c, const char *method, const char *path)
{
    json *document = NULL;
    int code = ask(c, method, path, NULL, &document);
    if (code == COMMAND_OK) print_document(document);
    json_free(document);
    return code;
}

int command_workers(client *c, const char *argument, const command_options *options)
{
    (void)argument;
    json *document = NULL;
    if (options->json) return print_whole(c, "GET", "/v1/workers");
    int code = ask(c, "GET", "/v1/workers", NULL, &document);
    json_at root = json_root(document), load = json_member(&root, "load"),
            list = json_member(&root, "workers");
    if (code == COMMAND_OK) {
        printf("%.0f of %.0f attempts, %.0f of %.0f threads, %.0f of %.0f MiB\n",
               json_number(json_member(&load, "attempts"), 0),
               json_number(json_member(&load, "attempts_limit"), 0),
               json_number(json_member(&load, "threads"), 0),
               json_number(json_member(&load, "threads_limit"), 0),
               json_number(json_member(&load, "memory_mb"), 0),
               json_number(json_member(&load, "memory_mb_limit"), 0));
        for (size_t i = 0; i < json_size(list); i++) {
            json_at worker = json_element(&list, i);
            print_text(stdout, json_string(json_member(&worker, "job"), "?"));
            printf("  attempt %.0f  ", json_number(json_member(&worker, "attempt"), 0));
            print_text(stdout, json_string(json_member(&worker, "owner"), "?"));
            putchar('\n');
        }
    }
    json_free(document);
    return code;
}

int command_drain(client *c, const char *argument, const command_options *options)
{
    (void)argument;
    (void)options;
    return print_whole(c, "POST", "/v1/admin/drain");
}

int command_undrain(client *c, const char *argument, const command_options *options)
{
    (void)argument;
    (void)options;
    return print_whole(c, "POST", "/v1/admin/resume");
}
