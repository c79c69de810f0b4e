#include "client/command.h"

#include <errno.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/clock.h"
#include "base/memory.h"
#include "client/print.h"
#include "client/progress_bar.h"
#include "store/file.h"

#define SPEC_LIMIT_BYTES (64u << 20)
/* The waits between two polls of a job grow from the first to the second. */
#define FIRST_WAIT_MS 50
#define LONGEST_WAIT_MS 1000
/* How long `wait` tolerates an unreachable server, so that it outlives a restart of the daemon. */
#define UNREACHABLE_MS 15000

char *command_job_path(const char *id, const char *rest)
{
    if (!*id || strspn(id, "0123456789abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ") != strlen(id)) {
        print_failure("this is not the id of a job");
        return NULL;
    }
    return mem_printf("/v1/jobs/%s%s", id, rest);
}

/* One line: id, state, outcome, and the error if there is one. */
static void print_job(json_at job)
{
    json_at fault = json_member(&job, "error");
    const char *outcome = json_string(json_member(&job, "outcome"), NULL);
    print_text(stdout, json_string(json_member(&job, "id"), "?"));
    putchar(' ');
    print_text(stdout, json_string(json_member(&job, "state"), "?"));
    if (outcome) {
        putchar(' ');
        print_text(stdout, outcome);
    }
    if (json_type_of(fault) == JSON_OBJECT) {
        putchar(' ');
        print_text(stdout, json_string(json_member(&fault, "code"), "?"));
        fputs(": ", stdout);
        print_text(stdout, json_string(json_member(&fault, "message"), ""));
    }
    putchar('\n');
}

static int code_of_end(json_at job)
{
    const char *state = json_string(json_member(&job, "state"), "");
    const char *outcome = json_string(json_member(&job, "outcome"), "");
    if (strcmp(state, "cancelled") == 0) return COMMAND_CANCELLED;
    if (strcmp(state, "succeeded") != 0) return COMMAND_FAILED;
    return strcmp(outcome, "converged") == 0 ? COMMAND_OK : COMMAND_NOT_CONVERGED;
}

static bool has_ended(json_at job)
{
    const char *state = json_string(json_member(&job, "state"), "");
    return strcmp(state, "succeeded") == 0 || strcmp(state, "failed") == 0 ||
           strcmp(state, "cancelled") == 0 || strcmp(state, "timed_out") == 0;
}

/* Sends a request and prints the answer: the document with --json, otherwise one line. */
static int call_and_print(client *c, const char *method, char *path, const command_options *options)
{
    error e = {0};
    client_reply reply = {0};
    int code = COMMAND_OK;
    if (!path) return COMMAND_USAGE;
    if (!client_call(c, method, path, NULL, 0, &reply, &e)) {
        code = print_unreachable(&e);
    } else if (reply.status >= 300 || !reply.document) {
        code = print_refused(&reply);
    } else if (options->json) {
        print_document(reply.document);
    } else {
        print_job(json_root(reply.document));
    }
    client_reply_clear(&reply);
    free(path);
    return code;
}

int command_show(client *c, const char *argument, const command_options *options)
{
    return call_and_print(c, "GET", command_job_path(argument, ""), options);
}

int command_pause(client *c, const char *argument, const command_options *options)
{
    return call_and_print(c, "POST", command_job_path(argument, "/pause"), options);
}

int command_resume(client *c, const char *argument, const command_options *options)
{
    return call_and_print(c, "POST", command_job_path(argument, "/resume"), options);
}

int command_retry(client *c, const char *argument, const command_options *options)
{
    return call_and_print(c, "POST", command_job_path(argument, "/retry"), options);
}

int command_cancel(client *c, const char *argument, const command_options *options)
{
    return call_and_print(c, "POST", command_job_path(argument, "/cancel"), options);
}

