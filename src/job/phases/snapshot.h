// SPDX-License-Identifier: Apache-2.0
/* snapshot: some points of a running job, in a file that the daemon shows to the owner of the job.
 *
 * The file WORKER_SNAPSHOT_NAME is binary PLY (doc/worker.md lists its properties). It is renamed to its name
 * when complete, is not flushed to disk, and is removed before the report is written. The state of the job is
 * only read: snapshots do not change the result. If the file cannot be written, it is skipped. Not
 * thread-safe, except for snapshot_end.
 */
#ifndef HEXAD_JOB_PHASES_SNAPSHOT_H
#define HEXAD_JOB_PHASES_SNAPSHOT_H

#include <stdint.h>

#include "base/core/worker_contract.h"
#include "sampling/solver/solver.h"
#include "job/source/source.h"

/* Temporary name of the file. */
#define SNAPSHOT_PART_NAME WORKER_SNAPSHOT_NAME ".part"

typedef struct snapshot {
    char *path, *temporary; /* NULL: no snapshots are written */
    int64_t due_ms;         /* monotonic time of the next snapshot */
} snapshot;

/* `directory` NULL: no snapshots. Otherwise the caller calls snapshot_end. */
void snapshot_begin(snapshot *w, const char *directory);

/* Writes the current particles of `s`, in world space, if 2 s have passed since snapshot_begin and since the
 * last snapshot. If there are more than 100 000 particles, it writes an even subset. */
void snapshot_offer(snapshot *w, const solver *s, const source *from, const spec *asked);

/* Removes the file. May be called by another thread just before the process ends. */
void snapshot_end(const snapshot *w);
void snapshot_free(snapshot *w);

#endif
