// SPDX-License-Identifier: Apache-2.0
#include "service/results/result.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/core/log.h"
#include "base/core/manager.h"
#include "base/core/memory.h"
#include "base/core/worker_contract.h"
#include "base/json/json.h"
#include "base/json/json_copy.h"
#include "files/file.h"

/* Longest report that is read. A report has a record for each sweep, and a job may request a million
 * sweeps. */
#define REPORT_LIMIT_BYTES (256u << 20)
/* Longest document that result_peek reads; its callers delay other requests. */
#define SHORT_REPORT_BYTES (1u << 20)
/* Longest notes. In longer ones, the lists are replaced by a reference to report.json. */
#define NOTES_LIMIT_BYTES 16384
/* Most outputs of a result. A turntable has up to 360 frames. */
#define MAX_OUTPUTS 512
/* Name of the stored list. An output cannot have it, because names of outputs do not begin with '.'. */
#define LISTING_NAME ".listing.json"

char *result_directory(const char *work_dir, const char *id, int frame)
{
    return frame == QUEUE_NO_FRAME ? mem_printf("%s/results/%s", work_dir, id)
                                   : mem_printf("%s/results/%s.%d", work_dir, id, frame);
}

char *result_attempt_directory(const char *work_dir, const char *id, int frame, int attempt)
{
    return frame == QUEUE_NO_FRAME ? mem_printf("%s/attempts/%s.%d", work_dir, id, attempt)
                                   : mem_printf("%s/attempts/%s.%d.%d", work_dir, id, frame, attempt);
}

void result_clear(result *r)
{
    for (size_t i = 0; i < r->output_count; i++) free(r->output[i].name);
    free(r->output);
    free(r->notes);
    *r = (result){0};
}

static bool is_plain_name(const char *name)
{
    if (!*name || *name == '.' || strlen(name) > 255) return false;
    for (const char *c = name; *c; c++)
        if (*c == '/' || (unsigned char)*c < 0x20 || *c == 0x7F) return false;
    return true;
}

/* Whether this errno of open means that the file does not exist (or is a symbolic link), not that reading
 * failed. */
static bool is_absence(int fault)
{
    return fault == ENOENT || fault == ENOTDIR || fault == ELOOP;
}

int result_open_file(const char *directory, const char *name, int64_t *bytes, error *e)
{
    char *path = mem_printf("%s/%s", directory, name);
    int fd = open(path, O_RDONLY | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC);
    struct stat info;
    if (fd < 0) {
        error_set(e, is_absence(errno) ? ERROR_INPUT_DAMAGED : ERROR_INTERNAL,
                  "cannot open the result file %s: %s", name, strerror(errno));
    } else if (fstat(fd, &info) != 0 || !S_ISREG(info.st_mode)) {
        error_set(e, ERROR_INPUT_DAMAGED, "the result file %s is not a regular file", name);
        close(fd);
        fd = -1;
    } else {
        *bytes = (int64_t)info.st_size;
    }
    free(path);
    return fd;
}

static bool read_output(const char *directory, json_at at, result_output *output, error *e)
{
    json_at name = json_member(&at, "name"), bytes = json_member(&at, "bytes");
    json_at sha256 = json_member(&at, "sha256");
    const char *file = json_string(name, "");
    const char *hash = json_string(sha256, "");
    double size = json_number(bytes, -1);
    if (!is_plain_name(file) || strspn(hash, "0123456789abcdef") != 64 || hash[64] || !(size >= 0) ||
        size > 0x1p53 || size != floor(size))
        return error_set(e, ERROR_INPUT_DAMAGED,
                         "report.json lists an output without name, bytes and sha256");
    int64_t there = 0;
    int fd = result_open_file(directory, file, &there, e);
    if (fd < 0) return false;
    close(fd);
    if (there != (int64_t)size)
        return error_set(e, ERROR_INPUT_DAMAGED,
                         "the result file %s has %lld bytes, but its report states %.0f", file,
                         (long long)there, size);
    output->name = mem_strdup(file);
    output->bytes = there;
    memcpy(output->sha256, hash, sizeof output->sha256);
    return true;
}

/* Copies a member of an object to another object; null if it is missing. */
static void copy_member(json_at from, const char *key, json *to)
{
    json_at member = json_member(&from, key);
    if (member.node)
        json_put(to, key, json_copy(member.node));
    else
        json_put_null(to, key);
}

