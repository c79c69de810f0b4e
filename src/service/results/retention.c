// SPDX-License-Identifier: Apache-2.0
#include "service/results/retention.h"

#include <dirent.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/core/clock.h"
#include "base/core/log.h"
#include "base/core/memory.h"
#include "service/results/result.h"
#include "files/file.h"

/* Jobs that are processed before the task checks whether it must end. */
#define AT_ONCE 100
/* Notes of directories that are removed with one flush. */
#define REMOVALS_AT_ONCE 1000
/* Wait after a failed removal, in milliseconds. */
#define REMOVE_AGAIN_MS 10000
/* Longest time between two collections of uploaded files, in milliseconds. */
#define COLLECT_MOST_MS 3600000
/* Collections in the time for which uploaded files are kept, if that is shorter than COLLECT_MOST_MS times
 * this number. */
#define COLLECTIONS_IN_KEEP 4
/* Longest wait between two readings of the wall clock, in milliseconds, because the clock may be set. */
#define LOOK_MS 60000
/* Interval of storing the running time, in milliseconds. After a crash, up to this much of it is lost. */
#define STORE_MS 600000

struct retention {
    queue *q;
    char *work_dir;
    store_inputs *inputs; /* NULL: uploaded files are not collected */
    int64_t keep_ms;      /* of uploaded files; 0: without limit */
    runner_task *task;
    pthread_mutex_t mutex; /* guards `delivered` and `left` */
    fetches *fetches;
    int space_fd;
    atomic_uint_fast64_t evicted;
    pthread_mutex_t removing;  /* held while directories are removed */
    fetches_result *delivered; /* results that were sent completely and are not yet marked in the queue */
    size_t delivered_count;
    bool left; /* some noted directories may still exist */
    /* The following are used by the task only. Monotonic times of the next attempt of a failed removal, of
     * the next collection of uploaded files, and of the next storing of the running time: */
    int64_t again_ms, collect_ms, store_ms;
    bool trouble;     /* a failed removal has been logged */
    DIR *results;     /* results/, while temporary files of an earlier daemon are removed; otherwise NULL */
    int64_t began_ms; /* of this daemon, wall clock */
};

static int64_t least(int64_t a, int64_t b)
{
    return a < b ? a : b;
}

/* Removes the directories of a deleted task. A missing directory is not an error: an earlier removal may have
 * removed it. */
static bool remove_task(retention *r, const queue_removal *task, error *e)
{
    char *path = result_directory(r->work_dir, task->id, task->frame);
    bool ok = store_remove(path, e);
    free(path);
    for (int number = 1; ok && number <= task->attempts; number++) {
        path = result_attempt_directory(r->work_dir, task->id, task->frame, number);
        ok = store_remove(path, e);
        free(path);
    }
    return ok;
}

/* Flushes results/ and attempts/, so that all removals are durable, also those of an earlier run that
 * crashed. */
static bool flush_places(retention *r, error *e)
{
    char *results = mem_printf("%s/results", r->work_dir), *attempts = mem_printf("%s/attempts", r->work_dir);
    bool ok = store_directory_sync(results, e) && store_directory_sync(attempts, e);
    free(results);
    free(attempts);
    return ok;
}

/* Removes the directories of these notes, flushes, then removes the notes. If a directory cannot be removed,
 * its note stays, and the remaining ones are processed. */
static bool remove_tasks(retention *r, queue_removal *tasks, size_t count, error *e)
{
    size_t gone = 0;
    bool ok = true;
    for (size_t i = 0; i < count; i++) {
        if (remove_task(r, &tasks[i], e))
            tasks[gone++] = tasks[i];
        else
            ok = false;
    }
    error why = {0};
    if (gone && !(flush_places(r, &why) && queue_end_removals(r->q, tasks, gone, &why))) {
        if (ok && e) *e = why;
        ok = false;
    }
    return ok;
}

/* Processes the notes of one job or (NULL) of all jobs. False if some remain. Any thread; `removing`
 * serialises. */
static bool work_off(retention *r, const char *id, error *e)
{
    queue_removal *tasks = NULL;
    size_t count = REMOVALS_AT_ONCE;
    int64_t after = 0;
    bool ok = true, more = !id;
    while (ok && more && !runner_is_stopping(r->task)) ok = queue_delete_hidden(r->q, &more, e);
    while (count == REMOVALS_AT_ONCE && !runner_is_stopping(r->task)) {
        pthread_mutex_lock(&r->removing);
        if (queue_list_removals(r->q, id, after, REMOVALS_AT_ONCE, &tasks, &count, e)) {
            if (count) after = tasks[count - 1].number;
            if (count && !remove_tasks(r, tasks, count, e)) ok = false;
            free(tasks);
        } else {
            count = 0;
            ok = false;
        }
        pthread_mutex_unlock(&r->removing);
    }
    return ok && count < REMOVALS_AT_ONCE;
}

static void set_left(retention *r, bool left)
{
    pthread_mutex_lock(&r->mutex);
    r->left = left;
    pthread_mutex_unlock(&r->mutex);
}

/* Processes the remaining notes if it is time, and logs a failure once. Returns the monotonic time of the
 * next attempt. */
