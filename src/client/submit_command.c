// SPDX-License-Identifier: Apache-2.0
/* submit_command: the commands submit, validate, estimate, upload and inspect of hexadctl. */
#include <errno.h>
#include <fcntl.h>
#include <glob.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/core/compare.h"
#include "base/core/frames.h"
#include "base/core/memory.h"
#include "base/core/terminal_text.h"
#include "client/command.h"
#include "client/job_name.h"
#include "client/print.h"
#include "files/file.h"
#include "files/sent_file.h"
#include "spec/sample_spec.h"

#define SPEC_LIMIT_BYTES (64u << 20)

/* Reads all of standard input; the caller frees the text. NULL if it cannot be read or is longer than the
 * limit of a spec. */
static char *read_input(size_t *length, error *e)
{
    char *text = store_stream_read(stdin, SPEC_LIMIT_BYTES, length);
    if (!text && errno == EFBIG)
        error_set(e, ERROR_INTERNAL,
                  "standard input is longer than %u bytes: put the data into a file that the spec names",
                  SPEC_LIMIT_BYTES);
    else if (!text)
        error_set(e, ERROR_INTERNAL, "cannot read standard input: %s", strerror(errno));
    return text;
}

#define JOBS "/v1/jobs"
/* Maximum time, in ms, that a submission waits for the check of its inputs. Users do not notice this delay,
 * and most files can be opened in it. */
#define FAULTS_WITHIN_MS 200

static bool is_standard_input(const char *path)
{
    return strcmp(path, "-") == 0;
}

/* The name of the spec's file in messages. */
static const char *name_of(const char *path)
{
    return is_standard_input(path) ? "standard input" : path;
}

/* The member of an object; it is added if it is missing. NULL if it has another type. */
static json *member_of_type(json *object, const char *pointer, json_type type)
{
    json *found = json_find(object, pointer);
    if (!found)
        return type == JSON_OBJECT ? json_put_object(object, pointer + 1)
                                   : json_put_array(object, pointer + 1);
    return json_type_of(json_root(found)) == type ? found : NULL;
}

/* Whether an option changes the spec. */
static bool has_changes(const command_options *options)
{
    return options->priority || options->name || options->frames || options->files || options->label.count ||
           options->depends_on.count || options->set.count;
}

/* Appends the values of an option to an array of the group `queue`. */
static void append_values(json *queue, const char *pointer, const option_words *values)
{
    json *list = values->count ? member_of_type(queue, pointer, JSON_ARRAY) : NULL;
    for (size_t i = 0; list && i < values->count; i++) json_append_string(list, values->item[i]);
}

/* Puts the options into the spec. Members of a wrong type are unchanged; the server refuses them. */
static bool apply_options(json *document, const command_options *options)
{
    error e = {0};
    char *end = NULL;
    long priority = options->priority ? strtol(options->priority, &end, 10) : 0;
    if (options->priority && (!*options->priority || *end)) {
        print_failure("submit: --priority must be a whole number (given %s)", options->priority);
        return false;
    }
    if (json_type_of(json_root(document)) != JSON_OBJECT) return true;
    if (options->name) json_put_string(document, "name", options->name);
    json *queue = options->priority || options->frames || options->files || options->label.count ||
                          options->depends_on.count
                      ? member_of_type(document, "/queue", JSON_OBJECT)
                      : NULL;
    if (queue) {
        if (options->priority) json_put_integer(queue, "priority", priority);
        if (options->frames) json_put_string(queue, "frames", options->frames);
        if (options->files) json_put_string(queue, "files", options->files);
        append_values(queue, "/labels", &options->label);
        append_values(queue, "/depends_on", &options->depends_on);
    }
    for (size_t i = 0; i < options->set.count; i++)
        if (!sample_spec_set(document, options->set.item[i], &e)) {
            print_failure("submit: %s", e.message);
            return false;
        }
    return true;
}

/* Reads the spec at the path, or takes the given text, and applies the options. Returns text that the caller
 * frees; NULL, after a message, on failure. */
