/* command: what hexadctl does, one function a command. One thread. */
#ifndef HEXAD_CLIENT_COMMAND_H
#define HEXAD_CLIENT_COMMAND_H

#include <stdbool.h>

#include "client/client.h"

/* Exit codes of hexadctl. */
enum {
    COMMAND_OK = 0,             /* done; of a job that was waited for: succeeded and converged */
    COMMAND_FAILED = 1,         /* the job failed or ran out of time; or any other trouble */
    COMMAND_USAGE = 2,          /* a bad command line, or a spec that the server refuses */
    COMMAND_UNREACHABLE = 3,    /* no server answers */
    COMMAND_MISSING = 4,        /* no such job, or it has no results */
    COMMAND_CANCELLED = 6,      /* the job was cancelled */
    COMMAND_NOT_CONVERGED = 10, /* the job succeeded but did not converge */
};

typedef struct command_options {
    bool json, wait;
    const char *state;  /* of list; NULL: all */
    const char *limit;  /* of list; NULL: the server's default */
    const char *output; /* of fetch; NULL: a directory named by the job's id */
} command_options;

/* `argument` is the spec's path or "-", or the job's id. Each returns an exit code. */
typedef int command(client *c, const char *argument, const command_options *options);

command command_submit, command_list, command_show, command_wait, command_cancel, command_fetch;

#endif
