/* node: runs attempts on a node of the farm, one after the other, as the service has written them down
 * (slurm/attempt_files).
 *
 * Each attempt is run by the local engine, with its limits and its isolation, if its claim can be had. SIGTERM and
 * SIGINT end the worker and leave the rest to the service. A worker that is cancelled is killed after NODE_GRACE_S.
 */
#ifndef HEXAD_SLURM_NODE_H
#define HEXAD_SLURM_NODE_H

#include <stdbool.h>
#include <stddef.h>

#include "base/error.h"

#define NODE_GRACE_S 10

/* Runs the attempts work_dir/farm/NAME. False and an error when this node cannot do it: the storage is not there or
 * cannot be written. That a worker fails is no error. */
bool node_run(const char *farm, char *const *names, size_t count, error *e);

#endif
