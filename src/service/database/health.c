// SPDX-License-Identifier: Apache-2.0
#include "service/database/health.h"

#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/clock.h"
#include "base/core/log.h"
#include "base/core/memory.h"

struct health {
    pthread_mutex_t mutex;
    health_report known;
    bool doubt;           /* it was a read error, which may not be damage */
    bool wanted;          /* a check is required, because of the read error */
    runner_task *checker; /* woken when a check is required; NULL: none */
    int64_t began_ms;
    atomic_bool damaged, stopping;
};

health *health_new(void)
{
    health *h = mem_alloc(sizeof *h);
    pthread_mutex_init(&h->mutex, NULL);
    return h;
}

void health_free(health *h)
{
    if (!h) return;
    pthread_mutex_destroy(&h->mutex);
    free(h);
}

/* Under the mutex. */
static void set_damage(health *h, const char *found_by, const char *what, bool doubt)
{
    health_report *k = &h->known;
    if (k->damaged && (doubt || !h->doubt)) return;
    k->damaged = true;
    k->found_by = found_by;
    snprintf(k->damage, sizeof k->damage, "%s", what);
    for (char *c = k->damage; *c; c++)
        if ((unsigned char)*c < 0x20) *c = ' ';
    h->doubt = h->wanted = doubt;
    atomic_store(&h->damaged, true);
    if (doubt && h->checker) runner_wake(h->checker);
    if (doubt)
        log_write(LOG_LEVEL_ERROR,
                  "cannot read the database; nothing is written until a check has read all of it: %s",
                  k->damage);
    else
        log_write(LOG_LEVEL_ERROR, "the database is damaged; nothing is written to it found_by=%s: %s: %s",
                  found_by, k->damage, HEALTH_WAY_OUT);
}

void health_note_damage(health *h, const char *found_by, const char *what, bool doubt)
{
    pthread_mutex_lock(&h->mutex);
    set_damage(h, found_by, what, doubt);
    pthread_mutex_unlock(&h->mutex);
}

bool health_allows_changes(health *h, error *e)
{
    if (!atomic_load(&h->damaged)) return true;
    pthread_mutex_lock(&h->mutex);
    if (h->doubt)
        error_set(e, ERROR_DATABASE_DAMAGED,
                  "cannot read the database of the queue (%s); nothing is changed until a check has "
                  "read all of it. If this persists, check the disk, then: %s",
                  h->known.damage, HEALTH_WAY_OUT);
    else
        error_set(e, ERROR_DATABASE_DAMAGED,
                  "the database of the queue, queue.db, is damaged (%s) and is not changed any more: %s",
                  h->known.damage, HEALTH_WAY_OUT);
    pthread_mutex_unlock(&h->mutex);
    return false;
}

void health_begin_check(health *h)
{
    pthread_mutex_lock(&h->mutex);
    h->known.checking = true;
    h->wanted = false;
    h->began_ms = clock_monotonic_ms();
    pthread_mutex_unlock(&h->mutex);
}

void health_end_check(health *h, const char *name, bool done, const char *what)
{
    pthread_mutex_lock(&h->mutex);
    health_report *k = &h->known;
    k->checking = false;
    if (done) {
        k->checked_ms = clock_wall_ms();
        k->check_took_ms = clock_monotonic_ms() - h->began_ms;
        if (what) set_damage(h, name, what, false);
        if (!what && k->damaged && h->doubt && !h->wanted) {
            k->damaged = h->doubt = false;
            atomic_store(&h->damaged, false);
            log_write(LOG_LEVEL_INFO, "the database was read without a fault and is written again");
        }
    }
    pthread_mutex_unlock(&h->mutex);
}

void health_get(health *h, health_report *known)
{
    pthread_mutex_lock(&h->mutex);
    *known = h->known;
    pthread_mutex_unlock(&h->mutex);
}

void health_wake_in_doubt(health *h, runner_task *checker)
{
    pthread_mutex_lock(&h->mutex);
    h->checker = checker;
    pthread_mutex_unlock(&h->mutex);
}

bool health_requires_check(health *h)
{
    pthread_mutex_lock(&h->mutex);
    bool required = h->wanted;
    pthread_mutex_unlock(&h->mutex);
    return required;
}

void health_stop(health *h)
{
    atomic_store(&h->stopping, true);
}

const atomic_bool *health_stop_flag(const health *h)
{
    return &h->stopping;
}
