// SPDX-License-Identifier: Apache-2.0
/* farm: prepares work_dir and the engine from the settings of the daemon. Called at the start. */
#ifndef HEXAD_PROGRAMS_FARM_H
#define HEXAD_PROGRAMS_FARM_H

#include <stdbool.h>

#include "base/core/error.h"
#include "base/core/runner.h"
#include "service/config/config.h"
#include "service/executor/engine.h"

struct slurm;

/* The absolute path of work_dir, which the caller frees. The directory is created if it is missing. NULL and
 * an error on failure. */
char *farm_work_directory(const config *c, const char *state_dir, error *e);

/* Checks the settings of the engine, and finds its program. Errors: spec_invalid; not_supported in a build
 * without Slurm; input_missing: the program cannot be run. */
bool farm_check(config *c, error *e);

/* Opens the engine for Slurm, whose tasks are added to the runner. *opened is NULL with engine = local. The
 * settings must outlive it; farm_check has accepted them. Errors: those of slurm_open. */
bool farm_open(const config *c, const char *work_dir, runner *to, struct slurm **opened, error *e);
void farm_close(struct slurm *farm); /* accepts NULL */

/* The engine of attempts. If `farm` is NULL, it is engine_local; otherwise its place is `farm`. */
const engine *farm_engine(const struct slurm *farm);

#endif
