// SPDX-License-Identifier: Apache-2.0
#include "service/database/checker.h"

#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/clock.h"
#include "base/core/log.h"
#include "base/core/memory.h"
#include "base/core/runner.h"
#include "service/database/backup.h"
#include "service/database/database.h"
#include "service/database/health.h"

/* Time until a failed check is repeated. The shorter time applies while changes are refused. */
#define RETRY_MS 60000
#define RETRY_IN_DOUBT_MS 5000
/* The database is idle if no change was stored for this time, or for a tenth of the interval if that is
 * shorter. */
#define IDLE_MS 10000

struct checker {
    database *d;
    int64_t interval_ms; /* 0: never */
    int64_t free_bytes;
    bool logged;    /* a failed check has been logged */
    bool began;     /* a check has been tried */
    bool full;      /* the quick check has been made */
    int64_t due_ms; /* of the next check, monotonic */
    bool due;       /* this time has passed; the database was then not idle yet */
    uint64_t seen;  /* database_change_count at the last step in this state */
    runner *tasks;  /* this one only */
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

/* Whether a check is due and the database is idle. Otherwise *look_ms is the time of the next look. */
static bool is_turn(checker *c, int64_t *look_ms)
{
    const int64_t now = clock_monotonic_ms(),
                  idle_ms = c->interval_ms / 10 < IDLE_MS ? c->interval_ms / 10 : IDLE_MS;
    if (!c->began || health_requires_check(database_health(c->d))) return true;
    *look_ms = now < c->due_ms ? c->due_ms : now + idle_ms;
    if (now < c->due_ms) return false;
    const uint64_t count = database_change_count(c->d);
    const bool idle = c->due && count == c->seen;
    c->due = true;
    c->seen = count;
    return idle || now >= later(c->due_ms, c->interval_ms);
}

static int64_t next_ms(checker *c, bool ok)
{
    health_report known;
    health_get(database_health(c->d), &known);
    if (ok && !c->interval_ms) return INT64_MAX;
    return later(clock_monotonic_ms(), ok ? c->interval_ms : known.damaged ? RETRY_IN_DOUBT_MS : RETRY_MS);
}

static int64_t check_in_turn(void *context)
{
    checker *c = context;
    int64_t look_ms;
    if (!is_turn(c, &look_ms)) return look_ms;
    bool ok = check(c, c->full);
    c->began = true;
    c->full |= ok;
    c->due = false;
    c->due_ms = next_ms(c, ok);
    return c->due_ms;
}

checker *checker_start(database *d, double interval_s, int64_t free_bytes, error *e)
{
    checker *c = mem_alloc(sizeof *c);
    *c = (checker){
        .d = d, .interval_ms = (int64_t)(interval_s * 1000), .free_bytes = free_bytes, .tasks = runner_new()};
    health_wake_in_doubt(database_health(d), runner_add(c->tasks, "checker", check_in_turn, c));
    if (runner_start(c->tasks, e)) return c;
    checker_stop(c);
    return NULL;
}

void checker_stop(checker *c)
{
    if (!c) return;
    health_stop(database_health(c->d));
    health_wake_in_doubt(database_health(c->d), NULL);
    runner_stop(c->tasks);
    runner_free(c->tasks);
    free(c);
}
