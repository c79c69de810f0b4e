/* command: runs a program of Slurm with a time limit and takes what it prints. No state; any thread that may wait. */
#ifndef HEXAD_SLURM_COMMAND_H
#define HEXAD_SLURM_COMMAND_H

#include <stdbool.h>
#include <stddef.h>

#include "base/error.h"

typedef struct command_result {
    int status;               /* exit status; -1: it was killed */
    bool timed_out;           /* it was killed at the time limit: what it has done is not known */
    char *output, *complaint; /* standard output and standard error */
} command_result;

/* Runs `arguments` (found by PATH, ended by NULL) with `input` as standard input (NULL: none). False and an error
 * (internal) when it cannot be started or prints more than fits; otherwise the caller clears. */
bool command_run(const char *const *arguments, const char *input, double limit_s, command_result *out,
                 error *e);
void command_clear(command_result *r);

#endif
