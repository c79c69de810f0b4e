/* farm: what the daemon makes of the settings engine and work_dir. Called at the start. */
#ifndef HEXAD_PROGRAMS_FARM_H
#define HEXAD_PROGRAMS_FARM_H

#include <stdbool.h>

#include "base/error.h"
#include "config/config.h"
#include "executor/engine.h"

struct slurm;

/* The absolute path of work_dir, which is created if missing; to be freed. NULL and an error. */
char *farm_work_directory(const config *c, const char *state_dir, error *e);

/* *opened is NULL with engine = local. The settings must outlive it. Errors: spec_invalid; not_supported in a build without
 * Slurm; those of slurm_open. */
bool farm_open(config *c, const char *work_dir, struct slurm **opened, error *e);
void farm_close(struct slurm *farm); /* accepts NULL */

/* The engine of attempts. Its place is the farm; of NULL it is engine_local. */
const engine *farm_engine(const struct slurm *farm);

#endif
