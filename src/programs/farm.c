// SPDX-License-Identifier: Apache-2.0
#include "programs/farm.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/build_part.h"
#include "base/core/memory.h"
#include "service/executor/local.h"
#include "files/file.h"

#include "config.h"
#if HEXAD_WITH_SLURM
#include "service/slurm/slurm.h"
#endif

char *farm_work_directory(const config *c, const char *state_dir, error *e)
{
    const char *given = *c->work_dir ? c->work_dir : state_dir;
    if (!store_directory_create(given, e)) return NULL;
    char *path = realpath(given, NULL);
    if (!path) error_set(e, ERROR_INTERNAL, "work_dir %s: %s", given, strerror(errno));
    return path;
}

#if HEXAD_WITH_SLURM

static struct slurm *open_slurm(config *c, const char *work_dir, runner *to, error *e)
{
    if (!*c->work_dir) {
        error_set(
            e, ERROR_SPEC_INVALID,
            "engine = slurm requires work_dir: set it to a directory that all nodes see at the same path");
        return NULL;
    }
    if (!config_find_node(c, e)) return NULL;
    for (size_t i = 0; i < c->slurm_options.count; i++) {
        const char *option = c->slurm_options.item[i];
        if (strncmp(option, "--", 2) == 0) continue;
        error_set(e, ERROR_SPEC_INVALID, "slurm_options: must be --OPTION or --OPTION=VALUE (given %s)",
                  option);
        return NULL;
    }
    slurm_settings settings = {
        .work_dir = work_dir,
        .node = c->slurm_node,
        .options = (const char *const *)c->slurm_options.item,
        .option_count = c->slurm_options.count,
        .accounts = (const char *const *)c->slurm_accounts.item,
        .account_count = c->slurm_accounts.count,
        .interval_s = c->slurm_interval_s,
        .command_s = c->slurm_timeout_s,
        .lost_s = c->slurm_lost_s,
        .small_count = c->slurm_batch_points,
        .together = (int)c->slurm_batch_attempts,
        .more_s = c->slurm_batch_s,
    };
    return slurm_open(&settings, to, e);
}

void farm_close(struct slurm *farm)
{
    slurm_close(farm);
}

const engine *farm_engine(const struct slurm *farm)
{
    return farm ? &engine_slurm : &engine_local;
}

#else

static struct slurm *open_slurm(config *c, const char *work_dir, runner *to, error *e)
{
    (void)c;
    (void)work_dir;
    (void)to;
    error_set(e, ERROR_NOT_SUPPORTED, "engine slurm: %s", build_part_missing(BUILD_PART_SLURM));
    return NULL;
}

void farm_close(struct slurm *farm)
{
    (void)farm; /* always NULL in this build */
}

const engine *farm_engine(const struct slurm *farm)
{
    (void)farm;
    return &engine_local;
}

#endif

bool farm_open(config *c, const char *work_dir, runner *to, struct slurm **opened, error *e)
{
    *opened = NULL;
    if (strcmp(c->engine, "local") == 0) return true;
    if (strcmp(c->engine, "slurm") != 0)
        return error_set(e, ERROR_SPEC_INVALID, "engine: must be local or slurm (given %s)", c->engine);
    *opened = open_slurm(c, work_dir, to, e);
    return *opened != NULL;
}
