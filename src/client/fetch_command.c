// SPDX-License-Identifier: Apache-2.0
/* fetch_command: the commands fetch and log of hexadctl, which download results and logs. */
#include <dirent.h>
#include <fcntl.h>
#include <limits.h>
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
#include "client/job_table.h"
#include "client/list_query.h"
#include "client/print.h"
#include "client/progress_bar.h"
#include "files/file.h"

/* Whether a file with this hash is at the path. */
static bool is_there(const char *path, const char *sha256)
{
    char hex[STORE_HASH_SIZE] = "";
    struct stat info;
    uint64_t bytes = 0;
    int fd = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK);
    bool same = fd >= 0 && fstat(fd, &info) == 0 && S_ISREG(info.st_mode) &&
                store_file_hash(fd, hex, &bytes, NULL) && strcmp(hex, sha256) == 0;
    if (fd >= 0) close(fd);
    return same;
}

/* Downloads one result to a temporary file, verifies its hash and renames it. */
static int download(client *c, const char *path, const char *href, const char *sha256, error *e)
{
    store_file file = {0};
    client_reply reply = {0};
    int code = COMMAND_FAILED;
    store_file_clear(path);
    if (!store_file_begin(path, &file, e)) goto done;
    if (!client_download(c, href, file.stream, &reply, e)) {
        if (ferror(file.stream))
            error_set(e, ERROR_INTERNAL, "%s cannot be written", path);
        else
            code = COMMAND_UNREACHABLE;
        goto done;
    }
    if (reply.status != 200) {
        json_at root = json_root(reply.document);
        error_set(e, ERROR_INTERNAL, "%s: the server answered with status %ld: %s", path, reply.status,
                  json_string(json_member(&root, "detail"), "the answer has no reason"));
        goto done;
    }
    if (!command_compare(file.stream, path, sha256, e)) goto done;
    if (store_file_commit(&file, e)) code = COMMAND_OK;
done:
    if (code != COMMAND_OK && e->code == ERROR_NONE)
        error_set(e, ERROR_INTERNAL, "%s cannot be written", path);
    client_reply_clear(&reply);
    store_file_abort(&file);
    return code;
}

/* Confirms a file that the client already has: the server keeps results longer until they are delivered. */
static int confirm(client *c, const char *href, const char *sha256, error *e)
{
    client_reply reply = {0};
    bool ok = client_confirm(c, href, sha256, &reply, e);
    client_reply_clear(&reply);
    return ok ? COMMAND_OK : COMMAND_UNREACHABLE;
}

/* Fetches a file. *kept: the file existed already. */
static int fetch_file(client *c, const char *directory, json_at item, bool quiet, bool *kept)
{
    const char *name = json_string(json_member(&item, "name"), "");
    const char *href = json_string(json_member(&item, "href"), "");
    const char *sha256 = json_string(json_member(&item, "sha256"), "");
    /* the name comes from the network and becomes a local file name */
    if (!*name || *name == '.' || strchr(name, '/') || strncmp(href, "/v1/", 4) != 0)
        return print_failure("the server lists a result whose name contains a path: report this as a fault");
    error e = {0};
    char *path = mem_printf("%s/%s", directory, name);
    *kept = is_there(path, sha256);
    int code = *kept ? confirm(c, href, sha256, &e) : download(c, path, href, sha256, &e);
    if (code != COMMAND_OK) {
        print_failure("%s", e.message);
    } else if (!quiet) {
        terminal_text_put(stdout, path);
        putchar('\n');
    }
    free(path);
    return code;
}

/* Whether a directory has another result than this list of files: a report with other bytes, or one that is
 * not in the list. */
static bool has_other_result(const char *directory, json_at results)
{
    char *path = mem_printf("%s/report.json", directory);
    bool other = access(path, F_OK) == 0;
    for (json_at item = json_first(&results); item.node && other; item = json_next(&item)) {
        if (strcmp(json_string(json_member(&item, "name"), ""), "report.json") == 0)
            other = !is_there(path, json_string(json_member(&item, "sha256"), ""));
    }
    free(path);
    return other;
}