static char *read_spec(const char *path, const char *given, const command_options *options, size_t *length)
{
    error e = {0};
    if (given) *length = strlen(given);
    char *text = given                     ? mem_strdup(given)
                 : is_standard_input(path) ? read_input(length, &e)
                                           : store_file_read(path, SPEC_LIMIT_BYTES, length, &e);
    json *document = text ? json_parse(text, *length, &e) : NULL;
    if (!document) {
        if (text) error_prefix(&e, "%s: a spec must be a valid JSON document", name_of(path));
        if (!given) sample_spec_advise("hexadctl", path, &e);
        print_failure("%s", e.message);
        free(text);
        text = NULL;
    } else if (has_changes(options)) {
        free(text);
        text = apply_options(document, options) ? json_print(document) : NULL;
        *length = text ? strlen(text) : 0;
    }
    json_free(document);
    return text;
}

/* Checks that the key, if there is one, can be the value of a header; otherwise prints a message. The server
 * checks the rest. */
static bool has_usable_key(const command_options *options)
{
    const char *key = options->key;
    bool usable = !key || (*key && !strpbrk(key, "\r\n"));
    if (!usable) print_failure("submit: --key must be one line of printable ASCII characters");
    return usable;
}

/* Requests a check of the job's inputs before the job waits in the queue. The time for the answer is
 * limited. */
static void look_for_faults(client *c, const char *body, size_t length, client_reply *found)
{
    error e = {0};
    char *to = mem_printf("/v1/jobs:validate?within_ms=%d", FAULTS_WITHIN_MS);
    client_post_within(c, to, body, length, FAULTS_WITHIN_MS, found, &e);
    free(to);
}

/* Prints the fault in the inputs of a job that was accepted. */
static void warn_of_faults(const client_reply *found, const char *spec)
{
    json_at root = json_root(found->document);
    if (found->status != 422)
        return; /* the spec and its inputs are good as far as known, or nothing is known of them */
    fputs("warning: ", stderr);
    terminal_text_put(stderr, spec);
    fputs(": ", stderr);
    const char *detail = json_string(json_member(&root, "detail"), "?");
    terminal_text_put(stderr, detail);
    if (!*detail || detail[strlen(detail) - 1] != '.') fputc('.', stderr);
    fputs(" The job is accepted, and fails if this is still so when it runs.\n", stderr);
}

/* Posts the spec at the path, or the given text. `final`: its inputs cannot change, so the job is not submitted if
 * they are found to have a fault. On success the caller frees *document. */
static int post_spec(client *c, const char *to, const char *path, const char *given, bool final,
                     const command_options *options, json **document)
{
    error e = {0};
    size_t length = 0;
    client_reply reply = {0};
    int code = COMMAND_OK;
    client_reply found = {0};
    char *body = has_usable_key(options) ? read_spec(path, given, options, &length) : NULL;
    if (!body) return COMMAND_USAGE;
    if (strcmp(to, JOBS) == 0) look_for_faults(c, body, length, &found);
    if (final && found.status == 422) {
        code = print_refused_spec(&found, name_of(path));
    } else if (!client_post_once(c, to, options->key, body, length, &reply, &e)) {
        code = print_unreachable(&e);
    } else if (reply.status >= 300 || !reply.document) {
        code = print_refused_spec(&reply, name_of(path));
    } else {
        *document = reply.document;
        reply.document = NULL;
        warn_of_faults(&found, name_of(path));
    }
    client_reply_clear(&found);
    client_reply_clear(&reply);
    free(body);
    return code;
}

static int submit(client *c, const char *from, const char *given, const command_options *options)
{
    json *document = NULL;
    if (options->accept && !options->wait) {
        print_failure("--accept requires --wait");
        return COMMAND_USAGE;
    }
    int code = post_spec(c, JOBS, from, given, false, options, &document);
    json_at job = json_root(document);
    const char *id = json_string(json_member(&job, "id"), "");
    if (code == COMMAND_OK && !options->json) command_explain_waiting(c, stderr);
    if (code == COMMAND_OK && options->wait) {
        char *path = command_job_path(id, "");
        /* printed first, so that the id is known if the wait is interrupted */
        terminal_text_print(stderr, "job %s\n", id);
        code = path ? command_wait_for(c, path, options) : COMMAND_FAILED;
        free(path);
    } else if (code == COMMAND_OK && options->json) {
        print_document(document);
    } else if (code == COMMAND_OK) {
        terminal_text_print(stdout, "%s\n", id);
    }
    json_free(document);
    return code;
}

int command_submit(client *c, const char *argument, const command_options *options)
{
    command_options own = *options;
    const size_t count = own.depends_on.count;
    char **ids = mem_alloc(count * sizeof *ids);
    int code = COMMAND_OK;
    for (size_t i = 0; code == COMMAND_OK && i < count; i++)
        code = job_name_resolve(c, options->depends_on.item[i], &ids[i]);
    own.depends_on.item = (const char **)ids;
    if (code == COMMAND_OK) code = submit(c, argument, NULL, &own);
    mem_free_texts(ids, count);
    return code;
}

