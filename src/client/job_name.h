/* job_name: the short names by which a user may name a job, turned into its id. One thread. */
#ifndef HEXAD_CLIENT_JOB_NAME_H
#define HEXAD_CLIENT_JOB_NAME_H

#include <stdbool.h>

#include "client/client.h"

/* The newest job of the caller. */
#define JOB_NAME_LATEST "latest"
/* Characters of an id that name a job at least: 8 are its time in units of 1024 ms, 7 in units of 33 s. */
#define JOB_NAME_PREFIX_LEAST 8

/* Whether the name is `latest`, or the beginning of an id and not all of it. */
bool job_name_is_short(const char *name);

/* Sets *id, to be freed, to the id of the job: `latest`, or the one job of the caller whose id begins with the name.
 * A whole id stays as it is, for the service to find. Returns an exit code, after printing why there is no id; several
 * jobs are printed. */
int job_name_resolve(client *c, const char *name, char **id);

#endif
