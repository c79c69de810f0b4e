// SPDX-License-Identifier: Apache-2.0
#include "service/slurm/attempt_files.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/core/memory.h"
#include "base/json/json.h"
#include "files/file.h"

#define REQUEST "request.json"
#define BATCH "batch"
#define CLAIM "claim"
#define CANCEL "cancel"
#define REQUEUED "requeued"
#define ENDING "ending.json"

/* Limit of a request, which repeats the spec with escapes; a spec has at most body_limit_bytes. */
#define REQUEST_BYTES ((size_t)1 << 31)
#define SMALL_BYTES 65536
#define LIST_BYTES ((size_t)1 << 26)
/* Bytes of progress that one call reads, some hundred lines. The next call reads the following ones. */
#define PROGRESS_BYTES 65536

static char *path_of(const char *directory, const char *name)
{
    return mem_printf("%s/%s", directory, name);
}

/* Writes a file by rename, without a flush. */
static bool write_text(const char *directory, const char *name, const char *text, error *e)
{
    char *path = path_of(directory, name), *temporary = mem_printf("%s.new", path);
    FILE *file = fopen(temporary, "we");
    bool ok = file && fputs(text, file) >= 0;
    if (file && fclose(file) != 0) ok = false;
    ok = ok && rename(temporary, path) == 0;
    if (!ok) error_set(e, error_code_of_errno(errno), "cannot write %s: %s", path, strerror(errno));
    free(path);
    free(temporary);
    return ok;
}

/* Reads a JSON document. NULL on failure; *absent: the file does not exist. */
static json *read_document(const char *directory, const char *name, size_t limit, bool *absent, error *e)
{
    size_t length = 0;
    char *path = path_of(directory, name);
    char *text = store_file_read(path, limit, &length, e);
    *absent = !text && errno == ENOENT;
    json *document = text ? json_parse(text, length, e) : NULL;
    if (text && !document) error_prefix(e, "%s", path);
    free(text);
    free(path);
    return document;
}

static bool has(const char *directory, const char *name)
{
    struct stat info;
    char *path = path_of(directory, name);
    bool found = stat(path, &info) == 0;
    free(path);
    return found;
}

bool attempt_files_exist(const char *directory)
{
    return has(directory, REQUEST);
}

bool attempt_files_begin(const char *directory, const engine_request *r, error *e)
{
    char *out = path_of(directory, ATTEMPT_FILES_OUT);
    bool ok = store_directory_create(out, e);
    free(out);
    if (!ok) return false;
    json *document = json_new_object(), *roots = json_new_array();
    json_put_string(document, "worker", r->worker);
    json_put_string(document, "command", r->command);
    json_put_string(document, "spec", r->spec);
    for (size_t i = 0; i < r->input_root_count; i++) json_append_string(roots, r->input_roots[i]);
    json_put(document, "input_roots", roots);
    json_put_integer(document, "memory_mb", r->memory_mb);
    json_put_integer(document, "most_memory_mb", r->most_memory_mb);
    json_put_integer(document, "file_mb", r->file_mb);
    json_put_string(document, "sandbox", sandbox_mode_name(r->sandbox));
    json_put_integer(document, "threads", r->threads);
    json_put_integer(document, "frame", r->frame);
    json_put_string(document, "trace", r->trace);
    json_put_string(document, "previous", r->previous);
    char *text = json_print(document);
    ok = write_text(directory, REQUEST, text, e);
    free(text);
    json_free(document);
    return ok;
}

static char *copy_member(const json_at *root, const char *key)
{
    const char *text = json_string(json_member(root, key), NULL);
    return text ? mem_strdup(text) : NULL;
}