int command_post_text(client *c, const char *spec, bool final, const command_options *options, json **job)
{
    int code = post_spec(c, JOBS, "the spec", spec, final, options, job);
    if (code == COMMAND_OK) command_explain_waiting(c, stderr);
    return code;
}

int command_submit_text(client *c, const char *spec, const command_options *options)
{
    return submit(c, "the spec of the job", spec, options);
}

int command_validate(client *c, const char *argument, const command_options *options)
{
    json *document = NULL;
    int code = post_spec(c, "/v1/jobs:validate", argument, NULL, false, options, &document);
    if (code == COMMAND_OK && options->json) {
        print_document(document);
    } else if (code == COMMAND_OK) {
        terminal_text_put(stdout, name_of(argument));
        puts(": the spec is valid");
    }
    json_free(document);
    return code;
}

/* Prints the estimate of a single job, or of the first frame of an array. */
static void print_estimate(json_at document)
{
    json_at estimate = json_member(&document, "estimate"), spec = json_member(&document, "spec"),
            queue = json_member(&spec, "queue");
    const char *frames = json_string(json_member(&queue, "frames"), NULL);
    json_at count = json_member(&estimate, "count"), seconds = json_member(&estimate, "seconds");
    double threads = json_number(json_member(&estimate, "threads"), 1);
    if (frames) {
        fputs("of the first frame of ", stdout);
        terminal_text_put(stdout, frames);
        putchar('\n');
    }
    printf("points   %.0f\n", json_number(count, 0));
    printf("area     %.6g\n", json_number(json_member(&estimate, "area"), 0));
    printf("memory   %.0f MiB\n", json_number(json_member(&estimate, "memory_bytes"), 0) / (1 << 20));
    if (json_type_of(seconds) == JSON_NUMBER) {
        const double weights_s = json_number(json_member(&estimate, "weights_seconds"), 0);
        terminal_text_print(stdout, "time     %.3g s with %.0f thread%s, without writing the results",
                            json_number(seconds, 0), threads, threads == 1 ? "" : "s");
        if (weights_s > 0) printf("; of this, weights: %.3g s", weights_s);
        putchar('\n');
    } else {
        fputs("time     unknown: ", stdout);
        terminal_text_put(stdout, json_string(json_member(&estimate, "seconds_missing"), "?"));
        putchar('\n');
    }
    print_notes(stdout, estimate);
}

int command_estimate(client *c, const char *argument, const command_options *options)
{
    json *document = NULL;
    int code = post_spec(c, "/v1/jobs:validate", argument, NULL, false, options, &document);
    json_at root = json_root(document), estimate = json_member(&root, "estimate");
    bool known = json_type_of(estimate) == JSON_OBJECT;
    if (code == COMMAND_OK && options->json) print_document(document);
    if (code == COMMAND_OK && known && !options->json) print_estimate(root);
    if (code == COMMAND_OK && !known)
        code = print_failure("%s is valid, and the job was not estimated: %s", name_of(argument),
                             json_string(json_member(&root, "estimate_missing"), "the answer has no reason"));
    json_free(document);
    return code;
}

int command_knows_file(client *c, const char *hex, bool *known)
{
    error e = {0};
    client_reply reply = {0};
    char *path = mem_printf("/v1/inputs/%s", hex);
    int code = client_call(c, "GET", path, NULL, 0, &reply, &e) ? COMMAND_OK : print_unreachable(&e);
    *known = code == COMMAND_OK && reply.status == 200;
    client_reply_clear(&reply);
    free(path);
    return code;
}

int command_send_file(client *c, FILE *file, const char *path, const char *hex, uint64_t bytes, bool always,
                      json **document)
{
    error e = {0};
    client_reply reply = {0};
    int code = COMMAND_OK;
    const char *slash = strrchr(path, '/');
    char *name = client_escape(c, slash ? slash + 1 : path),
         *to = mem_printf("/v1/inputs/%s?name=%s", hex, name);
    if (!client_upload(c, to, file, (int64_t)bytes, always, &reply, &e)) {
        code = ferror(file) ? print_failure("cannot read %s", path) : print_unreachable(&e);
    } else if (reply.status >= 300 || !reply.document) {
        code = print_refused_spec(&reply, path);
    } else {
        *document = reply.document;
        reply.document = NULL;
    }
    client_reply_clear(&reply);
    free(name);
    free(to);
    return code;
}