/* The numbers of the directories of frames that have a report, in no order; the caller frees them. */
static int *list_frames(const char *directory, size_t *count)
{
    int *frame = NULL;
    DIR *opened = opendir(directory);
    *count = 0;
    for (struct dirent *entry; opened && (entry = readdir(opened));) {
        char *end;
        const long number = strtol(entry->d_name, &end, 10);
        char *report = mem_printf("%s/%ld/report.json", directory, number);
        if (!*end && number >= 0 && number <= INT_MAX && access(report, F_OK) == 0) {
            frame = mem_resize(frame, (*count + 1) * sizeof *frame);
            frame[(*count)++] = (int)number;
        }
        free(report);
    }
    if (opened) closedir(opened);
    return frame;
}

/* Reads the document with the list of results of a job or of its frame; NULL: there is none. The caller frees it. */
static json *read_results(client *c, const char *id, const char *frame)
{
    char *path = mem_printf("/v1/jobs/%s/results%s%s", id, frame ? "?frame=" : "", frame ? frame : "");
    json *document = command_find(c, path);
    free(path);
    return document;
}

/* Whether a directory has frames, none of which is a result of the array. */
static bool has_other_frames(client *c, const char *id, const char *directory)
{
    size_t count = 0;
    int *frame = list_frames(directory, &count);
    bool other = count > 0;
    for (size_t i = 0; i < count && other; i++) {
        char *number = mem_printf("%d", frame[i]), *there = mem_printf("%s/%s", directory, number);
        json *document = read_results(c, id, number);
        json_at root = json_root(document);
        if (document) other = has_other_result(there, json_member(&root, "results"));
        json_free(document);
        free(number);
        free(there);
    }
    free(frame);
    return other;
}

/* Whether a directory has frames of an array. */
static bool has_frames(const char *directory)
{
    size_t count = 0;
    free(list_frames(directory, &count));
    return count > 0;
}

static int refuse_directory(const char *directory)
{
    print_failure("%s has another result: name another directory with --output, or remove this one",
                  directory);
    return COMMAND_USAGE;
}

/* Fetches the files that the server lists, report.json last. Files of all frames go to `above`. On
 * success *document is the list; the caller frees it. */
static int fetch_list(client *c, const char *list, const char *directory, const char *above, bool quiet,
                      json **document)
{
    error e = {0};
    json *found = NULL;
    int code = command_ask(c, "GET", list, NULL, &found);
    json_at root = json_root(found), results = json_member(&root, "results");
    size_t there = 0;
    if (code == COMMAND_OK && has_other_result(directory, results)) code = refuse_directory(directory);
    if (code == COMMAND_OK && !store_directory_create(directory, &e)) code = print_failure("%s", e.message);
    for (json_at item = json_first(&results); item.node && code == COMMAND_OK; item = json_next(&item)) {
        bool kept = false;
        bool of_all = frames_is_stage(json_string(json_member(&item, "name"), ""));
        code = fetch_file(c, of_all ? above : directory, item, quiet, &kept);
        there += kept;
    }
    if (code == COMMAND_OK && there > 0 && !quiet)
        fprintf(stderr, "%zu of %zu files were there already\n", there, json_size(results));
    if (code == COMMAND_OK)
        *document = found;
    else
        json_free(found);
    return code;
}

/* Progress of fetching the frames of an array. */
typedef struct array_fetch {
    const char *id, *directory;
    const command_options *options;
    bool silent; /* print failures only */
    int *wanted; /* NULL: all */
    size_t wanted_count;
    /* numbers of frames: requested, fetched, not ended, without results */
    int all, fetched, unended, lost;
    int seen; /* number of requested frames that the job has */
    progress_bar bar;
    json *frames;   /* for `document` */
    json *document; /* with --json: what was fetched */
} array_fetch;

static bool is_wanted(const array_fetch *f, int frame)
{
    return !f->wanted || bsearch(&frame, f->wanted, f->wanted_count, sizeof frame, compare_ints);
}

