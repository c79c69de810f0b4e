// SPDX-License-Identifier: Apache-2.0
/* child_environment: the environment of the programs that this process starts. A worker reads files of strangers,
 * and a program of Slurm passes its environment on to other hosts: tokens, sockets of the service manager and
 * settings of the loader stay here. doc/worker.md lists the variables that are passed. */
#ifndef HEXAD_BASE_CORE_CHILD_ENVIRONMENT_H
#define HEXAD_BASE_CORE_CHILD_ENVIRONMENT_H

typedef enum child_environment_of {
    CHILD_ENVIRONMENT_OF_WORKER,
    CHILD_ENVIRONMENT_OF_SLURM /* also the settings of the commands of Slurm */
} child_environment_of;

/* The variables of this process that such a program gets, and `own` ("NAME=VALUE"; NULL: none). The caller frees the
 * array; the strings are those of this process. */
char **child_environment_new(child_environment_of of, char *own);

#endif
