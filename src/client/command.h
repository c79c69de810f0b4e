/* command: the commands of hexadctl, one function each. One thread. */
#ifndef HEXAD_CLIENT_COMMAND_H
#define HEXAD_CLIENT_COMMAND_H

#include <stdbool.h>
#include <stddef.h>
#include <stdio.h>
#include <sys/types.h>

#include "client/client.h"

/* Exit codes of hexadctl. */
enum {
    COMMAND_OK = 0,             /* done; after waiting for a job: it succeeded and converged */
    COMMAND_FAILED = 1,         /* the job failed or timed out; or any other error */
    COMMAND_USAGE = 2,          /* a bad command line, a token that does not do, or a refused request */
    COMMAND_UNREACHABLE = 3,    /* no server answers */
    COMMAND_MISSING = 4,        /* no such job, its state does not allow this, or there are no results */
    COMMAND_CANCELLED = 6,      /* the job was cancelled */
    COMMAND_NOT_CONVERGED = 10, /* the job succeeded but did not converge */
    COMMAND_UNRESOLVED = 11,    /* the job succeeded with the outcome unresolved */
};

#define COMMAND_LABELS_MOST 32

/* NULL: the option was not given. Only what belongs to the command is set. */
typedef struct command_options {
    bool json, wait, dependents, yes;
    bool
        accept; /* of wait, and of submit and attach with wait: COMMAND_OK for an accepted outcome (queue.accept) */
    bool several; /* whether the command line has more than one argument */
    const char *label[COMMAND_LABELS_MOST];
    size_t label_count;
    const char *owner, *state, *name, *text;
    const char *since, *until; /* of list: times, or how long ago, "90m" or "90m ago" */
    const char *limit;
    const char *priority;
    const char *key;         /* of submit: the Idempotency-Key */
    const char *frames;      /* of attach: the frames of the new array, as in queue.frames */
    const char *const *mesh; /* of attach: paths as in a spec */
    size_t mesh_count;
    const char *frame;   /* of fetch: numbers as in queue.frames; of log and attach: one number */
    const char *attempt; /* of log */
    const char *output;  /* of fetch; NULL: a directory named by the job's id */
    const char *file;    /* of token: the daemon's token_file */
    const char *picture; /* of show: a file that takes the picture; NULL: none */
    gid_t file_group;   /* of token: the group that may read the system service's file; else TOKEN_NO_GROUP */
    const char *scopes; /* of token add; NULL: all but admin */
    const char *max_priority; /* of token add; NULL: any */
} command_options;

/* `argument` is the path of a file or "-", the job's whole id, the token's user or id, or NULL. Each returns an exit code. */
typedef int command(client *c, const char *argument, const command_options *options);

command command_attach, command_submit, command_validate, command_estimate, command_upload, command_inspect;
command command_list, command_show, command_attempts, command_wait;
command command_fetch, command_log;
command command_cancel, command_pause, command_resume, command_retry, command_deliver, command_delete,
    command_priority;
command command_watch, command_workers, command_drain, command_undrain;
command command_hold, command_release, command_usage;

/* These work on the token file, without a server. */
command command_token_add, command_token_list, command_token_revoke;

/* ---- for the commands themselves */

/* Returns a path below /v1/jobs for an id that a user typed, to be freed; or prints an error and returns NULL
 * when it cannot be an id. */
char *command_job_path(const char *id, const char *rest);

/* Sends a request and returns an exit code, after printing why it was refused. On success the document, where there is
 * one, is the caller's. */
int command_ask(client *c, const char *method, const char *path, const char *body, json **document);

/* The next page of a job's tasks, a document to be freed. *after is TASKS_FROM_THE_FIRST before the first page. NULL after the
 * last one, or when *code is no longer COMMAND_OK. */
#define TASKS_FROM_THE_FIRST (-1.0)
json *command_next_tasks(client *c, const char *id, double *after, int *code);

/* Prints frames of an array that has ended: those whose outcomes are unresolved or not_converged, a line for each outcome;
 * then a line for each frame with another outcome than converged, a rating other than good, or a warning, at most ten. */
int command_print_frame_outcomes(client *c, json_at job, FILE *file);

/* Prints why jobs wait although there is room, where the service says so: the queue is held, the service drains. */
void command_explain_waiting(client *c, FILE *file);

/* Waits for the end of a job, prints it, and returns its exit code. */
int command_wait_for(client *c, const char *path, const command_options *options);

/* Waits until no result of a job is to be copied to output.directory, prints the job, and returns COMMAND_FAILED when a copy
 * failed. */
int command_wait_for_copy(client *c, const char *path, const command_options *options);

/* Submits a spec given as text, as command_submit does. */
int command_submit_text(client *c, const char *spec, const command_options *options);

/* Whether the job is in a final state. */
bool command_has_ended(json_at job);

#endif
