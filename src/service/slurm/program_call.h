// SPDX-License-Identifier: Apache-2.0
/* program_call: runs a program of Slurm with a time limit and collects its output. No state; any thread
 * that may wait. */
#ifndef HEXAD_SERVICE_SLURM_PROGRAM_CALL_H
#define HEXAD_SERVICE_SLURM_PROGRAM_CALL_H

#include <stdbool.h>
#include <stddef.h>

#include "base/core/error.h"

typedef struct program_call_result {
    int status;               /* exit status; -1: a signal ended the program */
    bool timed_out;           /* it was killed at the time limit, and its effect is unknown */
    char *output, *complaint; /* standard output and standard error */
} program_call_result;

/* Runs `arguments` (the program is found by PATH; the last element is NULL) with `input` as standard input
 * (NULL: none) and the environment of base/core/child_environment. Error internal: the program cannot be started, or its output is too long. On success the
 * caller releases *out with program_call_clear. */
bool program_call_run(const char *const *arguments, const char *input, double limit_s,
                      program_call_result *out, error *e);
void program_call_clear(program_call_result *r);

#endif