bool attempt_files_read_request(const char *directory, engine_request *request, error *e)
{
    bool absent;
    json *document = read_document(directory, REQUEST, REQUEST_BYTES, &absent, e);
    if (!document) return false;
    json_at root = json_root(document), list = json_member(&root, "input_roots");
    char **roots = mem_alloc((json_size(list) + 1) * sizeof *roots);
    engine_request r = {
        .worker = copy_member(&root, "worker"),
        .command = copy_member(&root, "command"),
        .spec = copy_member(&root, "spec"),
        .trace = copy_member(&root, "trace"),
        .previous = copy_member(&root, "previous"),
        .directory = path_of(directory, ATTEMPT_FILES_OUT),
        .input_roots = (const char *const *)roots,
        .input_root_count = json_size(list),
        .memory_mb = (int64_t)json_number(json_member(&root, "memory_mb"), 0),
        .most_memory_mb = (int64_t)json_number(json_member(&root, "most_memory_mb"), 0),
        .file_mb = (int64_t)json_number(json_member(&root, "file_mb"), 0),
        .threads = (int)json_number(json_member(&root, "threads"), 0),
        .frame = (int)json_number(json_member(&root, "frame"), QUEUE_NO_FRAME),
    };
    bool ok = r.worker && r.command && r.spec && r.memory_mb > 0 && r.threads > 0 &&
              sandbox_mode_from_name(json_string(json_member(&root, "sandbox"), ""), &r.sandbox);
    for (json_at path = json_first(&list); path.node; path = json_next(&path))
        roots[path.index] = mem_strdup(json_string(path, ""));
    json_free(document);
    if (ok)
        *request = r;
    else
        attempt_files_clear_request(&r);
    return ok || error_set(e, ERROR_INTERNAL,
                           "%s/" REQUEST
                           " is not a request of this version: use the same version of hexad on all hosts",
                           directory);
}

void attempt_files_clear_request(engine_request *r)
{
    for (size_t i = 0; i < r->input_root_count; i++) free((char *)r->input_roots[i]);
    free((char **)r->input_roots);
    free((char *)r->worker);
    free((char *)r->command);
    free((char *)r->spec);
    free((char *)r->trace);
    free((char *)r->previous);
    free((char *)r->directory);
    *r = (engine_request){0};
}

static char *print_batch(const attempt_files_batch *batch)
{
    return mem_printf("%s %d %d\n", batch->name, batch->task, batch->number);
}

bool attempt_files_write_batch(const char *directory, const attempt_files_batch *batch, error *e)
{
    char *text = print_batch(batch);
    bool ok = write_text(directory, BATCH, text, e);
    free(text);
    return ok;
}

/* Reads a batch. False if the file does not exist. *batch is empty if the file is incomplete. */
static bool read_batch(const char *directory, const char *name, attempt_files_batch *batch)
{
    size_t length = 0;
    char *path = path_of(directory, name), *text = store_file_read(path, SMALL_BYTES, &length, NULL);
    bool found = text;
    *batch = (attempt_files_batch){0};
    if (text &&
        (!strchr(text, '\n') || sscanf(text, "%191s %d %d", batch->name, &batch->task, &batch->number) != 3 ||
         batch->task < 0))
        *batch = (attempt_files_batch){0};
    free(text);
    free(path);
    return found;
}

bool attempt_files_read_batch(const char *directory, attempt_files_batch *batch)
{
    return read_batch(directory, BATCH, batch) && *batch->name;
}

void attempt_files_add_name(attempt_files_names *names, const char *name, size_t length)
{
    mem_add_text(&names->name, &names->count, mem_strndup(name, length));
}

void attempt_files_clear_names(attempt_files_names *names)
{
    mem_free_texts(names->name, names->count);
    *names = (attempt_files_names){0};
}

bool attempt_files_write_list(const char *farm, const char *list, const attempt_files_names *names, error *e)
{
    size_t capacity = 1, used = 0;
    for (size_t i = 0; i < names->count; i++) capacity += strlen(names->name[i]) + 1;
    char *text = mem_alloc(capacity);
    for (size_t i = 0; i < names->count; i++) used += (size_t)sprintf(text + used, "%s\n", names->name[i]);
    bool ok = write_text(farm, list, text, e);
    free(text);
    return ok;
}

attempt_files_names attempt_files_read_list(const char *farm, const char *list)
{
    attempt_files_names names = {0};
    size_t length = 0;
    char *path = path_of(farm, list), *text = store_file_read(path, LIST_BYTES, &length, NULL);
    for (const char *line = text; line && *line;) {
        size_t one = strcspn(line, "\n");
        attempt_files_add_name(&names, line, one);
        line += one + (line[one] == '\n');
    }
    free(text);
    free(path);
    return names;
}

