/* farm: what the daemon makes of the settings engine and work_dir. Called at the start. */
#ifndef HEXAD_PROGRAMS_FARM_H
#define HEXAD_PROGRAMS_FARM_H

#include <stdbool.h>

#include "base/error.h"
#include "config/config.h"
#include "slurm/slurm.h"

/* The absolute path of work_dir, which is created if missing; to be freed. NULL and an error. */
char *farm_work_directory(const config *c, const char *state_dir, error *e);

/* *farm is NULL with engine = local. The settings must outlive it. */
bool farm_open(config *c, const char *work_dir, slurm **farm, error *e);

#endif
