// SPDX-License-Identifier: Apache-2.0
/* job_name: finds the id of a job that is given by `latest`, by the beginning of its id, or by its name. One
 * thread. */
#ifndef HEXAD_CLIENT_JOB_NAME_H
#define HEXAD_CLIENT_JOB_NAME_H

#include <stdbool.h>

#include "client/client.h"

/* The newest job of the caller. */
#define JOB_NAME_LATEST "latest"
/* Minimum number of characters of an id that name a job. 8 characters are its time in units of 1024 ms; 7
 * would be units of 33 s. */
#define JOB_NAME_PREFIX_LEAST 8

/* Whether the name is not a whole id. */
bool job_name_is_short(const char *name);

/* Sets *id to the id of the job, which the caller frees. The name is `latest`, the beginning of the id of
 * exactly one job of the caller, or, if no id begins with it, the name of exactly one job of the caller. A
 * whole id is copied without a check, since the service checks it. Returns an exit code, after printing why
 * there is no id. If several jobs match, they are printed. */
int job_name_resolve(client *c, const char *name, char **id);

#endif
