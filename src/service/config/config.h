// SPDX-License-Identifier: Apache-2.0
/* config: the daemon's settings.
 *
 * One table (config_table.c) has a row for each setting: key, type, default, range, unit and help. The
 * configuration file (INI, parsed by libinih), the command line, --help and the sample file etc/hexad.conf
 * are derived from it. Each key is a key of the file and an option, `--key VALUE` or `--key=VALUE`; `-` and
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

typedef struct config {
    config_list
        listen; /* each HOST:PORT, unix:/path or unix: (a socket in the runtime or state directory); none:
                 * unix: */
    char *port_file; /* "": none */
    char *state_dir; /* never "" after config_parse */
    char *work_dir;  /* "": state_dir */
    char *engine;    /* local or slurm */
    int64_t slurm_job_limit, slurm_batch_points, slurm_batch_attempts;
    config_list slurm_options, slurm_allow, slurm_accounts;
    char *slurm_node; /* "": in the directory of the worker */
    double slurm_batch_s, slurm_interval_s, slurm_timeout_s, slurm_lost_s;
    char *worker; /* "": config_find_worker sets it */
    config_list unix_users, unix_groups, unix_admins;
    char *token_file; /* "": in the state directory */
    char *tcp_without_tokens;
    config_list page_origins, trusted_proxies;
    int64_t page; /* 0: no */
    double session_s;
    config_list input_roots, output_roots, path_mappings;
    char *output_mode;                        /* octal digits */
    char *output_group;                       /* "": unchanged */
    bool strict;                              /* --strict, of --check-settings */
    bool contents;                            /* --contents, of --check */
    int64_t workers, threads, host_memory_mb; /* 0: from the resources of the host */
    int64_t memory_mb, max_attempts, max_interruptions, max_files;
    int64_t cache;   /* 0: no */
    int64_t file_mb; /* 0: no limit */
    sandbox_mode sandbox;
    int64_t user_queued, user_tasks, user_running, user_submissions; /* 0: any number */
    config_list user_weights, user_priorities;
    double retry_s, retry_most_s;
    int64_t storage_retries;
    int64_t free_space_mb, reserve_mb;                          /* 0: none */
    double check_interval_s;                                    /* 0: never */
    double retention_s;                                         /* 0: for ever */
    int64_t results_mb;                                         /* 0: from the size of the disk */
    int64_t results_count, user_results_mb, user_results_count; /* 0: any number */
    int64_t delete_undelivered;                                 /* 0: no */
    double timeout_s, stall_s;                                  /* 0: none */
    int64_t estimates;                                          /* 0: none */
    double estimate_timeout_s, thumbnail_timeout_s;
    double grace_s, drain_s;
    int64_t body_total_bytes, user_body_bytes; /* 0: 16 and 4 times body_limit_bytes */
    int64_t answer_total_bytes, user_answer_bytes;
    int64_t body_limit_bytes, header_limit_bytes, connection_limit, client_connection_limit;
    int64_t user_connection_limit, admin_connections;
    int64_t upload_limit_bytes, upload_total_bytes;
    int64_t user_upload_bytes, user_uploads; /* 0: a quarter of the total; any number */
    int64_t share_inputs;                    /* 0 or 1 */
    int64_t share_outputs;                   /* 0 or 1 */
    double inputs_keep_s;                    /* 0: for ever */
    double connection_timeout_s, wait_limit_s, thread_wait_s;
    int64_t kept_documents;
    config_list webhook_hosts;
    char *webhook_secret_file;
    int64_t webhook_calls, webhook_tries;
    double webhook_timeout_s, webhook_retry_s, webhook_retry_most_s, webhook_retry_after_s;
    log_level log_level;
    /* Not settings; NULL if the command line does not have them. */
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

void config_print_help(FILE *file);
void config_print_sample(FILE *file); /* contents of etc/hexad.conf */

#endif