/* Waits for the end of the job and prints it. */
static int wait_for(client *c, char *path, const command_options *options)
{
    int wait_ms = FIRST_WAIT_MS, code = COMMAND_OK;
    int64_t heard_ms = clock_monotonic_ms();
    bool done = false;
    progress_bar m;
    if (!path) return COMMAND_USAGE;
    progress_bar_init(&m);
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
            done = has_ended(job);
            if (!done) {
                progress_bar_show(&m, job);
            } else {
                progress_bar_clear(&m);
                if (options->json)
                    print_document(reply.document);
                else
                    print_job(job);
                code = code_of_end(job);
            }
        }
        client_reply_clear(&reply);
        if (!done) poll(NULL, 0, wait_ms);
        wait_ms = wait_ms * 3 / 2 < LONGEST_WAIT_MS ? wait_ms * 3 / 2 : LONGEST_WAIT_MS;
    }
    free(path);
    return code;
}

int command_wait(client *c, const char *argument, const command_options *options)
{
    return wait_for(c, command_job_path(argument, ""), options);
}

/* All of standard input, to be freed; NULL when it cannot be read or is longer than a spec. */
static char *read_input(size_t *length, error *e)
{
    char *text = mem_alloc(1);
    size_t used = 0, got;
    do {
        text = mem_resize(text, used + 65537);
        got = fread(text + used, 1, 65536, stdin);
        used += got;
    } while (got > 0 && used <= SPEC_LIMIT_BYTES);
    if (!ferror(stdin) && used <= SPEC_LIMIT_BYTES) {
        text[used] = '\0';
        *length = used;
        return text;
    }
    if (ferror(stdin))
        error_set(e, ERROR_INTERNAL, "standard input cannot be read: %s", strerror(errno));
    else
        error_set(e, ERROR_INTERNAL, "standard input has more than %u bytes", SPEC_LIMIT_BYTES);
    free(text);
    return NULL;
}

int command_submit(client *c, const char *argument, const command_options *options)
{
    error e = {0};
    size_t length = 0;
    client_reply reply = {0};
    char *body = strcmp(argument, "-") == 0 ? read_input(&length, &e)
                                            : store_file_read(argument, SPEC_LIMIT_BYTES, &length, &e);
    if (!body) {
        print_failure(e.message);
        return COMMAND_USAGE;
    }
    int code = COMMAND_OK;
    char *path = NULL;
    if (!client_call(c, "POST", "/v1/jobs", body, length, &reply, &e)) {
        code = print_unreachable(&e);
    } else if (reply.status != 201 || !reply.document) {
        code = print_refused(&reply);
    } else {
        json_at job = json_root(reply.document);
        const char *id = json_string(json_member(&job, "id"), "");
        if (options->wait) {
            fprintf(stderr, "job %s\n", id); /* so that the user knows it when the wait is interrupted */
            path = command_job_path(id, "");
        } else if (options->json) {
            print_document(reply.document);
        } else {
            puts(id);
        }
    }
    client_reply_clear(&reply);
    free(body);
    return code == COMMAND_OK && options->wait ? wait_for(c, path, options) : code;
}

static void print_row(json_at job)
{
    printf("%-26s  ", json_string(json_member(&job, "id"), "?"));
    printf("%-10s  ", json_string(json_member(&job, "state"), "?"));
    printf("%-13s  ", json_string(json_member(&job, "outcome"), "-"));
    printf("%8.0f  ", json_number(json_member(&job, "priority"), 0));
    printf("%-24s  ", json_string(json_member(&job, "created"), "?"));
    print_text(stdout, json_string(json_member(&job, "name"), "-"));
    putchar('\n');
}