static int64_t work_off_rest(retention *r)
{
    error e = {0};
    int64_t now = clock_monotonic_ms();
    pthread_mutex_lock(&r->mutex);
    bool left = r->left;
    r->left = false;
    pthread_mutex_unlock(&r->mutex);
    if (!left) return INT64_MAX;
    bool due = now >= r->again_ms;
    bool ok = due && work_off(r, NULL, &e);
    if (!ok) set_left(r, true);
    if (!due) return r->again_ms;
    if (!ok && !r->trouble && e.code != ERROR_NONE)
        log_write(LOG_LEVEL_WARNING, "cannot remove the files of deleted jobs and tries again: %s",
                  e.message);
    if (ok && r->trouble) log_write(LOG_LEVEL_INFO, "the files of deleted jobs are removed");
    r->trouble = !ok;
    r->again_ms = now + REMOVE_AGAIN_MS;
    return ok ? INT64_MAX : r->again_ms;
}

bool retention_delete(retention *r, const char *id, bool *found, bool *deleted, error *e)
{
    *deleted = false;
    const bool whole = queue_delete(r->q, id, found, deleted, e);
    if (!*deleted) return whole;
    log_write(LOG_LEVEL_INFO, "job expired job=%s", id);
    if (!whole || !work_off(r, id, NULL)) {
        set_left(r, true);
        retention_wake(r);
    }
    ssize_t written = write(r->space_fd, &(uint64_t){1}, sizeof(uint64_t));
    (void)written; /* fails only if the counter is full, and then the eventfd is readable anyway */
    return true;
}

void retention_note_sent(retention *r, const fetches_result *of, size_t index, size_t count)
{
    if (!fetches_note(r->fetches, of, index, count)) return;
    pthread_mutex_lock(&r->mutex);
    r->delivered = mem_resize(r->delivered, (r->delivered_count + 1) * sizeof *r->delivered);
    r->delivered[r->delivered_count++] = *of;
    pthread_mutex_unlock(&r->mutex);
    retention_wake(r);
}

uint64_t retention_count_evicted(const retention *r)
{
    return atomic_load(&r->evicted);
}

/* Marks sent results as delivered in the queue. If that fails, the result must be fetched again to count as
 * delivered. */
static void note_delivered(retention *r)
{
    error e = {0};
    pthread_mutex_lock(&r->mutex);
    fetches_result *delivered = r->delivered;
    size_t count = r->delivered_count;
    r->delivered = NULL;
    r->delivered_count = 0;
    pthread_mutex_unlock(&r->mutex);
    for (size_t i = 0; i < count; i++)
        if (!queue_note_delivery(r->q, delivered[i].id, delivered[i].frame, clock_wall_ms(), &e))
            log_write(LOG_LEVEL_WARNING, "cannot record a fetched result as delivered job=%s: %s",
                      delivered[i].id, e.message);
    free(delivered);
}

/* The disk space of the results and attempts of all tasks of a job. */
static bool measure(retention *r, const char *id, int64_t *bytes, error *e)
{
    queue_task *tasks = NULL;
    size_t count = 0;
    *bytes = 0;
    if (!queue_list_tasks(r->q, id, -1, INT32_MAX, &tasks, &count, e)) return false;
    for (size_t i = 0; i < count; i++)
        for (int attempt = 0; attempt <= tasks[i].attempt; attempt++) {
            char *path = attempt ? result_attempt_directory(r->work_dir, id, tasks[i].frame, attempt)
                                 : result_directory(r->work_dir, id, tasks[i].frame);
            *bytes += result_disk_bytes(path);
            free(path);
        }
    queue_tasks_free(tasks, count);
    return true;
}

/* Measures up to AT_ONCE jobs without a stored size: jobs of older versions and adopted ones. *more: others
 * may remain. */
static bool measure_some(retention *r, bool *more)
{
    char id[ULID_SIZE];
    bool ok = true, found = true;
    for (int i = 0; ok && found && i < AT_ONCE; i++) {
        int64_t bytes = 0;
        ok = queue_next_unmeasured(r->q, id, &found, NULL) &&
             (!found || (measure(r, id, &bytes, NULL) && queue_note_bytes(r->q, id, bytes, NULL)));
    }
    *more = ok && found;
    return ok;
}

/* Deletes up to AT_ONCE jobs while results reach a bound. *more: others may have to be deleted. */
static bool evict_some(retention *r, bool *more)
{
    char id[ULID_SIZE];
    bool ok = true, found = true, known, deleted;
    for (int i = 0; ok && found && i < AT_ONCE; i++) {
        ok = queue_next_leaving(r->q, id, &found, NULL);
        if (!ok || !found) break;
        log_write(LOG_LEVEL_INFO, "job is deleted because results have reached a bound job=%s", id);
        ok = retention_delete(r, id, &known, &deleted, NULL);
        atomic_fetch_add(&r->evicted, ok);
    }
    *more = ok && found;
    return ok;
}

