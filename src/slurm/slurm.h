/* slurm: the engine that runs attempts as jobs of Slurm.
 *
 * Slurm is spoken to by its commands, sbatch, squeue and scancel, in a thread of the engine and with a time limit. An
 * attempt is known by the name of its job, never by a number: the name holds the instance, the first attempt of the
 * batch and a serial number, and no name is submitted twice. Attempts that wait at the same time and need the same are
 * submitted together, as an array. Small ones share the tasks of the array: each task runs its part, and then what others
 * have not begun (slurm/node). A second thread looks at the files that the
 * nodes write (slurm/attempt_files). The state of Slurm ends an attempt only if the node has left no ending, or has no
 * reason for its stop. While Slurm does not answer, only files decide.
 */
#ifndef HEXAD_SLURM_SLURM_H
#define HEXAD_SLURM_SLURM_H

#include <stddef.h>
#include <stdint.h>

#include "base/error.h"
#include "executor/engine.h"

typedef struct slurm_settings {
    const char *work_dir;       /* absolute; shared by all nodes */
    const char *node;           /* path of hexad-node on all nodes */
    const char *const *options; /* further options of sbatch */
    size_t option_count;
    const char *const *accounts; /* "user=account"; "*" is any other user */
    size_t account_count;
    double interval_s; /* of squeue */
    double command_s;  /* the time limit of a command */
    double
        lost_s; /* seconds for which a job must be missing from Slurm, or an ending be unreadable, before the attempt is abandoned */
    int64_t small_count; /* maximum points of a small job, which shares a Slurm job with others */
    int together;        /* maximum number of small jobs in a Slurm job */
    double more_s; /* seconds for which it then runs small attempts of other Slurm jobs that have not begun */
} slurm_settings;

typedef struct slurm slurm;

/* Everything that the settings point to must outlive it. Errors: internal, spec_invalid (an account). */
slurm *slurm_open(const slurm_settings *settings, error *e);
void slurm_close(slurm *s); /* after the last attempt is settled or left; accepts NULL */

extern const engine engine_slurm; /* its place is a slurm */

#endif
