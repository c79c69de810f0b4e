// SPDX-License-Identifier: Apache-2.0
/* checker: the task that checks the database for damage, in a runner of its own.
 *
 * It copies the database and checks the copy, so that the log can be truncated during the check. A quick
 * check runs at the start, and a full check every `interval_s` seconds. A full check waits while the database
 * is busy, but at most for one more interval. After a read error a full check runs at once. health_get
 * returns the findings.
 */
#ifndef HEXAD_SERVICE_DATABASE_CHECKER_H
#define HEXAD_SERVICE_DATABASE_CHECKER_H

#include <stdint.h>

#include "base/core/error.h"

struct database; /* service/database/database.h */
typedef struct checker checker;

/* With interval_s 0 only the first check runs, and checks after read errors. No copy is made if less than
 * `free_bytes` would remain free on the disk. The database must outlive the checker. */
checker *checker_start(struct database *d, double interval_s, int64_t free_bytes, error *e);
/* Interrupts a running check, and copies that clients have requested. Accepts NULL. */
void checker_stop(checker *c);

#endif
