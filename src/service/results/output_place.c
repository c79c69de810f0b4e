// SPDX-License-Identifier: Apache-2.0
#include "service/results/output_place.h"

#include <fcntl.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/core/background.h"
#include "base/core/clock.h"
#include "base/core/frames.h"
#include "base/core/log.h"
#include "base/core/memory.h"
#include "base/core/worker_contract.h"
#include "service/results/result.h"
#include "files/turns.h"

/* Maximum time, in ms, that a submission waits for the file system. */
#define LOOK_MS 2000
/* Threads that may wait for the file system of one root. Further checks fail at once: the file system does
 * not respond. */
#define LOOKS_MOST 16

/* The number of running checks below each root. The place and each check refer to it; the last one frees
 * it. */
typedef struct look_counts {
    atomic_int holders;   /* references: the place and the checks */
    atomic_int of_root[]; /* running checks below each root */
} look_counts;

struct output_place {
    queue *q;
    const store_outputs *outputs;
    bool share;
    store_turns *turns;
    look_counts *looks;
    _Atomic(const char *) unwritable; /* output_place_unwritable */
    atomic_bool changed;              /* output_place_note_change */
};

/* A check of a directory, in a thread of its own. If the file system does not respond, it outlives the
 * submission that waits for it; therefore it has copies of all texts. */
typedef struct look {
    look_counts *looks; /* the place's */
    size_t root_index;
    pthread_mutex_t mutex;
    pthread_cond_t ended;
    int users; /* references: the thread and the submission */
    bool done;
    char *root, *path; /* path NULL: the root is checked */
    bool of_user;      /* below the root, only directories of users are written to */
    store_outputs outputs;
    char *name; /* name_with_report of the directory */
    error fault;
} look;

static void release_counts(look_counts *c)
{
    if (atomic_fetch_sub(&c->holders, 1) == 1) free(c);
}

output_place *output_place_new(queue *q, const store_outputs *outputs, bool share)
{
    output_place *p = mem_alloc(sizeof *p);
    p->q = q;
    p->outputs = outputs;
    p->share = share;
    p->turns = store_turns_new();
    p->looks = mem_alloc(sizeof *p->looks + outputs->root_count * sizeof *p->looks->of_root);
    atomic_store(&p->looks->holders, 1);
    return p;
}

void output_place_free(output_place *p)
{
    if (!p) return;
    release_counts(p->looks);
    store_turns_free(p->turns);
    free(p);
}

const store_outputs *output_place_roots(const output_place *p)
{
    return p ? p->outputs : NULL;
}

static bool contains(int directory, const char *file)
{
    struct stat info;
    return fstatat(directory, file, &info, AT_SYMLINK_NOFOLLOW) == 0;
}

/* The name of the directory: store_output_name, else its path. To be freed. */
static char *name_of(int directory, const char *path)
{
    char *name = store_output_name(directory);
    return name ? name : mem_strdup(path);
}

/* The name of the directory if it contains a report, to be freed; otherwise NULL. */
static char *name_with_report(int directory, const char *path)
{
    return contains(directory, WORKER_REPORT_NAME) ? name_of(directory, path) : NULL;
}

/* Error output_taken if the report in this directory was delivered for another user. `name` NULL: there is no
 * report. */
static bool check_owner(const output_place *p, const char *user, const char *name, const char *path, error *e)
{
    char *owner = NULL;
    if (p->share || !name) return true;
    if (!queue_get_output_owner(p->q, name, &owner, e)) return false;
    bool mine = !owner || strcmp(owner, user) == 0;
    free(owner);
    return mine ||
           error_set(
               e, ERROR_OUTPUT_TAKEN,
               "%s: the " WORKER_REPORT_NAME
               " there was delivered for another user: choose another directory (only with the setting share_outputs "
               "may users replace results of others)",
               path);
}

/* ---- copies */

/* Copies a file of all frames to the open directory above the directories of the frames. The record of its
 * owner has the path of the file instead of a directory, because the directory may contain the report of
 * another user. */
