#include "programs/farm.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "store/file.h"

char *farm_work_directory(const config *c, const char *state_dir, error *e)
{
    const char *given = *c->work_dir ? c->work_dir : state_dir;
    if (!store_directory_create(given, e)) return NULL;
    char *path = realpath(given, NULL);
    if (!path) error_set(e, ERROR_INTERNAL, "work_dir %s: %s", given, strerror(errno));
    return path;
}

bool farm_open(config *c, const char *work_dir, slurm **farm, error *e)
{
    *farm = NULL;
    if (strcmp(c->engine, "local") == 0) return true;
    if (strcmp(c->engine, "slurm") != 0)
        return error_set(e, ERROR_SPEC_INVALID, "engine: must be local or slurm (given %s)", c->engine);
    if (!*c->work_dir)
        return error_set(e, ERROR_SPEC_INVALID,
                         "engine = slurm requires work_dir: set it to a directory that all nodes see at the "
                         "same path");
    if (!config_find_node(c, e)) return false;
    for (size_t i = 0; i < c->slurm_options.count; i++)
        if (strncmp(c->slurm_options.item[i], "--", 2) != 0)
            return error_set(e, ERROR_SPEC_INVALID,
                             "slurm_options: must be --OPTION or --OPTION=VALUE (given %s)",
                             c->slurm_options.item[i]);
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
    *farm = slurm_open(&settings, e);
    return *farm != NULL;
}
