// SPDX-License-Identifier: Apache-2.0
#include "base/core/threads.h"

#include <pthread.h>
#include <sched.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"
#include "base/core/numeric_state.h"

/* The chunks that a worker takes first. On a cache line of its own. */
typedef struct share {
    _Alignas(64) atomic_size_t next;
    size_t end;
} share;

/* State of the current loop in one word: its number, a bit OPEN (chunks are left, so that workers may enter),
 * and the number of workers inside. Workers that spin use only this word. The lock is for workers that
 * sleep. */
enum { INSIDE = 1, OPEN = 512, NUMBER = 2 * OPEN };
_Static_assert(THREADS_MAX < OPEN, "workers inside fit below the bit OPEN");

struct threads {
    int count;
    bool narrow;
    const volatile sig_atomic_t *stop_flag;
    pthread_t *thread;
    pthread_mutex_t lock;
    pthread_cond_t start, finished;
    bool stop;
    _Alignas(64) atomic_uint loop;    /* on a cache line of its own: spinning workers read it */
    _Alignas(64) atomic_int sleepers; /* workers that wait for `start` */
    atomic_bool waits;                /* worker 0 waits for `finished` */
    threads_work work;
    void *context;
    size_t end, grain;
    share *shares; /* one per worker */
};

typedef struct seat {
    threads *pool;
    int worker;
} seat;

/* Runs the remaining chunks of a share. */
static void take_share(threads *t, share *s, int worker)
{
    if (atomic_load_explicit(&s->next, memory_order_relaxed) >= s->end)
        return; /* empty: avoids a write to its cache line */
    while (!threads_stopped(t)) {
        size_t chunk = atomic_fetch_add_explicit(&s->next, 1, memory_order_relaxed);
        if (chunk >= s->end) return;
        size_t begin = chunk * t->grain;
        t->work(t->context, worker, begin, t->end - begin < t->grain ? t->end : begin + t->grain);
    }
}

/* Runs the chunks of the worker's own share, then the remaining chunks of other shares. */
static void take_chunks(threads *t, int worker)
{
    for (int k = 0; k < t->count; k++) take_share(t, &t->shares[(worker + k) % t->count], worker);
}

/* Number of polls, about 40 microseconds, before a waiting worker sleeps: loops follow each other closely,
 * and waking takes longer. */
static const int POLLS = 2000;

static void pause_briefly(void)
{
#ifdef __x86_64__
    __builtin_ia32_pause();
#endif
}

/* Whether a loop is open whose number is not `seen`. */
static bool is_new(unsigned loop, unsigned seen)
{
    return (loop & OPEN) && loop / NUMBER != seen;
}

/* Enters a loop for which is_new is true, and sets *seen to its number. */
static bool enter(threads *t, unsigned *seen)
{
    unsigned loop = atomic_load(&t->loop);
    while (is_new(loop, *seen))
        if (atomic_compare_exchange_weak(&t->loop, &loop, loop + INSIDE)) {
            *seen = loop / NUMBER;
            return true;
        }
    return false;
}

/* Wakes workers that sleep. A worker holds the lock from announcing its sleep until it waits, so that locking
 * once guarantees that it can be woken. Signals follow the unlocking: otherwise the woken worker would
 * wait for the lock. */
static void wake(threads *t, pthread_cond_t *sleepers, size_t count)
{
    pthread_mutex_lock(&t->lock);
    pthread_mutex_unlock(&t->lock);
    for (size_t k = 0; k < count; k++) pthread_cond_signal(sleepers);
}

static void leave(threads *t)
{
    unsigned loop = atomic_fetch_sub(&t->loop, INSIDE) - INSIDE;
    if (loop % NUMBER == 0 && atomic_load(&t->waits)) wake(t, &t->finished, 1);
}

/* Sleeps until is_new. False: the pool ends. */
static bool sleep_until_new(threads *t, unsigned seen)
{
    pthread_mutex_lock(&t->lock);
    atomic_fetch_add(&t->sleepers, 1);
    while (!is_new(atomic_load(&t->loop), seen) && !t->stop) pthread_cond_wait(&t->start, &t->lock);
    atomic_fetch_sub(&t->sleepers, 1);
    const bool goes_on = !t->stop;
    pthread_mutex_unlock(&t->lock);
    return goes_on;
}

static void *worker_main(void *argument)
{
    seat s = *(seat *)argument;
    free(argument);
    threads *t = s.pool;
    unsigned seen = 0;
    for (;;) {
        for (int k = 0; k < POLLS && !is_new(atomic_load_explicit(&t->loop, memory_order_relaxed), seen); k++)
            pause_briefly();
        if (enter(t, &seen)) {
            take_chunks(t, s.worker);
            leave(t);
        } else if (!sleep_until_new(t, seen)) {
            return NULL;
        }
    }
}