static bool copy_stage(output_place *p, const char *user, const char *from, const result_output *stage,
                       int to, const char *above, const char *temporary, error *e)
{
    const store_output_file file = {stage->name, stage->sha256};
    char *name = name_of(to, above), *whole = mem_printf("%s/%s", name, file.name);
    char *own = mem_printf("%s.%s", temporary, file.name); /* records of temporary files have own names */
    bool ok = check_owner(p, user, contains(to, file.name) ? whole : NULL, whole, e) &&
              queue_note_copy(p->q, above, own, whole, user, e) &&
              store_output_copy(p->outputs, from, &file, 1, to, above, own, e) &&
              queue_forget_copy(p->q, own, e);
    free(name);
    free(whole);
    free(own);
    return ok;
}

static bool copy_stages(output_place *p, const char *user, const result *r, const char *from,
                        const char *above, const char *temporary, error *e)
{
    store_turn turn;
    size_t stages = 0;
    for (size_t i = 0; i < r->output_count; i++) stages += frames_is_stage(r->output[i].name);
    if (!stages || !above || !store_output_check_user(p->outputs, user, above, NULL)) return true;
    int to = store_output_open(p->outputs, above, e);
    bool taken = to >= 0 && store_turns_take(p->turns, to, &turn, e), ok = taken;
    for (size_t i = 0; ok && i < r->output_count; i++)
        if (frames_is_stage(r->output[i].name))
            ok = copy_stage(p, user, from, &r->output[i], to, above, temporary, e);
    if (taken) store_turns_end(p->turns, turn);
    if (to >= 0) close(to);
    return ok;
}

static bool copy_in_turn(output_place *p, const char *user, const result *r, const char *from, int to,
                         const char *path, const char *temporary, error *e)
{
    size_t count = 0;
    store_output_file *files = mem_alloc((r->output_count + 1) * sizeof *files);
    for (size_t i = 0; i < r->output_count; i++)
        if (!frames_is_stage(r->output[i].name))
            files[count++] = (store_output_file){r->output[i].name, r->output[i].sha256};
    files[count++] = (store_output_file){WORKER_REPORT_NAME, r->report_sha256};
    char *there = name_with_report(to, path), *name = name_of(to, path);
    bool ok = check_owner(p, user, there, path, e) && queue_note_copy(p->q, path, temporary, name, user, e) &&
              store_output_copy(p->outputs, from, files, count, to, path, temporary, e);
    free(there);
    free(name);
    free(files);
    return ok;
}

char *output_place_directory(const char *directory, int frame)
{
    return frame == QUEUE_NO_FRAME ? mem_strdup(directory) : frames_path(directory, frame);
}

char *output_place_temporary(const char *unique)
{
    return mem_printf(".%s.hexad-tmp", unique);
}

/* As output_place_copy, with the directories of the task. */
static bool copy_to(output_place *p, const char *user, const char *from, const char *directory,
                    const char *above, const char *temporary, error *e)
{
    result r = {0};
    store_turn turn;
    if (!store_output_check_user(p->outputs, user, directory, e) || !result_read(from, &r, e)) return false;
    int to = store_output_open(p->outputs, directory, e);
    bool taken = to >= 0 && store_turns_take(p->turns, to, &turn, e);
    bool ok = taken && copy_in_turn(p, user, &r, from, to, directory, temporary, e);
    if (taken) store_turns_end(p->turns, turn);
    if (to >= 0) close(to);
    ok = ok && copy_stages(p, user, &r, from, above, temporary, e);
    result_clear(&r);
    return ok;
}

bool output_place_copy(output_place *p, const char *user, const char *from, const char *directory, int frame,
                       const char *temporary, error *e)
{
    char *to = output_place_directory(directory, frame),
         *above = frame == QUEUE_NO_FRAME ? NULL : frames_above(directory);
    bool ok = copy_to(p, user, from, to, above, temporary, e) || error_prefix(e, "output.directory");
    free(to);
    free(above);
    return ok;
}

/* ---- checks of directories */

/* Drops one reference to the check and frees it with the last one. */
static void leave(look *l)
{
    pthread_mutex_lock(&l->mutex);
    bool last = --l->users == 0;
    pthread_mutex_unlock(&l->mutex);
    if (!last) return;
    pthread_cond_destroy(&l->ended);
    pthread_mutex_destroy(&l->mutex);
    release_counts(l->looks);
    free(l->name);
    free(l->root);
    free(l->path);
    free(l);
}