static int fetch_frame(client *c, array_fetch *f, int frame)
{
    json *found = NULL;
    char *list = mem_printf("/v1/jobs/%s/results?frame=%d", f->id, frame),
         *directory = mem_printf("%s/%d", f->directory, frame);
    progress_bar_show_count(&f->bar, f->fetched, f->all);
    int code = fetch_list(c, list, directory, f->directory, f->silent || f->options->json || f->bar.terminal,
                          &found);
    if (code == COMMAND_OK) {
        json_at root = json_root(found);
        json *o = json_append_object(f->frames);
        json_put_integer(o, "frame", frame);
        json_put(o, "results", json_copy(json_member(&root, "results").node));
        f->fetched++;
    }
    json_free(found);
    free(list);
    free(directory);
    return code;
}

/* Fetches the results of one task, or records why there are none. */
static int fetch_task(client *c, array_fetch *f, json_at task)
{
    int frame = (int)json_number(json_member(&task, "frame"), -1);
    const char *state = json_string(json_member(&task, "state"), "?");
    if (!is_wanted(f, frame)) return COMMAND_OK;
    f->seen++;
    if (strcmp(state, "succeeded") == 0) return fetch_frame(c, f, frame);
    if (!command_has_ended(task)) {
        f->unended++;
        return COMMAND_OK;
    }
    json_at fault = json_member(&task, "error");
    const char *why = json_string(json_member(&fault, "message"), NULL);
    progress_bar_clear(&f->bar);
    const char *file = json_string(json_member(&task, "file"), NULL);
    print_failure("frame %d%s%s%s has no results: %s%s%s", frame, file ? " (" : "", file ? file : "",
                  file ? ")" : "", state, why ? ": " : "", why ? why : "");
    f->lost++;
    return COMMAND_OK;
}

static int fetch_tasks(client *c, array_fetch *f)
{
    int code = COMMAND_OK;
    double after = TASKS_FROM_THE_FIRST;
    for (json *page; code == COMMAND_OK && (page = command_next_tasks(c, f->id, &after, &code));
         json_free(page)) {
        json_at root = json_root(page), tasks = json_member(&root, "tasks");
        for (json_at task = json_first(&tasks); task.node && code == COMMAND_OK; task = json_next(&task))
            code = fetch_task(c, f, task);
    }
    return code;
}

/* Prints how many frames were fetched and which are missing. */
static int sum_up(array_fetch *f)
{
    int unknown = f->wanted ? f->all - f->seen : 0;
    if (f->options->json) {
        json *document = json_new_object();
        json_put_integer(document, "all", f->all);
        json_put_integer(document, "fetched", f->fetched);
        json_put(document, "frames", f->frames);
        f->frames = NULL;
        f->document = document;
    }
    if (f->silent && f->fetched == f->all) return COMMAND_OK;
    fprintf(stderr, "%d of %d frames are fetched to ", f->fetched, f->all);
    terminal_text_put(stderr, f->directory);
    if (f->lost) fprintf(stderr, "; %d have no results", f->lost);
    if (f->unended) fprintf(stderr, "; %d have not ended: fetch again later", f->unended);
    if (unknown) fprintf(stderr, "; %d are not frames of the job", unknown);
    fputc('\n', stderr);
    return f->fetched == f->all ? COMMAND_OK : COMMAND_MISSING;
}

/* Prints which job is fetched, unless the output is a document or none. */
static void print_identity(const array_fetch *f, json_at job)
{
    if (!f->silent && !f->options->json) job_table_print_identity(job, stderr);
}

static int fetch_array(client *c, array_fetch *f, json_at job)
{
    error e = {0};
    const char *given = f->options->frame;
    if (given && !(f->wanted = frames_parse(given, &f->wanted_count, &e))) {
        print_failure("fetch: --frame: %s", e.message);
        return COMMAND_USAGE;
    }
    if (f->wanted) {
        qsort(f->wanted, f->wanted_count, sizeof *f->wanted, compare_ints);
        f->all = (int)f->wanted_count;
    }
    if (has_other_result(f->directory, json_root(NULL)) || has_other_frames(c, f->id, f->directory)) {
        free(f->wanted);
        return refuse_directory(f->directory);
    }
    print_identity(f, job);
    f->frames = json_new_array();
    progress_bar_init(&f->bar);
    int code = fetch_tasks(c, f);
    progress_bar_clear(&f->bar);
    int sum = sum_up(f);
    json_free(f->frames);
    free(f->wanted);
    return code == COMMAND_OK ? sum : code;
}

