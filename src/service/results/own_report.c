// SPDX-License-Identifier: Apache-2.0
#include "service/results/own_report.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/core/log.h"
#include "base/core/manager.h"
#include "base/core/memory.h"
#include "base/core/worker_contract.h"
#include "base/json/json_copy.h"
#include "files/file.h"

/* Jobs that one query lists. */
#define AT_ONCE 100
/* Seconds by which the start timeout of the service manager is extended for AT_ONCE jobs. Each takes
 * milliseconds on a working disk. */
static const double AT_ONCE_S = 60;

/* The spec in the format of a report: indented as a member of the outermost object. To be freed; NULL: it is
 * not JSON. */
static char *print_member(const char *spec, error *e)
{
    static const char before[] = "{\n  \"spec\":", after[] = "\n}\n";
    json *own = json_parse(spec, strlen(spec), e);
    if (!own) return NULL;
    json *object = json_new_object();
    json_put(object, "spec", own);
    char *text = json_print_pretty(object);
    json_free(object);
    char *member =
        mem_printf("%.*s", (int)(strlen(text) - strlen(before) - strlen(after)), text + strlen(before));
    free(text);
    return member;
}

/* Copies the report and replaces its spec. A report without a spec (of another worker than hexad-worker)
 * gets none. */
static bool copy_report(const char *from, const char *to, const char *spec, error *e)
{
    int64_t bytes = 0;
    size_t replaced = 0;
    store_file file = {0};
    char *path = mem_printf("%s/" WORKER_REPORT_NAME, to), *member = print_member(spec, e);
    int fd = member ? result_open_file(from, WORKER_REPORT_NAME, &bytes, e) : -1;
    FILE *report = fd >= 0 ? fdopen(fd, "rb") : NULL;
    if (fd >= 0 && !report) {
        error_set(e, error_code_of_errno(errno), "%s/" WORKER_REPORT_NAME " cannot be read: %m", from);
        close(fd);
    }
    bool ok = report && store_file_begin(path, &file, e);
    if (ok && !json_copy_replacing(report, "spec", member, file.stream, &replaced))
        ok = ferror(report) || ferror(file.stream)
                 ? error_set(e, error_code_of_errno(errno), "cannot copy %s from %s: %m", path, from)
                 : error_set(e, ERROR_INPUT_DAMAGED, "%s/" WORKER_REPORT_NAME " is not JSON", from);
    if (ok && replaced > 1)
        ok = error_set(e, ERROR_INPUT_DAMAGED, "%s/" WORKER_REPORT_NAME " has %zu members \"spec\"", from,
                       replaced);
    if (ok) result_forget_list(to);
    ok = ok && store_file_commit(&file, e);
    store_file_abort(&file);
    if (report) fclose(report);
    free(member);
    free(path);
    return ok;
}

/* Writes the summary of the copied report: only its length and hash differ. It is not flushed to disk, like the
 * summary that a worker writes: without a valid one the report is read. */
static void write_summary(const char *to, json *summary)
{
    int64_t bytes = 0;
    char hex[STORE_HASH_SIZE];
    if (!result_hash_file(to, WORKER_REPORT_NAME, hex, &bytes, NULL)) return;
    json_put_integer(summary, "report_bytes", bytes);
    json_put_string(summary, "report_sha256", hex);
    char *path = mem_printf("%s/" WORKER_SUMMARY_NAME, to), *text = json_print(summary);
    FILE *file = fopen(path, "we");
    if (!file || fputs(text, file) < 0)
        log_write(LOG_LEVEL_WARNING, "cannot write %s: %m", path); /* the report is read instead */
    if (file) fclose(file);
    free(text);
    free(path);
}

bool own_report_copy(const char *from, const char *to, const char *spec, const result *r, json *document,
                     error *e)
{
    bool ok = copy_report(from, to, spec, e);
    if (ok && r->report_bytes >= 0) write_summary(to, document);
    if (ok && r->report_bytes < 0) result_list_long(to);
    return ok;
}

static bool replace_report(const char *directory, const char *spec, error *e)
{
    result r = {0};
    json *document = result_read_short(directory, &r, e);
    bool ok = document && own_report_copy(directory, directory, spec, &r, document, e);
    json_free(document);
    result_clear(&r);
    return ok;
}

/* Whether the report has a spec that differs from this one. They are compared as printed text. */
static bool has_other_spec(json *report, const char *spec)
{
    json *own = json_parse(spec, strlen(spec), NULL), *there = json_find(report, "/spec");
    char *a = own ? json_print(own) : NULL, *b = there ? json_print(there) : NULL;
    bool other = b && (!a || strcmp(a, b) != 0);
    free(a);
    free(b);
    json_free(own);
    return other;
}

bool own_report_correct(const char *directory, const char *spec, error *e)
{
    result r = {0};
    json *report = result_read_report(directory, &r, e);
    bool ok = report && (!has_other_spec(report, spec) || replace_report(directory, spec, e));
    json_free(report);
    result_clear(&r);
    return ok;
}

/* An earlier build that had workers of this one copied their summaries with the hashes of other reports. */
static bool correct_hash(const char *directory, const char *spec, error *e)
{
    result r = {0};
    char hex[STORE_HASH_SIZE];
    int64_t bytes;
    bool ok =
        result_read(directory, &r, e) &&
        (!*r.report_sha256 || (result_hash_file(directory, WORKER_REPORT_NAME, hex, &bytes, e) &&
                               (strcmp(hex, r.report_sha256) == 0 || replace_report(directory, spec, e))));
    result_clear(&r);
    return ok;
}

static bool correct_one(const char *work_dir, const queue_reused *job, error *e)
{
    error why = {0};
    char *directory = result_directory(work_dir, job->id, QUEUE_NO_FRAME);
    bool ok = own_report_correct(directory, job->spec, &why) && correct_hash(directory, job->spec, &why);
    free(directory);
    if (ok) return true;
    if (why.code != ERROR_INPUT_DAMAGED) {
        if (e) *e = why;
        return error_prefix(e, "the report of job %s, which contains data of job %s", job->id, job->from);
    }
    log_write(LOG_LEVEL_WARNING, "job=%s: cannot read the result: %s", job->id, why.message);
    return true;
}

bool own_report_correct_all(queue *q, const char *work_dir, error *e)
{
    queue_reused *jobs = NULL;
    size_t count = AT_ONCE, total = 0;
    int64_t after = 0;
    bool due = false, ok = queue_has_linked_reports(q, &due, e);
    if (!ok || !due) return ok;
    while (ok && count == AT_ONCE) {
        ok = queue_list_reused(q, after, AT_ONCE, &jobs, &count, e);
        if (!ok) break;
        manager_report_starting(AT_ONCE_S);
        for (size_t i = 0; ok && i < count; i++) ok = correct_one(work_dir, &jobs[i], e);
        if (count) after = jobs[count - 1].seq;
        total += count;
        queue_reused_free(jobs, count);
    }
    if (ok && total)
        log_write(LOG_LEVEL_INFO, "jobs that had reports of equal jobs have their own now count=%zu", total);
    return ok && queue_note_own_reports(q, e);
}
