/* job_commands: the handlers that change an existing job. Only its owner and administrators may. */
#ifndef HEXAD_API_JOB_COMMANDS_H
#define HEXAD_API_JOB_COMMANDS_H

#include "api/context.h"

http_handler job_commands_cancel, job_commands_pause, job_commands_resume, job_commands_retry,
    job_commands_deliver;

/* The members of a spec's `queue` that PATCH can change; NULL behind the last. */
extern const char *const job_commands_patch_members[];

/* PATCH. With If-Match it changes the job only while the job has that ETag. */
http_handler job_commands_edit;

/* Deletes a job that has ended, with its results. */
http_handler job_commands_delete;

#endif