static int fetch_single(client *c, array_fetch *f, json_at job)
{
    json *found = NULL;
    if (f->options->frame) {
        print_failure("fetch: the job %s has no frames: omit --frame", f->id);
        return COMMAND_USAGE;
    }
    if (!command_has_ended(job)) {
        print_failure(
            "the job %s has no results yet, since it has not ended: %s. To wait for its end, run hexadctl wait %s",
            f->id, json_string(json_member(&job, "state"), "?"), f->id);
        return COMMAND_MISSING;
    }
    if (has_frames(f->directory)) return refuse_directory(f->directory);
    print_identity(f, job);
    char *list = mem_printf("/v1/jobs/%s/results", f->id);
    int code = fetch_list(c, list, f->directory, f->directory, f->silent || f->options->json, &found);
    if (code == COMMAND_OK && f->options->json)
        f->document = found;
    else
        json_free(found);
    free(list);
    return code;
}

/* Fetches a job. With --json, *document is what was fetched; the caller frees it. */
static int fetch_job(client *c, json_at job, const char *directory, bool silent,
                     const command_options *options, json **document)
{
    json_at tasks = json_member(&job, "tasks");
    const bool array = json_bool(json_member(&job, "array"), false);
    array_fetch f = {.id = json_string(json_member(&job, "id"), ""),
                     .directory = directory,
                     .options = options,
                     .silent = silent,
                     .all = (int)json_number(json_member(&tasks, "all"), 0)};
    int code = array ? fetch_array(c, &f, job) : fetch_single(c, &f, job);
    *document = f.document;
    return code;
}

/* ---- all jobs with a label */

/* Whether a text is the name of a file that is not hidden. */
static bool is_file_name(const char *text)
{
    for (const char *c = text; *c; c++)
        if ((unsigned char)*c < ' ' || *c == 127 || *c == '/') return false;
    return *text && *text != '.' && strlen(text) <= NAME_MAX;
}

/* Whether another job of the list has this name, or has it as its id. */
static bool is_shared_name(json_at jobs, const char *id, const char *name)
{
    for (json_at job = json_first(&jobs); job.node; job = json_next(&job)) {
        const char *other = json_string(json_member(&job, "id"), "");
        if (strcmp(other, id) != 0 &&
            (strcmp(json_string(json_member(&job, "name"), ""), name) == 0 || strcmp(other, name) == 0))
            return true;
    }
    return false;
}

/* The directory of a job below the common one: its name, or its id if the name is no name of a file or is that of
 * several jobs. The caller frees it. */
static char *directory_of(json_at jobs, json_at job, const char *above)
{
    const char *id = json_string(json_member(&job, "id"), ""),
               *name = json_string(json_member(&job, "name"), "");
    return mem_printf("%s/%s", above, is_file_name(name) && !is_shared_name(jobs, id, name) ? name : id);
}

/* Prints why a job has no results to fetch. False: it has some. */
static bool explain_missing(json_at job)
{
    const char *state = json_string(json_member(&job, "state"), "?"),
               *id = json_string(json_member(&job, "id"), "?"),
               *name = json_string(json_member(&job, "name"), "");
    json_at fault = json_member(&job, "error");
    if (strcmp(state, "succeeded") == 0 || json_bool(json_member(&job, "array"), false)) return false;
    if (command_has_ended(job))
        print_failure("%s%s%s has no results: %s%s%s", id, *name ? " " : "", name, state,
                      fault.node ? ": " : "", json_string(json_member(&fault, "message"), ""));
    else
        print_failure("%s%s%s has not ended: %s. Fetch again later", id, *name ? " " : "", name, state);
    return true;
}

/* Fetches the jobs of the list, each into a directory of its own. Returns the exit code of the first job that was
 * not fetched. */
