/* command: the commands of hexadctl, one function each. One thread. */
#ifndef HEXAD_CLIENT_COMMAND_H
#define HEXAD_CLIENT_COMMAND_H

#include <stdbool.h>
#include <sys/types.h>

#include "client/client.h"

/* Exit codes of hexadctl. */
enum {
    COMMAND_OK = 0,             /* done; after waiting for a job: it succeeded and converged */
    COMMAND_FAILED = 1,         /* the job failed or timed out; or any other error */
    COMMAND_USAGE = 2,          /* a bad command line, or a spec that the server refuses */
    COMMAND_UNREACHABLE = 3,    /* no server answers */
    COMMAND_MISSING = 4,        /* no such job, or it has no results */
    COMMAND_CANCELLED = 6,      /* the job was cancelled */
    COMMAND_NOT_CONVERGED = 10, /* the job succeeded but did not converge */
};

typedef struct command_options {
    bool json, wait;
    const char *state;    /* of list; NULL: all */
    const char *limit;    /* of list; NULL: the server's default */
    const char *priority; /* of priority; NULL: none was given */
    const char *output;   /* of fetch; NULL: a directory named by the job's id */
    const char *file;     /* of token: the daemon's token_file */
    gid_t file_group;   /* of token: the group that may read the system service's file; else TOKEN_NO_GROUP */
    const char *scopes; /* of token add; NULL: all but admin */
} command_options;

/* `argument` is the spec's path or "-", the job's id, or the token's user or id. Each returns an exit code. */
typedef int command(client *c, const char *argument, const command_options *options);

command command_submit, command_list, command_show, command_wait, command_cancel, command_fetch;

command command_pause, command_resume, command_retry, command_delete, command_priority, command_watch,
    command_log;
command command_workers, command_drain, command_undrain;

/* These work on the token file, without a server. */
command command_token_add, command_token_list, command_token_revoke;

/* Returns a path below /v1/jobs for an id that a user typed, to be freed; or prints an error and returns NULL
 * when it cannot be an id. */
char *command_job_path(const char *id, const char *rest);

#endif
