/* command: runs a program of Slurm with a time limit and collects its output. No state; any thread that may wait. */
#ifndef HEXAD_SERVICE_SLURM_COMMAND_H
#define HEXAD_SERVICE_SLURM_COMMAND_H

#include <stdbool.h>
#include <stddef.h>

#include "base/core/error.h"

typedef struct command_result {
    int status;               /* exit status; -1: a signal ended the program */
    bool timed_out;           /* it was killed at the time limit, and its effect is unknown */
    char *output, *complaint; /* standard output and standard error */
} command_result;

/* Runs `arguments` (the program is found by PATH; the last element is NULL) with `input` as standard input (NULL:
 * none). Error internal: the program cannot be started, or its output is too long. On success the caller releases
 * *out with command_clear. */
bool command_run(const char *const *arguments, const char *input, double limit_s, command_result *out,
                 error *e);
void command_clear(command_result *r);

#endif