int command_list(client *c, const char *argument, const command_options *options)
{
    (void)argument;
    error e = {0};
    client_reply reply = {0};
    int code = COMMAND_OK;
    char *state = options->state ? client_escape(c, options->state) : NULL;
    char *limit = options->limit ? client_escape(c, options->limit) : NULL;
    char *path = mem_printf("/v1/jobs%s%s%s%s", state ? "?state=" : "", state ? state : "",
                            !limit  ? ""
                            : state ? "&limit="
                                    : "?limit=",
                            limit ? limit : "");
    free(state);
    free(limit);
    if (!client_call(c, "GET", path, NULL, 0, &reply, &e)) {
        code = print_unreachable(&e);
    } else if (reply.status != 200 || !reply.document) {
        code = print_refused(&reply);
    } else if (options->json) {
        print_document(reply.document);
    } else {
        json_at root = json_root(reply.document), jobs = json_member(&root, "jobs");
        printf("%-26s  %-10s  %-13s  %8s  %-24s  %s\n", "ID", "STATE", "OUTCOME", "PRIORITY", "CREATED",
               "NAME");
        for (size_t i = 0; i < json_size(jobs); i++) print_row(json_element(&jobs, i));
        if (json_type_of(json_member(&root, "next")) == JSON_STRING)
            fputs("hexadctl: there are more jobs; see --limit\n", stderr);
    }
    client_reply_clear(&reply);
    free(path);
    return code;
}

/* Downloads one result to a temporary file, verifies its hash and renames it. */
static int fetch_file(client *c, const char *directory, json_at item, error *e)
{
    const char *name = json_string(json_member(&item, "name"), "");
    const char *href = json_string(json_member(&item, "href"), "");
    const char *wanted = json_string(json_member(&item, "sha256"), "");
    /* the name comes from the network and becomes a file name here */
    if (!*name || *name == '.' || strchr(name, '/') || strncmp(href, "/v1/", 4) != 0) {
        error_set(e, ERROR_INTERNAL, "the server lists a result without a plain name");
        return COMMAND_FAILED;
    }
    store_file file = {0};
    char hex[STORE_HASH_SIZE] = "";
    uint64_t bytes = 0;
    long status = 0;
    int code = COMMAND_FAILED;
    char *path = mem_printf("%s/%s", directory, name);
    if (!store_file_begin(path, &file, e)) goto done;
    if (!client_download(c, href, file.stream, &status, e)) {
        if (ferror(file.stream))
            error_set(e, ERROR_INTERNAL, "%s cannot be written", path);
        else
            code = COMMAND_UNREACHABLE;
        goto done;
    }
    if (status != 200) {
        error_set(e, ERROR_INTERNAL, "%s: the server answered %ld", name, status);
        goto done;
    }
    if (fflush(file.stream) != 0 || !store_file_hash(fileno(file.stream), hex, &bytes, e)) goto done;
    if (strcmp(hex, wanted) != 0) {
        error_set(e, ERROR_INPUT_DAMAGED, "%s: the received bytes do not have the announced SHA-256", name);
        goto done;
    }
    if (store_file_commit(&file, e)) code = COMMAND_OK;
done:
    if (code != COMMAND_OK && e->code == ERROR_NONE)
        error_set(e, ERROR_INTERNAL, "%s cannot be written", path);
    store_file_abort(&file);
    free(path);
    return code;
}

static int fetch_all(client *c, const char *directory, json_at results, const command_options *options)
{
    error e = {0};
    if (!store_directory_create(directory, &e)) return print_failure(e.message);
    for (size_t i = 0; i < json_size(results); i++) {
        json_at item = json_element(&results, i);
        int code = fetch_file(c, directory, item, &e);
        if (code != COMMAND_OK) {
            print_failure(e.message);
            return code;
        }
        if (options->json) continue;
        print_text(stdout, directory);
        putchar('/');
        print_text(stdout, json_string(json_member(&item, "name"), ""));
        putchar('\n');
    }
    return COMMAND_OK;
}

int command_fetch(client *c, const char *argument, const command_options *options)
{
    error e = {0};
    client_reply reply = {0};
    int code;
    char *path = command_job_path(argument, "/results");
    if (!path) return COMMAND_USAGE;
    if (!client_call(c, "GET", path, NULL, 0, &reply, &e)) {
        code = print_unreachable(&e);
    } else if (reply.status != 200 || !reply.document) {
        code = print_refused(&reply);
    } else {
        json_at root = json_root(reply.document);
        code = fetch_all(c, options->output ? options->output : argument, json_member(&root, "results"),
                         options);
        if (code == COMMAND_OK && options->json) print_document(reply.document);
    }
    client_reply_clear(&reply);
    free(path);
    return code;
}