/* Prints the notes of a report, or of a stored list, which contains them as a member. To be freed. */
static char *read_notes(json_at report)
{
    json_at kept = json_member(&report, "notes"), surface = json_member(&report, "surface");
    if (json_type_of(kept) == JSON_OBJECT) return json_print(kept.node);
    json *notes = json_new_object();
    copy_member(report, "count", notes);
    copy_member(report, "spacing", notes);
    copy_member(report, "ratings", notes);
    copy_member(report, "outcome_reasons", notes);
    copy_member(surface, "warnings", notes);
    copy_member(report, "advice", notes);
    char *text = json_print(notes);
    if (strlen(text) > NOTES_LIMIT_BYTES) {
        json *warnings = json_new_array();
        json_append_string(warnings, "more are listed in report.json");
        json_put(notes, "warnings", warnings);
        json_put_array(notes, "outcome_reasons");
        json_put_array(notes, "advice");
        free(text);
        text = json_print(notes);
    }
    json_free(notes);
    return text;
}

static bool read_report(const char *directory, const json *report, result *r, error *e)
{
    json_at root = json_root(report);
    const char *hash = json_string(json_member(&root, "report_sha256"), "");
    const char *outcome = json_string(json_member(&root, "outcome"), "");
    double count = json_number(json_member(&root, "count"), -1);
    json_at outputs = json_member(&root, "outputs");
    r->outcome = queue_outcome_from_name(outcome);
    if (r->outcome == QUEUE_NO_OUTCOME)
        return error_set(e, ERROR_INPUT_DAMAGED, "report.json has no outcome");
    if (!(count >= 0) || count > 0x1p53 || count != floor(count))
        return error_set(e, ERROR_INPUT_DAMAGED, "report.json has no count");
    r->count = (int64_t)count;
    r->report_bytes = (int64_t)json_number(json_member(&root, "report_bytes"), -1);
    snprintf(r->report_sha256, sizeof r->report_sha256, "%s", hash);
    r->notes = read_notes(root);
    size_t listed = json_size(outputs);
    if (json_type_of(outputs) != JSON_ARRAY || listed > MAX_OUTPUTS)
        return error_set(e, ERROR_INPUT_DAMAGED, "report.json has no list of outputs");
    r->output = mem_alloc(listed * sizeof *r->output);
    for (json_at output = json_first(&outputs); output.node; output = json_next(&output)) {
        if (!read_output(directory, output, &r->output[r->output_count], e)) return false;
        r->output_count++;
    }
    return true;
}

/* The text of a report or summary with null for its sweeps, which are most of a long report. To be freed;
 * NULL on failure. */
static char *read_text(const char *directory, const char *name, size_t limit, size_t *length, error *e)
{
    int64_t bytes = 0;
    size_t replaced = 0;
    char *text = NULL;
    int fd = result_open_file(directory, name, &bytes, e);
    if (fd < 0) return NULL;
    FILE *from = fdopen(fd, "rb"), *to = open_memstream(&text, length);
    if (!from) close(fd);
    const bool fits = (uint64_t)bytes <= limit;
    bool copied = from && to && fits && json_copy_replacing(from, "sweeps", "null", to, &replaced);
    const bool failed = !from || !to || ferror(from) || ferror(to);
    if (from) fclose(from);
    if (to && fclose(to) != 0) copied = false;
    if (copied) return text;
    free(text);
    if (!fits)
        error_set(e, ERROR_INPUT_DAMAGED, "%s has more than %zu bytes", name, limit);
    else if (failed)
        error_set(e, ERROR_INTERNAL, "cannot read %s", name);
    else
        error_set(e, ERROR_INPUT_DAMAGED, "%s is not a JSON object", name);
    return NULL;
}

/* Reads and checks a document; returns it with null for its sweeps, to be freed; NULL on failure. */
static json *read_document(const char *directory, const char *name, size_t limit, result *r, error *e)
{
    size_t length = 0;
    result read = {0};
    error why = {0};
    char *text = read_text(directory, name, limit, &length, e);
    if (!text) return NULL;
    json *report = json_parse(text, length, &why);
    free(text);
    if (!report) {
        error_set(e, ERROR_INPUT_DAMAGED, "%s: %s", name, why.message);
        return NULL;
    }
    if (read_report(directory, report, &read, e)) {
        *r = read;
        return report;
    }
    result_clear(&read);
    json_free(report);
    return NULL;
}