/* Deletes up to AT_ONCE jobs whose retention has expired. *more: others may remain. */
static bool forget_some(retention *r, bool *more)
{
    char(*ids)[ULID_SIZE] = NULL;
    size_t count = 0;
    bool found, deleted;
    running_bound bounds[RUNNING_BOUNDS_MOST];
    size_t bound_count = running_time_list_bounds(queue_running(r->q), bounds);
    if (!queue_list_expired(r->q, bounds, bound_count, AT_ONCE, &ids, &count, NULL)) return false;
    bool ok = true;
    for (size_t i = 0; ok && i < count; i++) ok = retention_delete(r, ids[i], &found, &deleted, NULL);
    *more = count == AT_ONCE;
    free(ids);
    return ok;
}

/* Removes the temporary files that a killed daemon left in up to AT_ONCE results. *more: others may have
 * some. */
static void clear_some(retention *r, bool *more)
{
    struct dirent *entry = NULL;
    for (int i = 0; r->results && i < AT_ONCE && (entry = readdir(r->results)); i++) {
        if (entry->d_name[0] == '.') continue;
        char *path = mem_printf("%s/results/%s", r->work_dir, entry->d_name);
        result_clear_temporary(path, r->began_ms);
        free(path);
    }
    if (r->results && !entry) {
        closedir(r->results);
        r->results = NULL;
    }
    *more = r->results != NULL;
}

/* *at_ms: the monotonic time at which the next retention after `looked_ms` (wall clock) expires, at most
 * LOOK_MS from now. It is in the past if the retention has expired since forget_some ran. Jobs whose expiry
 * is held back after a step of the wall clock are examined every LOOK_MS. */
static bool find_next_expiry(retention *r, int64_t looked_ms, int64_t *at_ms)
{
    int64_t next;
    if (!queue_next_expiry(r->q, looked_ms, &next, NULL)) return false;
    *at_ms = clock_monotonic_ms() + least(next - clock_wall_ms(), LOOK_MS);
    return true;
}

/* Removes uploaded files that are unused or held by no user, if the next collection is due. */
static void collect_inputs(retention *r)
{
    error e = {0};
    size_t gone = 0;
    int64_t now = clock_monotonic_ms();
    if (!r->inputs || now < r->collect_ms) return;
    if (!store_inputs_collect(r->inputs, r->keep_ms, &gone, &e))
        log_write(LOG_LEVEL_WARNING, "cannot delete expired inputs: %s", e.message);
    if (gone) log_write(LOG_LEVEL_INFO, "expired inputs deleted count=%zu", gone);
    r->collect_ms = now + (r->keep_ms > 0 ? least(r->keep_ms / COLLECTIONS_IN_KEEP + 1, COLLECT_MOST_MS)
                                          : COLLECT_MOST_MS);
}

/* Stores the running time of the daemon, if it is due. */
static void store_running(retention *r)
{
    int64_t now = clock_monotonic_ms();
    if (now < r->store_ms) return;
    r->store_ms = now + (queue_store_running(r->q, NULL) ? STORE_MS : RUNNER_RETRY_MS);
}

/* Does what is due. */
static int64_t sweep(void *context)
{
    retention *r = context;
    bool more[4] = {false};
    int64_t next = 0, again;
    /* what is at the path of a lost state directory may belong to another service */
    if (!queue_has_place(r->q, NULL)) return runner_retry_time();
    store_running(r);
    again = work_off_rest(r);
    collect_inputs(r);
    note_delivered(r);
    int64_t looked_ms = clock_wall_ms();
    bool ok = forget_some(r, &more[0]) && measure_some(r, &more[1]) && evict_some(r, &more[2]);
    clear_some(r, &more[3]);
    bool any = more[0] || more[1] || more[2] || more[3];
    if (!ok || (!any && !find_next_expiry(r, looked_ms, &next)))
        next = runner_retry_time();
    else if (any)
        next = 0;
    if (r->inputs) next = least(next, r->collect_ms);
    next = least(next, clock_monotonic_ms() + LOOK_MS);
    return least(next, least(again, r->store_ms));
}

void retention_free(retention *r)
{
    if (!r) return;
    queue_store_running(r->q, NULL);
    pthread_mutex_destroy(&r->removing);
    pthread_mutex_destroy(&r->mutex);
    fetches_free(r->fetches);
    if (r->results) closedir(r->results);
    free(r->delivered);
    free(r->work_dir);
    free(r);
}

retention *retention_add(runner *to, queue *q, const char *work_dir, store_inputs *inputs, double keep_s,
                         int space_fd)
{
    retention *r = mem_alloc(sizeof *r);
    r->q = q;
    r->space_fd = space_fd;
    r->fetches = fetches_new();
    r->left = true; /* a crash may have left noted directories */
    r->inputs = inputs;
    r->keep_ms = (int64_t)(keep_s * 1000);
    r->work_dir = mem_strdup(work_dir);
    r->began_ms = clock_wall_ms();
    char *results = mem_printf("%s/results", work_dir);
    r->results = opendir(results);
    free(results);
    pthread_mutex_init(&r->mutex, NULL);
    pthread_mutex_init(&r->removing, NULL);
    r->task = runner_add(to, "retention", sweep, r);
    return r;
}

void retention_wake(retention *r)
{
    runner_wake(r->task);
}
