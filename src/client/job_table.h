// SPDX-License-Identifier: Apache-2.0
/* job_table: prints jobs, attempts and frames for the commands of hexadctl. One thread. */
#ifndef HEXAD_CLIENT_JOB_TABLE_H
#define HEXAD_CLIENT_JOB_TABLE_H

#include <stdio.h>

#include "client/table.h"
#include "base/json/json.h"

/* Tables of jobs, of attempts, and of the frames of an array. */
table job_table_new(void);
void job_table_add(table *t, json_at job);
table job_table_new_attempts(void);
void job_table_add_attempt(table *t, json_at attempt);
table job_table_new_frames(void);
void job_table_add_frame(table *t, json_at task);

/* The age of the time in a member, such as "3m"; "-" without a time. The caller frees it. */
char *job_table_new_age(json_at object, const char *key);

/* Prints a line with the id, the name and the age of a job: "ID NAME, submitted 3m ago". */
void job_table_print_identity(json_at job, FILE *file);

/* Prints one job in full, without its spec. `dependents` is a page of the list of the jobs that depend on it,
 * or no value. */
void job_table_print(json_at job, json_at dependents);

/* The running attempts of the service (GET /v1/workers). */
table job_table_new_workers(void);
void job_table_add_worker(table *t, json_at worker);

#endif
