// SPDX-License-Identifier: Apache-2.0
/* command: the commands of hexadctl, one function each. One thread. */
#ifndef HEXAD_CLIENT_COMMAND_H
#define HEXAD_CLIENT_COMMAND_H

#include <stdbool.h>
#include <stddef.h>
#include <stdio.h>
#include <sys/types.h>

#include "base/core/options.h"
#include "client/client.h"
#include "files/file.h"

/* Exit codes of hexadctl. */
enum {
    COMMAND_OK = 0,     /* success; if the command waits for a job: it succeeded and converged */
    COMMAND_FAILED = 1, /* the job failed or timed out; or any other error */
    /* the command line is wrong, the token is unknown or lacks a scope, or the request was refused */
    COMMAND_USAGE = 2,
    COMMAND_UNREACHABLE = 3, /* no server answers */
    /* the job does not exist, its state does not permit the command, or there are no results */
    COMMAND_MISSING = 4,
    COMMAND_CANCELLED = 6,      /* the job was cancelled */
    COMMAND_NOT_CONVERGED = 10, /* the job succeeded but did not converge */
    COMMAND_UNRESOLVED = 11,    /* the job succeeded with the outcome unresolved */
};

/* The options of the command line; NULL: not given. Only options of the command are set. */
typedef struct command_options {
    const char *server;
    bool json, wait, dependents, yes;
    bool accept;  /* of wait, and of others with `wait`: COMMAND_OK for an accepted outcome (queue.accept) */
    bool several; /* the command line has more than one argument */
    bool on_service; /* of sample: the argument is a path of the service */
    bool all;        /* of delete-upload: for all users */
    option_words label;
    option_words set;                              /* of submit and sample: see spec/sample_spec.h */
    option_words depends_on;                       /* of submit: jobs, named as on the command line */
    const char *count, *spacing, *grade, *pattern; /* of sample */
    const char *name;                              /* of list: exact; of others: of the new job */
    const char *owner, *state, *text;
    const char *since, *until; /* of list: a time, or a duration before now such as "90m" or "90m ago" */
    const char *limit;
    const char *priority;
    const char *key;    /* of submit: the Idempotency-Key */
    const char *frames; /* of attach, submit and sample: the frames of the new array, as in queue.frames */
    const char *files;  /* of submit: a pattern, as in queue.files */
    const char *const *mesh; /* of attach: paths as in a spec */
    size_t mesh_count;
    const char *frame;   /* of fetch: numbers as in queue.frames; of log, show and attach: one number */
    const char *attempt; /* of log */
    const char *called;  /* the job as the command line names it */
    const char
        *output;      /* of fetch and sample: a directory; NULL: see command_fetch, or the stem of the file */
    const char *file; /* of token: the daemon's token_file */
    const char *picture; /* of show: the file to write the preview to; NULL: none */
    gid_t file_group;    /* of token: the group that may read the system service's file, or TOKEN_NO_GROUP */
    const char *scopes;  /* of token add; NULL: all but admin */
    const char *max_priority; /* of token add; NULL: any */
} command_options;

/* `argument` is the path of a file or "-", the job's whole id, the token's user or id, or NULL. Returns an
 * exit code. */
typedef int command(client *c, const char *argument, const command_options *options);

command command_attach, command_sample, command_submit, command_validate, command_estimate, command_upload,
    command_uploads, command_delete_upload, command_inspect;
command command_list, command_show, command_attempts, command_wait;
command command_fetch, command_log;
command command_cancel, command_pause, command_resume, command_retry, command_deliver, command_delete,
    command_priority;
command command_watch, command_workers, command_drain, command_undrain;
command command_hold, command_release, command_usage;

/* Commands that change the token file; they need no server. */
command command_token_add, command_token_list, command_token_revoke;

/* ---- functions that commands share */

/* The path below /v1/jobs for the id that a user gave; the caller frees it. NULL, after printing an error, if
 * the text cannot be an id. */
