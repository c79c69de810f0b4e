// SPDX-License-Identifier: Apache-2.0
/* health: whether the database is damaged, and the result of the last check.
 *
 * Any thread. A damaged database is not written to, because a write that follows a wrong page may damage
 * other pages. Changes fail with the code database_damaged; reads still work if possible. This lasts until
 * the next start. A read error counts as damage until a check has read the whole database
 * (service/database/checker).
 */
#ifndef HEXAD_SERVICE_DATABASE_HEALTH_H
#define HEXAD_SERVICE_DATABASE_HEALTH_H

#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>

#include "base/core/error.h"
#include "base/core/runner.h"

/* Instruction in messages about damage. */
#define HEALTH_WAY_OUT                                                                                          \
    "stop hexad, and replace queue.db by the last backup; \"A damaged database\" in doc/operations.md has the " \
    "steps, also without a backup"

typedef struct health_report {
    bool damaged, checking;
    const char *found_by;  /* "statement", "copy", "quick_check" or "integrity_check" */
    char damage[240];      /* description of the damage */
    int64_t checked_ms;    /* end of the last check, wall clock; 0: no check has ended */
    int64_t check_took_ms; /* its duration */
} health_report;

typedef struct health health;

health *health_new(void);
void health_free(health *h); /* accepts NULL */

/* Records damage. `found_by` is "statement", "copy", "quick_check" or "integrity_check". Only the first
 * damage is logged and kept. `doubt`: a read error, which the next check without damage clears. */
void health_note_damage(health *h, const char *found_by, const char *what, bool doubt);

/* False if the database is damaged. The error (database_damaged) describes the damage and the required
 * actions. */
bool health_allows_changes(health *h, error *e);

void health_begin_check(health *h);
/* Records the end of a check. `what` is the damage that was found, or NULL. `done` is false if the check
 * could not be made. */
void health_end_check(health *h, const char *name, bool done, const char *what);

void health_get(health *h, health_report *known);

/* Whether a read error requires a check, which has not begun. */
bool health_requires_check(health *h);
/* Such a read error wakes the task from now on. NULL: none. */
void health_wake_in_doubt(health *h, runner_task *checker);

void health_stop(health *h); /* sets the flag, which aborts checks and copies of the database */
const atomic_bool *health_stop_flag(const health *h);

#endif