static int fetch_jobs(client *c, json_at jobs, const char *directory, const command_options *options)
{
    int result = COMMAND_OK;
    size_t fetched = 0;
    json *document = json_new_object();
    json *list = json_put_array(document, "jobs");
    for (json_at job = json_first(&jobs); job.node && result != COMMAND_UNREACHABLE; job = json_next(&job)) {
        json *found = NULL;
        char *where = directory_of(jobs, job, directory);
        int code = explain_missing(job) ? COMMAND_MISSING : fetch_job(c, job, where, false, options, &found);
        fetched += code == COMMAND_OK;
        if (found) {
            json_put_string(found, "job", json_string(json_member(&job, "id"), ""));
            json_put_string(found, "directory", where);
            json_append(list, found);
        }
        if (result == COMMAND_OK || code == COMMAND_UNREACHABLE) result = code;
        free(where);
    }
    if (options->json) print_document(document);
    json_free(document);
    fprintf(stderr, "%zu of %zu jobs are fetched to ", fetched, json_size(jobs));
    terminal_text_put(stderr, directory);
    fputc('\n', stderr);
    return result;
}

/* Fetches all jobs with the label, of the caller or of the user that the options name. */
static int fetch_label(client *c, const command_options *options)
{
    command_options chosen = *options;
    const char *label = options->label.item[0], *directory = options->output ? options->output : label;
    json *session = NULL, *jobs = NULL;
    if (options->frame || options->label.count > 1) {
        print_failure("fetch: --label is given once, and excludes --frame: omit it");
        return COMMAND_USAGE;
    }
    if (!options->output && !is_file_name(label)) {
        print_failure("fetch: the label %s is no name of a directory: add --output DIR", label);
        return COMMAND_USAGE;
    }
    int code = options->owner ? COMMAND_OK : command_ask(c, "GET", "/v1/session", NULL, &session);
    json_at root = json_root(session);
    if (!options->owner) chosen.owner = json_string(json_member(&root, "user"), "");
    if (code == COMMAND_OK) code = list_query_read_all(c, &chosen, &jobs);
    if (code == COMMAND_OK && !json_size(json_root(jobs))) {
        print_failure("the user %s has no jobs with the label %s: run \"hexadctl list\" for jobs",
                      chosen.owner, label);
        code = COMMAND_MISSING;
    } else if (code == COMMAND_OK) {
        code = fetch_jobs(c, json_root(jobs), directory, options);
    }
    json_free(jobs);
    json_free(session);
    return code;
}

/* Whether a directory has a complete file of the list. */
static bool has_file(const char *directory, json_at results)
{
    bool found = false;
    for (json_at item = json_first(&results); !found && item.node; item = json_next(&item)) {
        char *path = mem_printf("%s/%s", directory, json_string(json_member(&item, "name"), ""));
        found = is_there(path, json_string(json_member(&item, "sha256"), ""));
        free(path);
    }
    return found;
}

static bool is_temporary(const char *name, json_at results)
{
    bool found = false;
    for (json_at item = json_first(&results); !found && item.node; item = json_next(&item))
        found = store_file_is_temporary(name, json_string(json_member(&item, "name"), ""));
    return found;
}

static bool is_dot(const char *name)
{
    return strcmp(name, ".") == 0 || strcmp(name, "..") == 0;
}

/* Whether a directory has no entries but temporary files of the list, which an interrupted fetch leaves. */
static bool has_only_temporary(const char *directory, json_at results)
{
    DIR *opened = opendir(directory);
    bool only = opened != NULL;
    for (struct dirent *entry; only && (entry = readdir(opened));)
        only = is_dot(entry->d_name) || is_temporary(entry->d_name, results);
    if (opened) closedir(opened);
    return only;
}

/* Whether a directory has a complete file of a frame of the array, or no entries but directories of frames with
 * temporary files. */
static bool has_array(client *c, const char *id, const char *directory)
{
    DIR *opened = opendir(directory);
    bool found = false, only = opened != NULL;
    for (struct dirent *entry; opened && !found && (entry = readdir(opened));) {
        const char *name = entry->d_name;
        if (is_dot(name)) continue;
        const bool is_frame = strspn(name, "0123456789") == strlen(name);
        json *document = is_frame ? read_results(c, id, name) : NULL;
        json_at root = json_root(document), results = json_member(&root, "results");
        char *there = mem_printf("%s/%s", directory, name);
        found = document && has_file(there, results);
        only = only && document && has_only_temporary(there, results);
        free(there);
        json_free(document);
    }
    if (opened) closedir(opened);
    return found || only;
}