char *command_job_path(const char *id, const char *rest);

/* Sends a request. Returns an exit code, after printing the reason of a refusal. On success *document is the
 * document of the reply, which the caller frees, or NULL. */
int command_ask(client *c, const char *method, const char *path, const char *body, json **document);
/* The same; on a terminal, `text` is shown on standard error until the answer comes. */
int command_ask_showing(client *c, const char *method, const char *path, const char *body, const char *text,
                        json **document);

/* Reads a document without printing anything. NULL: there is none, or no answer. The caller frees it. */
json *command_find(client *c, const char *path);
/* Reads all pages of a list by their member `next`. The path has a query; `member` is the name of the list in each
 * page. Returns an exit code; on success *all is an array of the entries, which the caller frees. */
int command_read_all(client *c, const char *path, const char *member, json **all);

/* Maximum number of entries of a page that is requested. */
#define COMMAND_PAGE_MOST 500

/* The next page of a job's tasks, a document that the caller frees. *after is TASKS_FROM_THE_FIRST before the
 * first page. NULL after the last page, or if *code is not COMMAND_OK. */
#define TASKS_FROM_THE_FIRST (-1.0)
json *command_next_tasks(client *c, const char *id, double *after, int *code);

/* Prints frames of an array that has ended: those whose outcomes are unresolved or not_converged, a line for
 * each outcome; then a line for each frame with another outcome than converged or a rating other than good, at
 * most ten; then a line for each warning with its frames, at most ten. */
int command_print_frame_outcomes(client *c, json_at job, FILE *file);

/* Prints why jobs wait although workers are free: the queue is held, or the service drains. Prints nothing if
 * the service does not answer so. */
void command_explain_waiting(client *c, FILE *file);

/* Prints the users that have all running attempts that the setting user_running permits: other jobs of them
 * wait. `owner`: this user only; NULL: all. */
void command_explain_user_limits(client *c, const char *owner, FILE *file);

/* As command_explain_user_limits, from a document of /v1/workers that the caller has already read. */
void command_print_user_limits(const json *document, const char *owner, FILE *file);

/* Waits for the end of a job, prints it, and returns its exit code. */
int command_wait_for(client *c, const char *path, const command_options *options);

/* Waits until no result of a job remains to be copied to output.directory, and prints the job. Returns
 * COMMAND_FAILED if a copy failed. */
int command_wait_for_copy(client *c, const char *path, const command_options *options);

/* Submits a spec given as text, like command_submit. */
int command_submit_text(client *c, const char *spec, const command_options *options);

/* Posts a spec given as text, without waiting. `final`: its inputs cannot change, so it is not submitted if they are
 * found to have a fault. On success *job is the job, which the caller frees. */
int command_post_text(client *c, const char *spec, bool final, const command_options *options, json **job);

/* Sets *known to whether the service has the file with this hash from this user. Fails only if there is no answer. */
int command_knows_file(client *c, const char *hex, bool *known);

/* Sends a file with this hash that the caller has opened, and its name. `bytes` may be 0 if the service has the file;
 * `always` as for client_upload. On success *document is the answer, which the caller frees. */
int command_send_file(client *c, FILE *file, const char *path, const char *hex, uint64_t bytes, bool always,
                      json **document);

/* Opens and hashes a regular file. Returns COMMAND_OK, or an exit code after a message; *file is then
 * NULL. */
int command_open_file(const char *path, FILE **file, char hex[STORE_HASH_SIZE], uint64_t *bytes);

/* Downloads the results of a job that has ended into a directory, as fetch does, and prints failures only. */
int command_fetch_into(client *c, const char *id, const char *directory);

/* Whether the job is in a final state. */
bool command_has_ended(json_at job);

/* Compares the bytes of a received file of a result with the hash that the service states. The error says what
 * helps. */
bool command_compare(FILE *received, const char *name, const char *sha256, error *e);

#endif
