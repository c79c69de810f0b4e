/* snapshot: some points of a running job, in a file that the daemon shows to the owner of the job.
 *
 * The file WORKER_SNAPSHOT_NAME is binary PLY (doc/worker.md lists its properties). It appears by rename, is not flushed to
 * disk, and is removed before the report is written. The job's state is only read, so the points are the same with and
 * without snapshots. If the file cannot be written, it is skipped. Not thread-safe, except for snapshot_end.
 */
#ifndef HEXAD_RUN_SNAPSHOT_H
#define HEXAD_RUN_SNAPSHOT_H

#include <stdint.h>

#include "base/worker_contract.h"
#include "solver/solver.h"
#include "source/source.h"

/* The file while it is written. */
#define SNAPSHOT_PART_NAME WORKER_SNAPSHOT_NAME ".part"

typedef struct snapshot {
    char *path, *temporary; /* NULL: no snapshots are written */
    int64_t due_ms;         /* monotonic time from which on the next one is written */
} snapshot;

/* `directory` NULL: no snapshots. Otherwise snapshot_end follows. */
void snapshot_begin(snapshot *w, const char *directory);

/* Writes the current particles of `s`, in world space, if 2 s have passed since snapshot_begin and since the last snapshot.
 * If there are more than 20 000 particles, it writes every k-th. */
void snapshot_offer(snapshot *w, const solver *s, const source *from, const spec *asked);

/* Removes the file. May be called by another thread just before the process ends. */
void snapshot_end(const snapshot *w);
void snapshot_free(snapshot *w);

#endif
