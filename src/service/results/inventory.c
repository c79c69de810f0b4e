// SPDX-License-Identifier: Apache-2.0
#include "service/results/inventory.h"

#include <dirent.h>
#include <errno.h>
#include <limits.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/core/clock.h"
#include "base/core/log.h"
#include "base/core/memory.h"
#include "base/core/terminal_text.h"
#include "service/results/adoption.h"
#include "files/file.h"
#include "service/results/own_report.h"
#include "service/results/result.h"
#include "service/uploads/upload_store.h"

/* Interval of progress, in ms. */
enum { PROGRESS_MS = 1000 };

/* What a walk reads, besides names. */
typedef enum depth {
    WAITING,  /* the results of waiting tasks */
    COMPLETE, /* those of succeeded tasks: their files are there, with their lengths */
    CONTENTS  /* and the bytes of these files */
} depth;

static const char results_part[] = "results", attempts_part[] = "attempts", inputs_part[] = "inputs";

/* The entries of a part of the work directory, in the order of ids, frames and attempts: the database finds neighbouring
 * ids faster. Entries whose names have another form than those of tasks have the id "". */
typedef struct inventory {
    queue *q;
    const char *work_dir, *part;
    depth depth;
    bool linked; /* the part itself is a symbolic link */
    queue_directory *entry;
    size_t count, capacity;
} inventory;

static void clear(inventory *v)
{
    for (size_t i = 0; i < v->count; i++) free(v->entry[i].name);
    free(v->entry);
}

/* ---- the entries */

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
static bool read_name(const char *name, bool of_attempts, queue_directory *d)
{
    if (strlen(name) < ULID_SIZE - 1) return false;
    memcpy(d->id, name, ULID_SIZE - 1);
    const char *rest = name + ULID_SIZE - 1;
    int number[2], count = 0;
    while (count < 2 && *rest && read_number(&rest, &number[count])) count++;
    if (*rest || !ulid_is_valid(d->id)) return false;
    if (of_attempts && (count == 0 || number[count - 1] == 0)) return false;
    if (of_attempts) d->attempt = number[--count];
    if (count > 1) return false;
    if (count) d->frame = number[0];
    return true;
}

/* Takes the name, which is freed with the entry. */
static void append(inventory *v, char *name)
{
    queue_directory d = {.frame = QUEUE_NO_FRAME};
    if (!read_name(name, v->part == attempts_part, &d)) d = (queue_directory){.frame = QUEUE_NO_FRAME};
    d.name = name;
    if (v->count == v->capacity)
        v->entry = mem_resize(v->entry, (v->capacity = v->capacity * 2 + 64) * sizeof *v->entry);
    v->entry[v->count++] = d;
}

static int compare_entries(const void *a, const void *b)
{
    const queue_directory *x = a, *y = b;
    int ids = strcmp(x->id, y->id);
    if (ids) return ids;
    if (x->frame != y->frame) return x->frame < y->frame ? -1 : 1;
    return (x->attempt > y->attempt) - (x->attempt < y->attempt);
}

/* Adds the results of succeeded tasks that are not in the directory. */
static bool add_missing(inventory *v, error *e)
{
    queue_directory *wanted = NULL;
    size_t count = 0;
    const size_t there = v->count;
    bool ok = queue_list_results(v->q, &wanted, &count, e);
    for (size_t i = 0; i < count; i++) {
        if (there && bsearch(&wanted[i], v->entry, there, sizeof *v->entry, compare_entries)) continue;
        char *path = result_directory(v->work_dir, wanted[i].id, wanted[i].frame);
        append(v, mem_strdup(strrchr(path, '/') + 1));
        free(path);
    }
    free(wanted);
    return ok;
}

