#include "executor/retention.h"

#include <dirent.h>
#include <errno.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "base/clock.h"
#include "base/log.h"
#include "base/memory.h"
#include "executor/result.h"
#include "store/file.h"

/* Looked at and removed in one go; between two the thread looks whether it is to end. */
#define AT_ONCE 100
/* After trouble with the database. */
#define RETRY_MS 1000
/* Between two looks at the files that were sent, at most; else a part of the time that they are kept. */
#define LOOK_MOST_MS 3600000
#define LOOKS_IN_KEEP 4

struct retention {
    queue *q;
    char *state_dir;
    store_inputs *inputs; /* NULL: none is collected */
    int64_t keep_ms;
    pthread_t thread;
    pthread_mutex_t mutex;
    pthread_cond_t woken;
    bool wake, stop;
};

static void remove_directory(char *path)
{
    error e = {0};
    if (!store_remove(path, &e)) log_write(LOG_LEVEL_WARNING, "leftovers stay: %s", e.message);
    free(path);
}

bool retention_delete(retention *r, const char *id, bool *found, bool *deleted, error *e)
{
    queue_task *tasks = NULL;
    size_t count = 0;
    if (!queue_list_tasks(r->q, id, -1, INT32_MAX, &tasks, &count, e)) return false;
    bool ok = queue_delete(r->q, id, found, deleted, e);
    for (size_t i = 0; ok && *deleted && i < count; i++) {
        remove_directory(result_directory(r->state_dir, id, tasks[i].frame));
        for (int number = 1; number <= tasks[i].attempt; number++)
            remove_directory(result_attempt_directory(r->state_dir, id, tasks[i].frame, number));
    }
    queue_tasks_free(tasks, count);
    if (ok && *deleted) log_write(LOG_LEVEL_INFO, "job forgotten job=%s", id);
    return ok;
}

/* Whether a directory has the name of a job's that the queue does not know. */
static bool is_orphan(queue *q, const char *name)
{
    char id[ULID_SIZE] = "";
    size_t length = strcspn(name, ".");
    if (length != ULID_SIZE - 1) return false;
    memcpy(id, name, length);
    if (!ulid_is_valid(id)) return false;
    queue_task *tasks = NULL;
    size_t count = 0;
    bool ok = queue_list_tasks(q, id, -1, 1, &tasks, &count, NULL);
    queue_tasks_free(tasks, count);
    return ok && !count;
}

static bool sweep(retention *r, const char *part, error *e)
{
    char *path = mem_printf("%s/%s", r->state_dir, part);
    DIR *listing = opendir(path);
    bool ok = listing || errno == ENOENT || error_set(e, ERROR_INTERNAL, "%s: %s", path, strerror(errno));
    for (struct dirent *entry; listing && (entry = readdir(listing));)
        if (is_orphan(r->q, entry->d_name)) remove_directory(mem_printf("%s/%s", path, entry->d_name));
    if (listing) closedir(listing);
    free(path);
    return ok;
}

/* Forgets some of what is over; *more when there may be others. */
static bool forget_some(retention *r, bool *more)
{
    char(*ids)[ULID_SIZE] = NULL;
    size_t count = 0;
    bool found, deleted;
    if (!queue_list_expired(r->q, clock_wall_ms(), AT_ONCE, &ids, &count, NULL)) return false;
    bool ok = true;
    for (size_t i = 0; ok && i < count; i++) ok = retention_delete(r, ids[i], &found, &deleted, NULL);
    *more = count == AT_ONCE;
    free(ids);
    return ok;
}

/* Waits until the time, wall clock, or to be woken; false: to the end. */
static bool wait_until(retention *r, int64_t wall_ms)
{
    struct timespec until = {.tv_sec = (time_t)(wall_ms / 1000), .tv_nsec = (long)(wall_ms % 1000) * 1000000};
    int status = 0;
    pthread_mutex_lock(&r->mutex);
    while (!r->wake && !r->stop && status != ETIMEDOUT)
        status = pthread_cond_timedwait(&r->woken, &r->mutex, &until);
    r->wake = false;
    bool go_on = !r->stop;
    pthread_mutex_unlock(&r->mutex);
    return go_on;
}

/* What cannot be found out is wanted. */
static bool is_wanted(void *context, const char *name)
{
    retention *r = context;
    bool wanted = true;
    return !queue_wants_input(r->q, name, &wanted, NULL) || wanted;
}

/* Collects files that were sent, if it is time; returns when it is again, wall clock. */
static int64_t collect_inputs(retention *r, int64_t due_ms)
{
    error e = {0};
    size_t gone = 0;
    int64_t now = clock_wall_ms(), step = r->keep_ms / LOOKS_IN_KEEP + 1;
    if (step > LOOK_MOST_MS) step = LOOK_MOST_MS;
    /* a clock that was set back must not put it off */
    if (!r->inputs || (now < due_ms && due_ms <= now + step)) return due_ms;
    if (!store_inputs_collect(r->inputs, now - r->keep_ms, is_wanted, r, &gone, &e))
        log_write(LOG_LEVEL_WARNING, "inputs are not collected: %s", e.message);
    if (gone) log_write(LOG_LEVEL_INFO, "inputs collected count=%zu", gone);
    return now + step;
}

static void *keep(void *argument)
{
    retention *r = argument;
    int64_t next = 0, look_ms = r->inputs ? 0 : INT64_MAX;
    do {
        bool more = false;
        look_ms = collect_inputs(r, look_ms);
        if (!forget_some(r, &more) || (!more && !queue_next_expiry(r->q, &next, NULL)))
            next = clock_wall_ms() + RETRY_MS;
        else if (more)
            next = 0;
    } while (wait_until(r, next < look_ms ? next : look_ms));
    return NULL;
}

static void release(retention *r)
{
    pthread_cond_destroy(&r->woken);
    pthread_mutex_destroy(&r->mutex);
    free(r->state_dir);
    free(r);
}

retention *retention_start(queue *q, const char *state_dir, store_inputs *inputs, double keep_s, error *e)
{
    retention *r = mem_alloc(sizeof *r);
    r->q = q;
    r->inputs = keep_s > 0 ? inputs : NULL;
    r->keep_ms = (int64_t)(keep_s * 1000);
    r->state_dir = mem_strdup(state_dir);
    pthread_mutex_init(&r->mutex, NULL);
    pthread_cond_init(&r->woken, NULL);
    int why = 0;
    bool ok = sweep(r, "results", e) && sweep(r, "attempts", e);
    if (ok && (why = pthread_create(&r->thread, NULL, keep, r)) != 0)
        ok = error_set(e, ERROR_INTERNAL, "no thread for what is to be forgotten: %s", strerror(why));
    if (ok) return r;
    release(r);
    return NULL;
}

static void tell(retention *r, bool stop)
{
    pthread_mutex_lock(&r->mutex);
    r->wake = true;
    r->stop |= stop;
    pthread_cond_signal(&r->woken);
    pthread_mutex_unlock(&r->mutex);
}

void retention_wake(retention *r)
{
    tell(r, false);
}

void retention_stop(retention *r)
{
    if (!r) return;
    tell(r, true);
    pthread_join(r->thread, NULL);
    release(r);
}
