// SPDX-License-Identifier: Apache-2.0
/* config: the daemon's settings.
 *
 * One list (settings.h) has each setting: key, type, rank, default, range, unit and help. The members of
 * config, the configuration file (INI, parsed by libinih), the command line, --help and the sample file
 * etc/hexad.conf are derived from it. Each key is a key of the file and an option, `--key VALUE` or `--key=VALUE`; `-` and
 * `_` are equivalent. Options take precedence over the file. One thread reads the settings at the start.
 * Afterwards only config_take_over changes them, and only settings with `reloads` in their row: numbers, the
 * log level, and lists that other modules copy.
 * Texts do not reload, because other modules keep pointers to them.
 */
#ifndef HEXAD_SERVICE_CONFIG_CONFIG_H
#define HEXAD_SERVICE_CONFIG_CONFIG_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

#include "base/core/error.h"
#include "base/core/log.h"
#include "base/core/sandbox.h"

/* The settings file of the installed service. */
#define CONFIG_FILE HEXAD_SYSCONFDIR "/hexad.conf"

typedef struct config_list {
    char **item;
    size_t count;
} config_list;

/* The types of settings in settings.h. */
typedef char *config_TEXT;
typedef config_list config_LIST, config_WORDS;
typedef int64_t config_INTEGER;
typedef double config_REAL;
typedef sandbox_mode config_SANDBOX;
typedef log_level config_LEVEL;

typedef struct config {
#define SETTING(key, type, ...) config_##type key;
#include "service/config/settings.h"
#undef SETTING
    /* Not settings. */
    bool strict;   /* --strict, of --check-settings */
    bool contents; /* --contents, of --check */
    bool help_all; /* --help all */
    /* NULL if the command line does not have them. */
    char *file;   /* the last --config */
    char *backup; /* with CONFIG_BACKUP: the file to write */
    char *
        admit; /* with CONFIG_ALLOW and CONFIG_DENY: a user or @GROUP, with CONFIG_OPEN_PORT: a user; not empty */
    char **place; /* for each row of the table: FILE:LINE of the value; NULL: a default or an option */
} config;

typedef enum config_action {
    CONFIG_RUN,
    CONFIG_ADOPT,
    CONFIG_HELP,
    CONFIG_VERSION,
    CONFIG_SAMPLE,
    CONFIG_BACKUP,
    CONFIG_CHECK,
    CONFIG_CHECK_SETTINGS,
    CONFIG_ALLOW,
    CONFIG_DENY,
    CONFIG_OPEN_PORT
} config_action;

/* Reads the defaults, then the file of `--config FILE`, then the options. The caller frees the members with
 * config_clear. Error: spec_invalid, with the file and line or the option. */
bool config_parse(int argc, char *const *argv, config *c, config_action *action, error *e);
/* Takes the values of settings that reload from `fresh`, which receives the former ones. Logs the changed
 * settings and those that need a restart. */
void config_take_over(config *c, config *fresh);
/* The first Unix socket of `listen`: unix:/path, or unix: for the default one. NULL: there are TCP ports
 * only. */
const char *config_unix_address(const config *c);
bool config_lists_differ(const config_list *a, const config_list *b);
/* If the message begins with the name of a setting whose value is from a file, prepends FILE:LINE. */
void config_locate_error(const config *c, error *e);
void config_clear(config *c); /* accepts a zeroed object */

/* Whether the settings admit users other than the service's own to the Unix socket. */
bool config_shares_socket(const config *c);

/* Sets c->worker if it is empty: hexad-worker in the directory of the running program, otherwise in the
 * bindir of the build. Error: input_missing (it is not an executable file). */
bool config_find_worker(config *c, error *e);
/* config_find_worker for c->slurm_node and hexad-node. */
bool config_find_node(config *c, error *e);

/* `all`: not only the basic options and settings. */
void config_print_help(FILE *file, bool all);
void config_print_sample(FILE *file); /* contents of etc/hexad.conf */

#endif