/* Whether a result of the job may be written into a directory: it does not exist, or has files of this result, or
 * only what a fetch leaves that was interrupted before its first file. */
static bool may_hold(client *c, json_at job, const char *directory)
{
    const char *id = json_string(json_member(&job, "id"), "");
    if (store_directory_is_free(directory, true)) return true;
    if (json_bool(json_member(&job, "array"), false))
        return has_array(c, id, directory) && !has_other_frames(c, id, directory);
    json *document = read_results(c, id, NULL);
    json_at root = json_root(document), results = json_member(&root, "results");
    const bool may = document && !has_other_result(directory, results) &&
                     (has_file(directory, results) || has_only_temporary(directory, results));
    json_free(document);
    return may;
}

/* The directory of a fetch without --output: the name of the job if the command line has it, otherwise the ID. */
static const char *default_directory(client *c, json_at job, const char *called)
{
    const char *name = json_string(json_member(&job, "name"), "");
    const bool is_called = called && strcmp(called, name) == 0 && is_file_name(name);
    return is_called && may_hold(c, job, name) ? name : json_string(json_member(&job, "id"), "");
}

int command_fetch(client *c, const char *argument, const command_options *options)
{
    json *document = NULL, *found = NULL;
    if (!argument == !options->label.count || (argument && options->owner)) {
        print_failure("fetch: give either the ID of a job or one --label, and --owner only with --label");
        return COMMAND_USAGE;
    }
    if (!argument) return fetch_label(c, options);
    char *path = command_job_path(argument, "");
    if (!path) return COMMAND_USAGE;
    int code = command_ask(c, "GET", path, NULL, &document);
    if (code == COMMAND_OK) {
        const json_at job = json_root(document);
        const char *directory =
            options->output ? options->output : default_directory(c, job, options->called);
        code = fetch_job(c, job, directory, false, options, &found);
    }
    if (found) print_document(found);
    json_free(found);
    json_free(document);
    free(path);
    return code;
}

int command_fetch_into(client *c, const char *id, const char *directory)
{
    const command_options plain = {0};

    json *document = NULL, *found = NULL;
    char *path = command_job_path(id, "");
    int code = path ? command_ask(c, "GET", path, NULL, &document) : COMMAND_USAGE;
    if (code == COMMAND_OK) code = fetch_job(c, json_root(document), directory, true, &plain, &found);
    json_free(found);
    json_free(document);
    free(path);
    return code;
}

/* The path of a log, which the caller frees. NULL, after a message, if the arguments do not name one. */
static char *log_path(client *c, const char *id, const command_options *options)
{
    char *path = command_job_path(id, "/log");
    if (!path) return NULL;
    char *frame = options->frame ? client_escape(c, options->frame) : NULL,
         *attempt = options->attempt ? client_escape(c, options->attempt) : NULL;
    char *whole = mem_printf("%s%s%s%s%s", path, frame ? "?frame=" : "", frame ? frame : "",
                             !attempt ? ""
                             : frame  ? "&attempt="
                                      : "?attempt=",
                             attempt ? attempt : "");
    free(frame);
    free(attempt);
    free(path);
    return whole;
}

int command_log(client *c, const char *argument, const command_options *options)
{
    error e = {0};
    client_reply reply = {0};
    char *path = log_path(c, argument, options), *text = NULL;
    size_t length = 0;
    FILE *log = open_memstream(&text, &length);
    int code = COMMAND_USAGE;
    if (path)
        code = !client_download(c, path, log, &reply, &e) ? print_unreachable(&e)
               : reply.status != 200                      ? print_refused(&reply)
                                                          : COMMAND_OK;
    fclose(log);
    terminal_text_write(stdout, TERMINAL_TEXT_PAGE, text, length);
    client_reply_clear(&reply);
    free(text);
    free(path);
    return code;
}
