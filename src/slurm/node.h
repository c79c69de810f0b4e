/* node: runs attempts on a node of the farm, one after the other, as the service has written them down
 * (slurm/attempt_files).
 *
 * A Slurm job has a list of attempts. Each of its tasks runs a part of it. Then it goes on, for a while, with those that
 * other tasks were to run and have not, and with those of later jobs that need the same: to start a task takes Slurm as
 * long as some small attempts. Each attempt is run by the local engine, with its limits and its isolation, if its claim can be had. SIGTERM and
 * SIGINT end the worker and leave the rest to the service. A worker that is cancelled is killed after NODE_GRACE_S.
 */
#ifndef HEXAD_SLURM_NODE_H
#define HEXAD_SLURM_NODE_H

#include <stdbool.h>
#include <stddef.h>

#include "base/error.h"
#include "slurm/attempt_files.h"

#define NODE_GRACE_S 10

typedef struct node_task {
    attempt_files_batch self;
    size_t first, own;         /* the task's part of the list */
    double more_s;             /* how long after its begin it takes others */
    attempt_files_names names; /* of the job */
    const char *list;          /* name of the list of all that need the same */
} node_task;

/* False and an error when this node cannot run attempts: the storage is not there or cannot be written. That a worker
 * fails is not an error. */
bool node_run(const char *farm, const node_task *task, error *e);

#endif
