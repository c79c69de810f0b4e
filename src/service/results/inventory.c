// SPDX-License-Identifier: Apache-2.0
#include "service/results/inventory.h"

#include <dirent.h>
#include <errno.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "base/core/log.h"
#include "base/core/memory.h"
#include "service/results/adoption.h"
#include "service/results/lost_found.h"
#include "service/results/own_report.h"
#include "service/results/result.h"

static const char *const parts[] = {"results", "attempts"};
enum { RESULTS, ATTEMPTS };

/* The entries of results/ or attempts/: first those whose names have the form of a task's directory, then all
 * others. */
typedef struct listing {
    char **name;
    queue_directory *directory; /* parsed names of the first `named` entries, in the same order */
    size_t count, named;
    bool linked; /* results/ or attempts/ itself is a symbolic link */
} listing;

static void listing_clear(listing *l)
{
    for (size_t i = 0; i < l->count; i++) free(l->name[i]);
    free(l->name);
    free(l->directory);
}

/* Reads ".NUMBER" without leading zeros, and advances the text behind it. False if the text begins
 * otherwise. */
static bool read_number(const char **text, int *number)
{
    char written[16], *end = NULL;
    if (**text != '.' || (*text)[1] < '0' || (*text)[1] > '9') return false;
    errno = 0;
    long value = strtol(*text + 1, &end, 10);
    int length = snprintf(written, sizeof written, ".%ld", value);
    if (errno || value > INT_MAX || end - *text != length || strncmp(*text, written, (size_t)length) != 0)
        return false;
    *number = (int)value;
    *text = end;
    return true;
}

/* Results are named "ID" or "ID.FRAME", attempts "ID.N" or "ID.FRAME.N". */
static bool read_name(const char *name, int part, queue_directory *d)
{
    *d = (queue_directory){.frame = QUEUE_NO_FRAME};
    if (strlen(name) < ULID_SIZE - 1) return false;
    memcpy(d->id, name, ULID_SIZE - 1);
    const char *rest = name + ULID_SIZE - 1;
    int number[2], count = 0;
    while (count < 2 && *rest && read_number(&rest, &number[count])) count++;
    if (*rest || !ulid_is_valid(d->id)) return false;
    if (part == ATTEMPTS && (count == 0 || number[count - 1] == 0)) return false;
    if (part == ATTEMPTS) d->attempt = number[--count];
    if (count > 1) return false;
    if (count) d->frame = number[0];
    return true;
}

bool inventory_read_name(const char *name, queue_directory *directory)
{
    return read_name(name, RESULTS, directory);
}

typedef struct named {
    char *name;
    queue_directory directory;
} named;

static int compare(const void *a, const void *b)
{
    const queue_directory *x = &((const named *)a)->directory, *y = &((const named *)b)->directory;
    int ids = strcmp(x->id, y->id);
    if (ids) return ids;
    if (x->frame != y->frame) return x->frame < y->frame ? -1 : 1;
    return (x->attempt > y->attempt) - (x->attempt < y->attempt);
}

/* Sorts by id, frame and attempt: the database finds neighbouring ids faster. */
static void sort(listing *l)
{
    named *list = mem_alloc((l->named + 1) * sizeof *list);
    for (size_t i = 0; i < l->named; i++) list[i] = (named){l->name[i], l->directory[i]};
    qsort(list, l->named, sizeof *list, compare);
    for (size_t i = 0; i < l->named; i++) {
        l->name[i] = list[i].name;
        l->directory[i] = list[i].directory;
    }
    free(list);
}

static void append(listing *l, const char *name, int part, size_t *capacity)
{
    queue_directory d;
    if (l->count == *capacity) {
        *capacity = *capacity * 2 + 64;
        l->name = mem_resize(l->name, *capacity * sizeof *l->name);
        l->directory = mem_resize(l->directory, *capacity * sizeof *l->directory);
    }
    char *copy = mem_strdup(name);
    l->name[l->count] = copy;
    if (read_name(name, part, &d)) {
        l->name[l->count] = l->name[l->named];
        l->name[l->named] = copy;
        l->directory[l->named++] = d;
    }
    l->count++;
}

static bool is_skipped(const char *name)
{
    return strcmp(name, ".") == 0 || strcmp(name, "..") == 0 || strcmp(name, INVENTORY_PROBE_NAME) == 0;
}

static bool list(const char *work_dir, int part, listing *l, error *e)
{
    char *path = mem_printf("%s/%s", work_dir, parts[part]);
    size_t capacity = 0;
    struct stat info;
    l->linked = lstat(path, &info) == 0 && S_ISLNK(info.st_mode);
    DIR *stream = opendir(path);
    for (struct dirent *entry; stream && (errno = 0, entry = readdir(stream));)
        if (!is_skipped(entry->d_name)) append(l, entry->d_name, part, &capacity);
    bool ok = (stream && !errno) || error_set(e, ERROR_INTERNAL, "cannot list %s: %s", path, strerror(errno));
    if (stream) closedir(stream);
    free(path);
    sort(l);
    return ok;
}

/* What happens to an entry. */
typedef enum decision {
    STAYS,
    HAS_NO_JOB,  /* move it; a failure is a warning */
    BLOCKS_A_JOB /* move it; a failure is an error: a task will need the name for its result or an attempt */
} decision;

/* Corrects the report of a job that is not an array: an earlier version may have linked it to another
 * job's report. */
static bool correct_report(queue *q, const char *directory, const queue_directory *d, error *e)
{
    queue_job job = {0};
    bool found = false;
    bool ok = d->frame != QUEUE_NO_FRAME || (queue_get(q, d->id, &job, &found, e) &&
                                             (!found || own_report_correct(directory, job.spec, e)));
    queue_job_clear(&job);
    return ok;
}