attempt_files_claim attempt_files_take(const char *directory, const attempt_files_batch *by)
{
    char *path = path_of(directory, CLAIM), *text = by ? print_batch(by) : NULL;
    int fd = open(path, O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0600), why = errno;
    if (fd >= 0 && text) {
        ssize_t written = write(fd, text, strlen(text));
        (void)written; /* the existence of the claim is sufficient; its text is optional */
    }
    if (fd >= 0) close(fd);
    free(path);
    free(text);
    if (fd >= 0) return ATTEMPT_FILES_WON;
    return why == EEXIST ? ATTEMPT_FILES_TAKEN : why == ENOENT ? ATTEMPT_FILES_GONE : ATTEMPT_FILES_UNCLEAR;
}

bool attempt_files_read_claim(const char *directory, attempt_files_batch *by)
{
    return read_batch(directory, CLAIM, by);
}

bool attempt_files_note_requeue(const char *directory, error *e)
{
    return write_text(directory, REQUEUED, "", e);
}

bool attempt_files_is_requeued(const char *directory)
{
    return has(directory, REQUEUED);
}

bool attempt_files_cancel(const char *directory, error *e)
{
    return write_text(directory, CANCEL, "", e);
}

bool attempt_files_is_cancelled(const char *directory)
{
    return has(directory, CANCEL) || (!has(directory, REQUEST) && errno == ENOENT);
}

bool attempt_files_write_ending(const char *directory, const engine_ending *ending, error *e)
{
    json *document = json_new_object();
    json_put_integer(document, "exit_status", ending->exit_status);
    json_put_integer(document, "signal", ending->signal);
    json_put_integer(document, "peak_memory_bytes", ending->peak_memory_bytes);
    json_put_integer(document, "processor_ms", ending->processor_ms);
    json_put_integer(document, "ran_ms", ending->ran_ms);
    json_put_string(document, "host", ending->host);
    json_put_string(document, "last_words", ending->last_words);
    char *text = json_print(document), *path = path_of(directory, ENDING);
    bool ok = store_file_write(path, text, strlen(text), e);
    free(path);
    free(text);
    json_free(document);
    return ok;
}

bool attempt_files_read_ending(const char *directory, engine_ending *ending, bool *found, error *e)
{
    bool absent;
    json *document = read_document(directory, ENDING, 1 << 20, &absent, e);
    *found = document != NULL;
    if (!document) return absent;
    json_at root = json_root(document);
    *ending = (engine_ending){
        .exit_status = (int)json_number(json_member(&root, "exit_status"), -1),
        .signal = (int)json_number(json_member(&root, "signal"), -1),
        .peak_memory_bytes = (int64_t)json_number(json_member(&root, "peak_memory_bytes"), 0),
        .processor_ms = (int64_t)json_number(json_member(&root, "processor_ms"), 0),
        .ran_ms = (int64_t)json_number(json_member(&root, "ran_ms"), 0),
        .last_words = mem_strdup(json_string(json_member(&root, "last_words"), "")),
    };
    snprintf(ending->host, sizeof ending->host, "%s", json_string(json_member(&root, "host"), ""));
    json_free(document);
    return true;
}

/* The file is closed each time: other hosts of a network file system see the data only after that. */
bool attempt_files_add_progress(const char *directory, const char *lines)
{
    char *path = path_of(directory, ATTEMPT_FILES_PROGRESS);
    int fd = open(path, O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0600);
    free(path);
    if (fd < 0) return false;
    size_t length = strlen(lines);
    bool ok = write(fd, lines, length) == (ssize_t)length;
    return close(fd) == 0 && ok;
}

char *attempt_files_read_progress(const char *directory, int64_t *offset)
{
    char block[PROGRESS_BYTES];
    char *path = path_of(directory, ATTEMPT_FILES_PROGRESS), *line = NULL;
    int fd = open(path, O_RDONLY | O_CLOEXEC);
    free(path);
    if (fd < 0) return NULL;
    ssize_t got = pread(fd, block, sizeof block, *offset);
    close(fd);
    while (got > 0 && block[got - 1] != '\n') got--;
    if (got > 0) {
        ssize_t first = got - 1;
        while (first > 0 && block[first - 1] != '\n') first--;
        line = mem_strndup(block + first, (size_t)(got - 1 - first));
        *offset += got;
    }
    return line;
}

bool attempt_files_deliver(const char *directory, const char *to, error *e)
{
    char *out = path_of(directory, ATTEMPT_FILES_OUT);
    bool ok =
        rename(out, to) == 0 || errno == ENOENT ||
        error_set(e, error_code_of_errno(errno), "cannot rename %s to %s: %s", out, to, strerror(errno));
    free(out);
    return ok;
}