static bool list_names(inventory *v, error *e)
{
    struct stat info;
    char *path = mem_printf("%s/%s", v->work_dir, v->part);
    v->linked = lstat(path, &info) == 0 && S_ISLNK(info.st_mode);
    DIR *stream = opendir(path);
    for (struct dirent *d; stream && (errno = 0, d = readdir(stream));)
        if (strcmp(d->d_name, ".") != 0 && strcmp(d->d_name, "..") != 0 &&
            strcmp(d->d_name, INVENTORY_PROBE_NAME) != 0)
            append(v, mem_strdup(d->d_name));
    bool ok = (stream ? !errno : errno == ENOENT) ||
              error_set(e, ERROR_INTERNAL, "cannot list %s: %s", path, strerror(errno));
    if (stream) closedir(stream);
    free(path);
    if (v->count) qsort(v->entry, v->count, sizeof *v->entry, compare_entries);
    return ok;
}

static bool list(inventory *v, error *e)
{
    return list_names(v, e) && (v->depth == WAITING || add_missing(v, e)) &&
           queue_find_directories(v->q, v->entry, v->count, e);
}

/* ---- differences */

typedef enum difference {
    NONE,
    HAS_NO_JOB,   /* or its job ended without it */
    BLOCKS_A_JOB, /* a task will need the name for its result or an attempt */
    ENDS_A_TASK,  /* the complete result of a waiting task */
    IS_DAMAGED    /* the result of a succeeded task is missing, incomplete or damaged */
} difference;

/* Reads the result of a waiting or succeeded task. *why: what is wrong; internal: it could not be read. */
static difference examine(const inventory *v, const queue_directory *d, bool waits, result *r, error *why)
{
    struct stat info;
    char *directory = result_directory(v->work_dir, d->id, d->frame);
    bool whole = (!waits || (lstat(directory, &info) == 0 && S_ISDIR(info.st_mode))) &&
                 result_read(directory, r, why) &&
                 (waits ? result_compare_at_start(directory, r, why)
                        : v->depth == COMPLETE || result_compare(directory, r, NULL, why));
    if (waits && r->output && !whole)
        log_write(LOG_LEVEL_WARNING, "a result is not used: %s: %s", directory, why->message);
    free(directory);
    return whole ? (waits ? ENDS_A_TASK : NONE) : waits ? BLOCKS_A_JOB : IS_DAMAGED;
}

/* If a failed task has a result, the database is older than a retry of the task. The task keeps its state, and its
 * result blocks the next retry. The queue stores the number of an attempt before the directory is created, so a
 * directory with a higher number was made with a newer database. */
static difference find_difference(const inventory *v, const queue_directory *d, result *r, error *why)
{
    const bool ended = queue_state_is_final(d->state), waits = !ended && d->state != QUEUE_RUNNING;
    if (d->to_be_removed) return NONE;
    if (!d->known) return HAS_NO_JOB;
    if (v->part == attempts_part)
        return d->attempt <= d->last_attempt ? NONE : ended ? HAS_NO_JOB : BLOCKS_A_JOB;
    if (ended && d->state != QUEUE_SUCCEEDED) return HAS_NO_JOB;
    const bool is_read = v->depth == WAITING ? waits : ended;
    return is_read ? examine(v, d, waits, r, why) : NONE;
}

/* ---- the start */

typedef struct repairs {
    size_t moved, left, ended;
    error why; /* of the first entry that could not be moved */
} repairs;

/* Ends a task with its result. The report of a job that is not an array is corrected: an earlier version may have
 * linked it to another job's report. */
static bool end_task(const inventory *v, const queue_directory *d, queue_outcome outcome, size_t *ended,
                     error *e)
{
    queue_job job = {0};
    bool found = false, accepted = false;
    char *directory = result_directory(v->work_dir, d->id, d->frame);
    bool ok = d->frame != QUEUE_NO_FRAME || (queue_get(v->q, d->id, &job, &found, e) &&
                                             (!found || own_report_correct(directory, job.spec, e)));
    ok = ok && queue_end_found(v->q, d->id, d->frame, outcome, &accepted, e);
    *ended += accepted;
    queue_job_clear(&job);
    free(directory);
    return ok;
}

/* Renames WORK_DIR/PART/NAME to WORK_DIR/lost+found/PART/NAME, or to NAME~1, NAME~2, ... if the name exists there. No other
 * process creates names there: the daemon holds the lock on the state directory. */