/* Examines the result of a waiting task: a complete one ends the task, any other blocks it. */
static bool end_from_result(queue *q, const char *work_dir, const queue_directory *d, decision *v,
                            size_t *ended, error *e)
{
    struct stat info;
    result r = {0};
    error why = {0};
    bool accepted = false;
    char *directory = result_directory(work_dir, d->id, d->frame);
    bool whole = lstat(directory, &info) == 0 && S_ISDIR(info.st_mode) && result_read(directory, &r, &why) &&
                 result_compare_at_start(directory, &r, &why);
    if (r.output && !whole)
        log_write(LOG_LEVEL_WARNING, "a result is not used: %s: %s", directory, why.message);
    bool ok = whole || why.code != ERROR_INTERNAL ||
              error_set(e, ERROR_INTERNAL, "the result %s: %s", directory, why.message);
    if (whole)
        ok = correct_report(q, directory, d, e) &&
             queue_end_found(q, d->id, d->frame, r.outcome, &accepted, e);
    *v = whole ? STAYS : BLOCKS_A_JOB;
    *ended += accepted;
    result_clear(&r);
    free(directory);
    return ok;
}

/* Decides on a result. If a failed task has one, the database is older than a retry of the task. The task
 * keeps its state, and its result is moved, because it would block the next retry. */
static bool decide_on_result(queue *q, const char *work_dir, const queue_directory *d, decision *v,
                             size_t *ended, error *e)
{
    *v = d->to_be_removed || (d->known && (d->state == QUEUE_SUCCEEDED || d->state == QUEUE_RUNNING))
             ? STAYS
             : HAS_NO_JOB;
    if (d->known && !queue_state_is_final(d->state) && d->state != QUEUE_RUNNING)
        return end_from_result(q, work_dir, d, v, ended, e);
    return true;
}

/* Decides on an attempt. The queue stores the number before the directory is created, so a directory with a
 * higher number was made with a newer database. */
static decision decide_on_attempt(const queue_directory *d)
{
    if (d->to_be_removed || (d->known && d->attempt <= d->last_attempt)) return STAYS;
    return d->known && !queue_state_is_final(d->state) ? BLOCKS_A_JOB : HAS_NO_JOB;
}

typedef struct tally {
    size_t moved, left, ended;
    error why; /* of the first entry that could not be moved */
} tally;

static void move(const char *work_dir, int part, const listing *l, size_t i, tally *t)
{
    error why = {0};
    if (l->linked)
        error_set(&why, ERROR_INTERNAL,
                  "%s/%s is a symbolic link, and results are not moved out of other directories: "
                  "replace it by a directory",
                  work_dir, parts[part]);
    else if (lost_found_move(work_dir, parts[part], l->name[i], &why))
        t->moved++;
    if (why.code == ERROR_NONE) return;
    if (!t->left++) t->why = why;
}

static bool settle_part(queue *q, const char *work_dir, int part, const listing *l, tally *t, error *e)
{
    size_t before = t->moved;
    for (size_t i = 0; i < l->count; i++) {
        decision v = HAS_NO_JOB;
        if (i < l->named && part == ATTEMPTS) v = decide_on_attempt(&l->directory[i]);
        if (i < l->named && part == RESULTS &&
            !decide_on_result(q, work_dir, &l->directory[i], &v, &t->ended, e))
            return false;
        if (v == STAYS) continue;
        size_t left = t->left;
        move(work_dir, part, l, i, t);
        if (v == BLOCKS_A_JOB && t->left > left)
            return error_set(e, ERROR_INTERNAL, "cannot move %s/%s/%s, which blocks a job: %s", work_dir,
                             parts[part], l->name[i], t->why.message);
    }
    return t->moved == before || lost_found_flush(work_dir, parts[part], e);
}

static void log_tally(const char *work_dir, const tally *t, size_t adopted)
{
    if (adopted) log_write(LOG_LEVEL_WARNING, "jobs adopted from their results count=%zu", adopted);
    if (t->ended)
        log_write(LOG_LEVEL_WARNING,
                  "waiting jobs and frames ended because their results were found count=%zu", t->ended);
    if (t->moved)
        log_write(LOG_LEVEL_WARNING,
                  "results and attempts without a job in the queue were moved to %s/" LOST_FOUND_DIRECTORY
                  " count=%zu: inspect them, then remove them",
                  work_dir, t->moved);
    if (t->left)
        log_write(LOG_LEVEL_WARNING,
                  "results and attempts without a job in the queue remain in %s count=%zu: %s", work_dir,
                  t->left, t->why.message);
}

bool inventory_take(queue *q, const char *work_dir, bool adopt, error *e)
{
    listing found[2] = {0};
    tally t = {0};
    size_t adopted = 0;
    listing *results = &found[RESULTS], *attempts = &found[ATTEMPTS];
    bool ok = list(work_dir, RESULTS, results, e) && list(work_dir, ATTEMPTS, attempts, e) &&
              queue_find_directories(q, results->directory, results->named, e);
    if (ok && adopt)
        ok = adoption_run(q, work_dir, results->directory, results->named, &adopted, e) &&
             queue_find_directories(q, results->directory, results->named, e);
    ok = ok && queue_find_directories(q, attempts->directory, attempts->named, e) &&
         settle_part(q, work_dir, RESULTS, results, &t, e) &&
         settle_part(q, work_dir, ATTEMPTS, attempts, &t, e);
    log_tally(work_dir, &t, adopted);
    listing_clear(results);
    listing_clear(attempts);
    return ok;
}