int command_open_file(const char *path, FILE **file, char hex[STORE_HASH_SIZE], uint64_t *bytes)
{
    error e = {0};
    struct stat info;
    int code = COMMAND_USAGE;
    const int fd = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK); /* does not wait for the writer of a pipe */
    FILE *opened = fd >= 0 ? fdopen(fd, "rb") : NULL;
    if (!opened)
        print_failure("cannot read %s: %s. Check the path.", path, strerror(errno));
    else if (fstat(fileno(opened), &info) != 0 || !S_ISREG(info.st_mode))
        print_failure("%s is not a regular file: give the path of a file", path);
    else if (!store_file_hash(fileno(opened), hex, bytes, &e))
        code = print_failure("%s: %s", path, e.message);
    else
        code = COMMAND_OK;
    if (code == COMMAND_OK)
        *file = opened;
    else if (opened)
        fclose(opened);
    return code;
}

/* Sends the bytes also if the service has the file: they replace it if it is damaged. */
static int upload_file(client *c, const char *argument, const command_options *options)
{
    char hex[STORE_HASH_SIZE] = "";
    uint64_t bytes = 0;
    json *document = NULL;
    FILE *file = NULL;
    int code = command_open_file(argument, &file, hex, &bytes);
    bool known = false;
    if (code == COMMAND_OK) code = command_knows_file(c, hex, &known);
    if (code == COMMAND_OK) code = command_send_file(c, file, argument, hex, bytes, known, &document);
    if (code == COMMAND_OK && options->json)
        print_document(document);
    else if (code == COMMAND_OK)
        terminal_text_print(stdout, STORE_INPUT_PREFIX "%s%s\n", hex, sample_spec_ending(argument));
    if (file) fclose(file);
    json_free(document);
    return code;
}

/* The numbers of the files that match the pattern, ascending; the caller frees them. */
static int *list_frames(const char *pattern, size_t *count)
{
    glob_t found = {0};
    int *frame = NULL;
    char *wide = mem_printf("%.*s*", (int)frames_prefix(pattern), pattern);
    if (glob(wide, GLOB_NOESCAPE, NULL, &found) == 0) {
        frame = mem_alloc(found.gl_pathc * sizeof *frame);
        for (size_t i = 0; i < found.gl_pathc; i++)
            if (frames_match(pattern, found.gl_pathv[i], &frame[*count])) ++*count;
        qsort(frame, *count, sizeof *frame, compare_ints);
    }
    globfree(&found);
    free(wide);
    return frame;
}

int command_upload(client *c, const char *argument, const command_options *options)
{
    if (!frames_is_pattern(argument) || access(argument, F_OK) == 0) return upload_file(c, argument, options);
    size_t count = 0;
    int *frame = list_frames(argument, &count), code = COMMAND_OK;
    if (!count) {
        print_failure("%s: no file matches this pattern: check the directory and the name", argument);
        code = COMMAND_USAGE;
    }
    for (size_t i = 0; code == COMMAND_OK && i < count; i++) {
        char *path = frames_path(argument, frame[i]);
        code = upload_file(c, path, options);
        free(path);
    }
    if (count && code == COMMAND_OK)
        print_failure(
            "to sample these files by one job, write {file} for the path and list the names in queue.files: "
            "\"surface\": {\"%s\": {\"path\": \"{file}\"}}, \"queue\": {\"files\": [\"" STORE_INPUT_PREFIX
            "...%s\", ...]}",
            sample_spec_member(file_format_of_name(argument)), sample_spec_ending(argument));
    free(frame);
    return code;
}

int command_inspect(client *c, const char *argument, const command_options *options)
{
    json *asked = json_new_object(), *document = NULL;
    json_put_string(asked, "path", argument);
    char *body = json_print(asked),
         *doing = mem_printf("inspecting %s: the service reads all of it", argument);
    int code = command_ask_showing(c, "POST", "/v1/inputs:inspect", body, doing, &document);
    json_at root = json_root(document);
    if (code == COMMAND_OK && options->json)
        print_document(document);
    else if (code == COMMAND_OK)
        print_page(json_string(json_member(&root, "text"), ""));
    free(body);
    free(doing);
    json_free(asked);
    json_free(document);
    return code;
}