static bool rename_aside(const inventory *v, const char *name, error *e)
{
    struct stat info;
    char *directory = mem_printf("%s/" INVENTORY_LOST_FOUND "/%s", v->work_dir, v->part),
         *from = mem_printf("%s/%s/%s", v->work_dir, v->part, name),
         *to = mem_printf("%s/%s", directory, name);
    for (int again = 1; lstat(to, &info) == 0; again++) {
        free(to);
        to = mem_printf("%s/%s~%d", directory, name, again);
    }
    bool ok = store_directory_create(directory, e) &&
              (rename(from, to) == 0 ||
               error_set(e, ERROR_INTERNAL, "cannot move %s to %s: %s", from, to, strerror(errno)));
    free(directory);
    free(from);
    free(to);
    return ok;
}

static bool flush_moves(const inventory *v, error *e)
{
    char *from = mem_printf("%s/%s", v->work_dir, v->part),
         *to = mem_printf("%s/" INVENTORY_LOST_FOUND "/%s", v->work_dir, v->part);
    bool ok = store_directory_sync(to, e) && store_directory_sync(from, e);
    free(from);
    free(to);
    return ok;
}

/* Moves an entry to lost+found. A failure is a warning, unless a task will need the name. */
static bool move(const inventory *v, const queue_directory *d, difference found, repairs *t, error *e)
{
    error why = {0};
    if (v->linked)
        error_set(&why, ERROR_INTERNAL,
                  "%s/%s is a symbolic link, and results are not moved out of other directories: "
                  "replace it by a directory",
                  v->work_dir, v->part);
    else if (rename_aside(v, d->name, &why))
        t->moved++;
    if (found == BLOCKS_A_JOB && why.code == ERROR_NONE)
        log_write(LOG_LEVEL_WARNING,
                  "%s/%s, where a waiting job will write, is moved to %s/" INVENTORY_LOST_FOUND, v->part,
                  d->name, v->work_dir);
    if (why.code == ERROR_NONE) return true;
    if (!t->left++) t->why = why;
    return found != BLOCKS_A_JOB ||
           error_set(e, ERROR_INTERNAL, "cannot move %s/%s/%s, which blocks a job: %s", v->work_dir, v->part,
                     d->name, why.message);
}

static bool repair(const inventory *v, repairs *t, error *e)
{
    const size_t before = t->moved;
    bool ok = true;
    for (size_t i = 0; ok && i < v->count; i++) {
        const queue_directory *d = &v->entry[i];
        result r = {0};
        error why = {0};
        difference found = find_difference(v, d, &r, &why);
        if (why.code == ERROR_INTERNAL)
            ok = error_set(e, ERROR_INTERNAL, "the result %s/%s/%s: %s", v->work_dir, v->part, d->name,
                           why.message);
        else if (found == ENDS_A_TASK)
            ok = end_task(v, d, r.outcome, &t->ended, e);
        else if (found != NONE)
            ok = move(v, d, found, t, e);
        result_clear(&r);
    }
    return ok && (t->moved == before || flush_moves(v, e));
}

static void log_repairs(const char *work_dir, const repairs *t, size_t adopted)
{
    if (adopted) log_write(LOG_LEVEL_WARNING, "jobs adopted from their results count=%zu", adopted);
    if (t->ended)
        log_write(LOG_LEVEL_WARNING,
                  "waiting jobs and frames ended because their results were found count=%zu", t->ended);
    if (t->moved)
        log_write(LOG_LEVEL_WARNING,
                  "results and attempts without a job in the queue were moved to %s/" INVENTORY_LOST_FOUND
                  " count=%zu: inspect them, then remove them",
                  work_dir, t->moved);
    if (t->left)
        log_write(LOG_LEVEL_WARNING,
                  "results and attempts without a job in the queue remain in %s count=%zu: %s", work_dir,
                  t->left, t->why.message);
}

