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
    if (!store_directory_create(given, e)) {
        error_prefix(e, "work_dir");
        return NULL;
    }
    char *path = realpath(given, NULL);
    if (!path) error_set(e, ERROR_INTERNAL, "work_dir %s: %s", given, strerror(errno));
    return path;
}

#if HEXAD_WITH_SLURM

static bool check_slurm(config *c, error *e)
{
    if (!*c->work_dir)
        return error_set(
            e, ERROR_SPEC_INVALID,
            "engine = slurm requires work_dir: set it to a directory that all nodes see at the same path");
    for (size_t i = 0; i < c->slurm_options.count; i++)
        if (strncmp(c->slurm_options.item[i], "--", 2) != 0)
            return error_set(e, ERROR_SPEC_INVALID,
                             "slurm_options: must be --OPTION or --OPTION=VALUE (given %s)",
                             c->slurm_options.item[i]);
    for (size_t i = 0; i < c->slurm_accounts.count; i++) {
        const char *given = c->slurm_accounts.item[i], *equals = strchr(given, '=');
        if (!equals || equals == given || !equals[1])
            return error_set(e, ERROR_SPEC_INVALID, "slurm_accounts: must be user=account (given %s)", given);
    }
    return config_find_node(c, e);
}

bool farm_open(const config *c, const char *work_dir, runner *to, struct slurm **opened, error *e)
{
    *opened = NULL;
    if (strcmp(c->engine, "local") == 0) return true;
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
    *opened = slurm_open(&settings, to, e);
    return *opened != NULL;
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

static bool check_slurm(config *c, error *e)
{
    (void)c;
    return error_set(e, ERROR_NOT_SUPPORTED, "engine slurm: %s", build_part_missing(BUILD_PART_SLURM));
}

bool farm_open(const config *c, const char *work_dir, runner *to, struct slurm **opened, error *e)
{
    (void)c;
    (void)work_dir;
    (void)to;
    (void)e;
    *opened = NULL; /* farm_check permits only the engine local in this build */
    return true;
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

bool farm_check(config *c, error *e)
{
    if (strcmp(c->engine, "slurm") == 0) return check_slurm(c, e);
    return strcmp(c->engine, "local") == 0 ||
           error_set(e, ERROR_SPEC_INVALID, "engine: must be local or slurm (given %s)", c->engine);
}
