// SPDX-License-Identifier: Apache-2.0
/* node: runs attempts on a node of the farm, one after another, from the files of the service
 * (service/slurm/attempt_files).
 *
 * A Slurm job has a list of attempts, and each of its tasks runs a part of the list. For a limited time it
 * then runs attempts of other tasks that have not begun, and attempts of later jobs that need the same
 * resources: starting a task takes Slurm as long as several small attempts. An attempt is run only if its
 * claim can be created. The local engine runs it with its limits and its isolation. SIGTERM and SIGINT end
 * the worker and leave the remaining attempts to the service. A cancelled worker is killed after
 * NODE_GRACE_S.
 */
#ifndef HEXAD_SERVICE_SLURM_NODE_H
#define HEXAD_SERVICE_SLURM_NODE_H

#include <stdbool.h>
#include <stddef.h>

#include "base/core/error.h"
#include "service/slurm/attempt_files.h"

#define NODE_GRACE_S 10

typedef struct node_task {
    attempt_files_batch self;
    size_t first, own;         /* first index and length of the task's part of the list */
    double more_s;             /* time since its start in which the task takes attempts of other tasks */
    attempt_files_names names; /* all attempts of the job */
    const char *list;          /* name of the list of attempts that need the same resources */
} node_task;

/* Runs the attempts of the task. False and an error if this node cannot run attempts, because the storage is
 * missing or cannot be written. A failed worker is not an error. */
bool node_run(const char *farm, const node_task *task, error *e);

#endif
