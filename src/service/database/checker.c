#include "service/database/checker.h"

#include <pthread.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/background.h"
#include "base/core/clock.h"
#include "base/core/log.h"
#include "base/core/memory.h"
#include "service/database/backup.h"
#include "service/database/database.h"
#include "service/database/health.h"

/* Time until a failed check is repeated. The shorter time applies while changes are refused. */
#define RETRY_MS 60000
#define RETRY_IN_DOUBT_MS 5000
/* The database is idle if no change was stored for this time, or for a tenth of the interval if that is shorter. */
#define IDLE_MS 10000

struct checker {
    database *d;
    int64_t interval_ms; /* 0: never */
    int64_t free_bytes;
    bool logged; /* a failed check has been logged */
    pthread_t thread;
};

/* Checks the database once. False when no check could be made. */
static bool check(checker *c, bool full)
{
    const char *name = full ? "integrity_check" : "quick_check";
    health *h = database_health(c->d);
    char *findings = NULL;
    error e = {0};
    health_begin_check(h);
    bool ok = backup_make_checked(c->d, c->free_bytes, full, &findings, &e);
    if (!ok && e.code == ERROR_DATABASE_DAMAGED) {
        findings = mem_strdup("it was not copied"); /* health_report has the details */
        ok = true;
    }
    if (ok) findings[strcspn(findings, "\n")] = '\0'; /* the first finding is enough */
    health_end_check(h, name, ok, ok && *findings ? findings : NULL);
    if (!ok && !c->logged && e.code != ERROR_CANCELLED)
        log_write(LOG_LEVEL_WARNING, "cannot check the database and tries again: %s", e.message);
    c->logged = !ok;
    if (ok)
        log_write(LOG_LEVEL_INFO, "database checked check=%s result=%s", name, *findings ? "damaged" : "ok");
    free(findings);
    return ok;
}

static int64_t later(int64_t ms, int64_t by_ms)
{
    return ms < INT64_MAX - by_ms ? ms + by_ms : INT64_MAX;
}

/* Waits until a full check is due and the database is idle. False: the thread must end. */
static bool wait_for_turn(checker *c, int64_t due_ms)
{
    health *h = database_health(c->d);
    bool doubt = false;
    if (!health_wait(h, due_ms, &doubt)) return false;
    int64_t idle_ms = c->interval_ms / 10 < IDLE_MS ? c->interval_ms / 10 : IDLE_MS,
            last_ms = later(due_ms, c->interval_ms);
    uint64_t seen = database_change_count(c->d);
    while (!doubt && clock_monotonic_ms() < last_ms) {
        if (!health_wait(h, clock_monotonic_ms() + idle_ms, &doubt)) return false;
        uint64_t now = database_change_count(c->d);
        if (now == seen) break;
        seen = now;
    }
    return true;
}

static int64_t next_ms(checker *c, bool ok)
{
    health_report known;
    health_get(database_health(c->d), &known);
    if (ok && !c->interval_ms) return INT64_MAX;
    return later(clock_monotonic_ms(), ok ? c->interval_ms : known.damaged ? RETRY_IN_DOUBT_MS : RETRY_MS);
}

static void *run(void *argument)
{
    checker *c = argument;
    pthread_setname_np(pthread_self(), "checker");
    bool full = false;
    int64_t due_ms;
    do {
        bool ok = check(c, full);
        full |= ok;
        due_ms = next_ms(c, ok);
    } while (wait_for_turn(c, due_ms));
    return NULL;
}

checker *checker_start(database *d, double interval_s, int64_t free_bytes, error *e)
{
    checker *c = mem_alloc(sizeof *c);
    *c = (checker){.d = d, .interval_ms = (int64_t)(interval_s * 1000), .free_bytes = free_bytes};
    if (background_start(&c->thread, run, c, "checks of the database", e)) return c;
    free(c);
    return NULL;
}

void checker_stop(checker *c)
{
    if (!c) return;
    health_stop(database_health(c->d));
    pthread_join(c->thread, NULL);
    free(c);
}
