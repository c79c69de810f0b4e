// SPDX-License-Identifier: Apache-2.0
/* slurm: the engine that runs attempts as jobs of Slurm.
 *
 * The engine uses the commands of Slurm, sbatch, squeue and scancel, in one of its tasks and with a time
 * limit. An attempt is identified by the name of its Slurm job, never by a number. The name consists of the
 * instance, the first attempt of the batch and a serial number; no name is submitted twice. Attempts that
 * wait at the same time and need the same resources are submitted together, as an array. Small attempts share
 * the tasks of the array: each task runs its part, and then attempts of other tasks that have not begun
 * (service/slurm/node). A second task examines the files that the nodes write (service/slurm/attempt_files).
 * The state of Slurm ends an attempt only if the node has left no ending, or an ending without a reason for
 * the stop. While Slurm does not answer, only files decide.
 */
#ifndef HEXAD_SERVICE_SLURM_SLURM_H
#define HEXAD_SERVICE_SLURM_SLURM_H

#include <stddef.h>
#include <stdint.h>

#include "base/core/error.h"
#include "base/core/runner.h"
#include "service/executor/engine.h"

typedef struct slurm_settings {
    const char *work_dir;       /* absolute; shared by all nodes */
    const char *node;           /* path of hexad-node on all nodes */
    const char *const *options; /* further options of sbatch */
    size_t option_count;
    const char *const *accounts; /* "user=account"; "*" stands for all other users */
    size_t account_count;
    double interval_s; /* interval between calls of squeue */
    double command_s;  /* time limit of a command */
    /* time for which a job must be missing from Slurm, or an ending be unreadable, before the attempt is
     * abandoned */
    double lost_s;
    int64_t small_count; /* maximum points of a small job, which shares a Slurm job with others */
    int together;        /* maximum number of small jobs in a Slurm job */
    double more_s; /* time in which a task runs small attempts of other Slurm jobs that have not begun */
} slurm_settings;

typedef struct slurm slurm;

/* Opens the engine and adds its tasks to the runner. All objects in the settings must outlive it. Errors:
 * internal, spec_invalid (an account). */
slurm *slurm_open(const slurm_settings *settings, runner *to, error *e);
void slurm_close(slurm *s); /* after all attempts were settled or left, and runner_stop; accepts NULL */

extern const engine engine_slurm; /* its `place` is a slurm */

#endif