threads *threads_new(int count, const volatile sig_atomic_t *stop, error *e)
{
    threads *t = mem_array(1, sizeof *t, "threads", e);
    if (!t) return NULL;
    t->count = 1;
    t->stop_flag = stop;
    t->thread = mem_alloc((size_t)count * sizeof *t->thread);
    t->shares = mem_array((size_t)count, sizeof *t->shares, "threads", e);
    pthread_mutex_init(&t->lock, NULL);
    pthread_cond_init(&t->start, NULL);
    pthread_cond_init(&t->finished, NULL);
    if (!t->shares) {
        threads_free(t);
        return NULL;
    }
    for (int k = 1; k < count; k++) {
        seat *s = mem_alloc(sizeof *s);
        *s = (seat){t, k};
        int fault = numeric_state_start_thread(&t->thread[k], NULL, worker_main, s);
        if (fault) {
            free(s);
            error_set(e, ERROR_INTERNAL, "cannot start thread %d of %d: %s", k + 1, count, strerror(fault));
            threads_free(t);
            return NULL;
        }
        t->count = k + 1;
    }
    return t;
}

void threads_free(threads *t)
{
    if (!t) return;
    pthread_mutex_lock(&t->lock);
    t->stop = true;
    pthread_cond_broadcast(&t->start);
    pthread_mutex_unlock(&t->lock);
    for (int k = 1; k < t->count; k++) pthread_join(t->thread[k], NULL);
    pthread_cond_destroy(&t->start);
    pthread_cond_destroy(&t->finished);
    pthread_mutex_destroy(&t->lock);
    free(t->shares);
    free(t->thread);
    free(t);
}

int threads_count(const threads *t)
{
    return t ? t->count : 1;
}

bool threads_narrow(threads *t, bool narrow)
{
    if (!t) return true;
    const bool before = t->narrow;
    t->narrow = narrow;
    return before;
}

threads *threads_beside(const threads *t)
{
    return t ? threads_new(1, t->stop_flag, NULL) : NULL;
}

bool threads_stopped(const threads *t)
{
    return t && t->stop_flag && __atomic_load_n(t->stop_flag, __ATOMIC_RELAXED);
}

bool threads_may_go_on(const threads *t, error *e)
{
    return !threads_stopped(t) || error_set(e, ERROR_CANCELLED, "stopped");
}

void threads_run(threads *t, size_t count, size_t grain, threads_work work, void *context)
{
    if (!t || t->count == 1 || t->narrow || count <= grain) {
        for (size_t begin = 0; begin < count && !threads_stopped(t); begin += grain)
            work(context, 0, begin, count - begin < grain ? count : begin + grain);
        return;
    }
    const size_t others = (count - 1) / grain; /* chunks other than the first */
    t->work = work;
    t->context = context;
    t->end = count;
    t->grain = grain;
    for (int k = 0; k < t->count; k++) {
        t->shares[k].end = (others + 1) * (size_t)(k + 1) / (size_t)t->count;
        atomic_store_explicit(&t->shares[k].next, (others + 1) * (size_t)k / (size_t)t->count,
                              memory_order_relaxed);
    }
    atomic_fetch_add(&t->loop, NUMBER | OPEN);
    const size_t sleepers = (size_t)atomic_load(&t->sleepers);
    if (sleepers > 0) wake(t, &t->start, others < sleepers ? others : sleepers);
    take_chunks(t, 0);
    /* Closes the loop: workers that have not entered have nothing to do. */
    atomic_fetch_sub(&t->loop, OPEN);
    for (int k = 0; k < POLLS; k++) {
        if (atomic_load(&t->loop) % OPEN == 0) return;
        pause_briefly();
    }
    pthread_mutex_lock(&t->lock);
    atomic_store(&t->waits, true);
    while (atomic_load(&t->loop) % OPEN > 0) pthread_cond_wait(&t->finished, &t->lock);
    atomic_store(&t->waits, false);
    pthread_mutex_unlock(&t->lock);
}

/* A loop that also runs a single call: its first chunk. */
typedef struct beside_job {
    void (*other)(void *);
    void *others_context;
    size_t grain;
    threads_work work;
    void *context;
} beside_job;

static void run_beside(void *context, int worker, size_t begin, size_t end)
{
    const beside_job *job = context;
    if (begin == 0)
        job->other(job->others_context);
    else
        job->work(job->context, worker, begin - job->grain, end - job->grain);
}

void threads_run_beside(threads *t, void (*other)(void *), void *others_context, size_t count, size_t grain,
                        threads_work work, void *context)
{
    beside_job job = {other, others_context, grain, work, context};
    threads_run(t, count + grain, grain, run_beside, &job);
}

/* Bytes per chunk: a huge page. */
static const size_t PIECE = 2 << 20;

typedef struct copy_job {
    char *to;
    const char *from;
} copy_job;

static void copy_piece(void *context, int worker, size_t begin, size_t end)
{
    const copy_job *job = context;
    (void)worker;
    memcpy(job->to + begin, job->from + begin, end - begin);
}

void threads_copy(threads *t, void *to, const void *from, size_t bytes)
{
    copy_job job = {to, from};
    threads_run(t, bytes, PIECE, copy_piece, &job);
}

int threads_available(void)
{
    cpu_set_t set;
    if (sched_getaffinity(0, sizeof set, &set) != 0) return 1;
    int n = CPU_COUNT(&set);
    return n > 0 ? n : 1;
}