static void *run(void *argument)
{
    look *l = argument;
    error e = {0};
    bool whole = false;
    int directory = l->path ? store_output_open_nearest(&l->outputs, l->path, &whole, &e)
                            : store_output_open_root(l->root, &e);
    char *name = directory >= 0 && whole ? name_with_report(directory, l->path) : NULL;
    if (directory >= 0) {
        if (l->path)
            store_output_try(&l->outputs, directory, l->path, &e);
        else
            store_output_try_root(l->of_user, directory, l->root, &e);
        close(directory);
    }
    pthread_mutex_lock(&l->mutex);
    l->done = true;
    l->name = name;
    l->fault = e;
    pthread_cond_signal(&l->ended);
    pthread_mutex_unlock(&l->mutex);
    atomic_fetch_sub(&l->looks->of_root[l->root_index], 1);
    leave(l);
    return NULL;
}

/* Checks a directory below root `index`, or the root itself (path NULL). *name: as in `look`, to be freed;
 * unchanged if no check could be started. */
static bool look_at(output_place *p, size_t index, const char *path, char **name, error *e)
{
    const char *root = p->outputs->roots[index];
    pthread_t thread;
    look *l = mem_alloc(sizeof *l);
    atomic_fetch_add(&p->looks->holders, 1);
    *l = (look){.looks = p->looks,
                .root_index = index,
                .users = 2,
                .root = mem_strdup(root),
                .path = path ? mem_strdup(path) : NULL,
                .of_user = p->outputs->of_user && p->outputs->of_user[index]};
    l->outputs = *p->outputs;
    l->outputs.roots = (const char *const *)&l->root;
    l->outputs.root_count = 1;
    l->outputs.of_user = &l->of_user;
    pthread_mutex_init(&l->mutex, NULL);
    background_init_condition(&l->ended);
    atomic_int *count = &p->looks->of_root[index];
    bool busy = atomic_fetch_add(count, 1) >= LOOKS_MOST;
    if (busy || !background_start(&thread, run, l, "the check of an output directory", NULL)) {
        atomic_fetch_sub(count, 1);
        l->users = 1;
        leave(l);
        return !busy ||
               error_set(
                   e, ERROR_OUTPUT_UNWRITABLE,
                   "%s: %d checks of output directories are waiting for their file systems: try again later",
                   path ? path : root, LOOKS_MOST);
    }
    pthread_detach(thread);
    int64_t until_ms = clock_monotonic_ms() + LOOK_MS;
    pthread_mutex_lock(&l->mutex);
    while (!l->done && background_wait_until(&l->ended, &l->mutex, until_ms)) continue;
    bool done = l->done;
    error fault = l->fault;
    *name = l->name;
    l->name = NULL;
    pthread_mutex_unlock(&l->mutex);
    leave(l);
    if (!done)
        return error_set(e, ERROR_OUTPUT_UNWRITABLE,
                         "%s: the file system has not answered for %d s: check its mount", path ? path : root,
                         LOOK_MS / 1000);
    if (fault.code != ERROR_PATH_FORBIDDEN && fault.code != ERROR_OUTPUT_UNWRITABLE) return true;
    if (e) *e = fault;
    return false;
}

void output_place_note_change(output_place *p, bool changed)
{
    atomic_store(&p->changed, changed);
}

bool output_place_check(output_place *p, const char *user, const char *directory, error *e)
{
    char *name = NULL;
    error outside = {0};
    if (!store_output_check_user(p->outputs, user, directory, &outside))
        return error_set(e, outside.code, "%s%s", outside.message,
                         atomic_load(&p->changed)
                             ? "; or restart hexad, which applies the changed setting output_roots"
                             : "");
    size_t root = store_output_root_of(p->outputs, directory);
    bool writable = look_at(p, root, directory, &name, e);
    if (writable && atomic_load(&p->unwritable) == p->outputs->roots[root])
        output_place_check_roots(p); /* the root that was unwritable can be written again */
    bool ok = writable && check_owner(p, user, name, directory, e);
    free(name);
    return ok;
}

void output_place_check_roots(output_place *p)
{
    const char *first = NULL;
    for (size_t i = 0; i < p->outputs->root_count; i++) {
        error e = {0};
        char *name = NULL;
        bool ok = look_at(p, i, NULL, &name, &e);
        free(name);
        if (ok) continue;
        log_write(LOG_LEVEL_WARNING, "cannot copy results below this output root: %s", e.message);
        if (!first) first = p->outputs->roots[i];
    }
    atomic_store(&p->unwritable, first);
}

const char *output_place_unwritable(const output_place *p)
{
    return atomic_load(&p->unwritable);
}