bool inventory_take(queue *q, const char *work_dir, bool adopt, error *e)
{
    inventory results = {.q = q, .work_dir = work_dir, .part = results_part},
              attempts = {.q = q, .work_dir = work_dir, .part = attempts_part};
    repairs t = {0};
    size_t adopted = 0;
    bool ok = list(&results, e) &&
              (!adopt || (adoption_run(q, work_dir, results.entry, results.count, &adopted, e) &&
                          queue_find_directories(q, results.entry, results.count, e))) &&
              list(&attempts, e) && repair(&results, &t, e) && repair(&attempts, &t, e);
    log_repairs(work_dir, &t, adopted);
    clear(&results);
    clear(&attempts);
    return ok;
}

/* ---- the check */

typedef struct check {
    inventory results, uploads;
    FILE *out;
    inventory_tally *tally;
    int64_t read_bytes, all_bytes; /* of results; with CONTENTS */
    int64_t shown_ms;              /* time of the last progress */
} check;

/* Prints progress; on a terminal over the last one. */
static void show_progress(check *c, bool is_last)
{
    const int64_t now = clock_monotonic_ms();
    const bool terminal = isatty(STDERR_FILENO);
    if (c->results.depth != CONTENTS || (!is_last && now - c->shown_ms < PROGRESS_MS)) return;
    c->shown_ms = now;
    if (terminal) fputc('\r', stderr);
    fprintf(stderr, "compared %zu results, %lld of about %lld MiB, and %zu uploads", c->tally->results,
            (long long)c->read_bytes >> 20, (long long)c->all_bytes >> 20, c->tally->uploads);
    if (!terminal || is_last) fputc('\n', stderr);
}

static bool check_results(check *c, error *e)
{
    for (size_t i = 0; i < c->results.count; i++) {
        const queue_directory *d = &c->results.entry[i];
        result r = {0};
        error why = {0};
        difference found = find_difference(&c->results, d, &r, &why);
        const bool unknown = found == HAS_NO_JOB && !d->known, damaged = found == IS_DAMAGED;
        for (size_t k = 0; k < r.output_count; k++) c->read_bytes += r.output[k].bytes;
        result_clear(&r);
        if (why.code == ERROR_INTERNAL) return error_set(e, why.code, "%s", why.message);
        if (unknown) terminal_text_print(c->out, "results/%s: no such job in the queue\n", d->name);
        if (damaged) terminal_text_print(c->out, "result of %s: %s\n", d->name, why.message);
        c->tally->results += d->known && d->state == QUEUE_SUCCEEDED;
        c->tally->findings += unknown || damaged;
        show_progress(c, false);
    }
    return true;
}

static void check_uploads(check *c)
{
    char *directory = mem_printf("%s/%s", c->uploads.work_dir, c->uploads.part);
    for (size_t i = 0; i < c->uploads.count; i++) {
        const char *name = c->uploads.entry[i].name;
        if (!sent_file_is_name(name)) continue;
        error why = {0};
        store_inputs_compare(directory, name, &why);
        if (why.code == ERROR_INPUT_DAMAGED)
            terminal_text_print(
                c->out,
                "upload %s is damaged: start hexad, run \"hexadctl delete-upload --all %s\", and send "
                "the file again\n",
                name, name);
        else if (why.code != ERROR_NONE)
            terminal_text_print(c->out, "upload %s cannot be compared: %s. Check the file and its disk\n",
                                name, why.message);
        c->tally->uploads++;
        c->tally->findings += why.code != ERROR_NONE;
        show_progress(c, false);
    }
    free(directory);
}

bool inventory_check(queue *q, const char *work_dir, bool contents, FILE *out, inventory_tally *tally,
                     error *e)
{
    queue_usage usage = {0};
    check c = {.results = {q, work_dir, results_part, contents ? CONTENTS : COMPLETE},
               .uploads = {q, work_dir, inputs_part},
               .out = out,
               .tally = tally};
    bool ok = queue_get_usage(q, &usage, e);
    c.all_bytes = usage.all.bytes;
    free(usage.user);
    ok = ok && list(&c.results, e) && check_results(&c, e) && (!contents || list_names(&c.uploads, e));
    if (ok) check_uploads(&c);
    show_progress(&c, true);
    clear(&c.results);
    clear(&c.uploads);
    return ok;
}
