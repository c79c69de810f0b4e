#include "results/own_report.h"

#include <stdlib.h>
#include <string.h>

#include "base/log.h"
#include "base/manager.h"
#include "base/memory.h"
#include "base/worker_contract.h"
#include "results/result.h"
#include "store/file.h"

/* Jobs that are listed at a time. */
#define AT_ONCE 100
/* What the service manager grants the start for these: each takes milliseconds on a disk that works. */
static const double AT_ONCE_S = 60;

bool own_report_write(const char *directory, json *report, const char *spec, error *e)
{
    char *path = mem_printf("%s/" WORKER_REPORT_NAME, directory);
    json *own = json_parse(spec, strlen(spec), e);
    bool ok = own != NULL;
    if (ok) {
        json_put(report, "spec", own);
        char *text = json_print_pretty(report);
        result_forget_list(directory);
        ok = store_file_write(path, text, strlen(text), e);
        if (ok) result_list_long(directory); /* the summary of the other report is of no use here */
        free(text);
    }
    free(path);
    return ok;
}

/* Whether the report has another spec. Equal specs are printed in the same way. */
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
    bool ok = report && (!has_other_spec(report, spec) || own_report_write(directory, report, spec, e));
    json_free(report);
    result_clear(&r);
    return ok;
}

static bool correct_one(const char *work_dir, const queue_reused *job, error *e)
{
    error why = {0};
    char *directory = result_directory(work_dir, job->id, QUEUE_NO_FRAME);
    bool ok = own_report_correct(directory, job->spec, &why);
    free(directory);
    if (ok) return true;
    if (why.code != ERROR_INPUT_DAMAGED) {
        if (e) *e = why;
        return error_prefix(e, "the report of job %s, which contains data of job %s", job->id, job->from);
    }
    log_write(LOG_LEVEL_WARNING, "job=%s: the result cannot be read: %s", job->id, why.message);
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
        manager_tell_starting(AT_ONCE_S);
        for (size_t i = 0; ok && i < count; i++) ok = correct_one(work_dir, &jobs[i], e);
        if (count) after = jobs[count - 1].seq;
        total += count;
        queue_reused_free(jobs, count);
    }
    if (ok && total)
        log_write(LOG_LEVEL_INFO, "jobs that had reports of equal jobs have their own now count=%zu", total);
    return ok && queue_note_own_reports(q, e);
}