/* The hash of the report is in its summary. */
json *result_read_report(const char *directory, result *r, error *e)
{
    result of_summary = {0};
    json *report = read_document(directory, WORKER_REPORT_NAME, REPORT_LIMIT_BYTES, r, e);
    if (report && result_read(directory, &of_summary, NULL))
        memcpy(r->report_sha256, of_summary.report_sha256, sizeof r->report_sha256);
    result_clear(&of_summary);
    return report;
}

static bool read_named(const char *directory, const char *name, size_t limit, result *r, error *e)
{
    json *report = read_document(directory, name, limit, r, e);
    json_free(report);
    return report != NULL;
}

/* Reads the summary, which contains all members that are read from a report. Results of earlier versions and
 * of other workers have no summary: then reads the report. */
static json *read_shortest(const char *directory, size_t limit, result *r, error *e)
{
    int64_t bytes = 0;
    int report = result_open_file(directory, WORKER_REPORT_NAME, &bytes, e);
    if (report < 0) return NULL;
    close(report);
    json *summary = read_document(directory, WORKER_SUMMARY_NAME, limit, r, NULL);
    if (summary && r->report_bytes == bytes) return summary;
    if (summary) { /* the report has another length: it was damaged or replaced */
        json_free(summary);
        result_clear(r);
    }
    return read_document(directory, WORKER_REPORT_NAME, limit, r, e);
}

json *result_read_short(const char *directory, result *r, error *e)
{
    return read_shortest(directory, REPORT_LIMIT_BYTES, r, e);
}

bool result_read(const char *directory, result *r, error *e)
{
    json *document = result_read_short(directory, r, e);
    json_free(document);
    return document != NULL;
}

bool result_peek(const char *directory, result *r)
{
    if (read_named(directory, LISTING_NAME, SHORT_REPORT_BYTES, r, NULL)) return true;
    json *document = read_shortest(directory, SHORT_REPORT_BYTES, r, NULL);
    json_free(document);
    return document != NULL;
}

void result_forget_list(const char *directory)
{
    char *list = mem_printf("%s/" LISTING_NAME, directory),
         *summary = mem_printf("%s/" WORKER_SUMMARY_NAME, directory);
    unlink(list);
    unlink(summary);
    free(list);
    free(summary);
}

bool result_hash_file(const char *directory, const char *name, char hex[STORE_HASH_SIZE], int64_t *bytes,
                      error *e)
{
    uint64_t hashed = 0;
    int fd = result_open_file(directory, name, bytes, e);
    if (fd < 0) return false;
    bool ok = store_file_hash(fd, hex, &hashed, e);
    close(fd);
    *bytes = (int64_t)hashed;
    return ok;
}

static bool compare_file(const char *directory, const char *name, const char *sha256,
                         const store_deadline *end, error *e)
{
    char hex[STORE_HASH_SIZE];
    int64_t bytes;
    uint64_t hashed;
    int fd = result_open_file(directory, name, &bytes, e);
    if (fd < 0) return false;
    bool ok = store_file_hash_until(fd, end, hex, &hashed, e) &&
              (strcmp(hex, sha256) == 0 || store_set_damaged(name, e));
    close(fd);
    return ok;
}

bool result_compare(const char *directory, const result *r, const store_deadline *end, error *e)
{
    for (size_t i = 0; i < r->output_count; i++)
        if (!compare_file(directory, r->output[i].name, r->output[i].sha256, end, e)) return false;
    return !*r->report_sha256 || compare_file(directory, WORKER_REPORT_NAME, r->report_sha256, end, e);
}

/* Bytes of results that any working disk reads in a second. */
static const double SLOW_BYTES = 1e7;

bool result_compare_at_start(const char *directory, const result *r, error *e)
{
    double bytes = 0;
    for (size_t i = 0; i < r->output_count; i++) bytes += (double)r->output[i].bytes;
    manager_report_starting(60 + bytes / SLOW_BYTES);
    return result_compare(directory, r, NULL, e);
}

/* Adds report.json to the outputs, with its length and the hash that the worker computed, or that of its
 * bytes. */
static bool append_report(const char *directory, result *r, error *e)
{
    result_output own = {0};
    if (!result_hash_file(directory, WORKER_REPORT_NAME, own.sha256, &own.bytes, e)) return false;
    if (*r->report_sha256) memcpy(own.sha256, r->report_sha256, sizeof own.sha256);
    own.name = mem_strdup(WORKER_REPORT_NAME);
    r->output = mem_resize(r->output, (r->output_count + 1) * sizeof *r->output);
    r->output[r->output_count++] = own;
    return true;
}

/* Prints the list for storing: the members of a report that read_report uses. To be freed. */
static char *print_listing(const result *r)
{
    json *document = json_new_object();
    json_put_string(document, "outcome", queue_outcome_name(r->outcome));
    json_put_integer(document, "count", r->count);
    json *outputs = json_put_array(document, "outputs");
    for (size_t i = 0; i < r->output_count; i++) {
        json *o = json_append_object(outputs);
        json_put_string(o, "name", r->output[i].name);
        json_put_integer(o, "bytes", r->output[i].bytes);
        json_put_string(o, "sha256", r->output[i].sha256);
    }
    json_put_text(document, "notes", r->notes);
    char *text = json_print(document);
    json_free(document);
    return text;
}

void result_clear_temporary(const char *directory, int64_t before_ms)
{
    struct stat info;
    DIR *files = opendir(directory);
    for (struct dirent *d; files && (d = readdir(files));)
        if ((store_file_is_temporary(d->d_name, LISTING_NAME) ||
             store_file_is_temporary(d->d_name, WORKER_REPORT_NAME)) &&
            fstatat(dirfd(files), d->d_name, &info, AT_SYMLINK_NOFOLLOW) == 0 && S_ISREG(info.st_mode) &&
            (int64_t)info.st_mtim.tv_sec * 1000 + info.st_mtim.tv_nsec / 1000000 < before_ms)
            unlinkat(dirfd(files), d->d_name, 0);
    if (files) closedir(files);
}

bool result_list(const char *directory, result *r, error *e)
{
    error why = {0};
    result found = {0};
    if (read_named(directory, LISTING_NAME, REPORT_LIMIT_BYTES, r, &why)) return true;
    if (!result_read(directory, &found, e)) return false;
    if (!append_report(directory, &found, e)) {
        result_clear(&found);
        return false;
    }
    char *path = mem_printf("%s/%s", directory, LISTING_NAME), *text = print_listing(&found);
    if (!store_file_write(path, text, strlen(text), &why)) /* the next call tries again */
        log_write(LOG_LEVEL_WARNING, "cannot store the list of files of a result: %s", why.message);
    free(text);
    free(path);
    *r = found;
    return true;
}

void result_list_long(const char *directory)
{
    int64_t bytes = 0;
    result r = {0};
    int fd = result_open_file(directory, WORKER_REPORT_NAME, &bytes, NULL);
    if (fd >= 0) close(fd);
    if (bytes > SHORT_REPORT_BYTES && result_list(directory, &r, NULL)) result_clear(&r);
}

/* Deleting is safe: the queue stored the number of this attempt before the directory was created, a start
 * moves directories with unknown numbers to lost+found (service/results/inventory), and the directory
 * contains no result that was ever reported. */
void result_remove_leftovers(const char *directory)
{
    char *log = mem_printf("%s/" RESULT_LOG_NAME, directory);
    size_t length = 0;
    error e = {0};
    char *text = store_file_read(log, 1 << 20, &length, NULL);
    if (!store_remove(directory, &e))
        log_write(LOG_LEVEL_WARNING, "cannot remove the files of a failed attempt: %s", e.message);
    if (text && length) {
        if (!store_directory_add(directory, &e) || !store_file_write(log, text, length, &e))
            log_write(LOG_LEVEL_WARNING, "cannot store the log of the worker: %s", e.message);
    }
    free(text);
    free(log);
}

int64_t result_disk_bytes(const char *directory)
{
    struct stat info;
    int64_t blocks = 0;
    DIR *listing = opendir(directory);
    for (struct dirent *entry; listing && (entry = readdir(listing));)
        if (strcmp(entry->d_name, "..") != 0 &&
            fstatat(dirfd(listing), entry->d_name, &info, AT_SYMLINK_NOFOLLOW) == 0)
            blocks += info.st_blocks;
    if (listing) closedir(listing);
    return blocks * 512; /* the unit of st_blocks */
}
