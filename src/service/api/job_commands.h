// SPDX-License-Identifier: Apache-2.0
/* job_commands: the handlers that change an existing job. Callers other than its owner and administrators are
 * refused. */
#ifndef HEXAD_SERVICE_API_JOB_COMMANDS_H
#define HEXAD_SERVICE_API_JOB_COMMANDS_H

#include "service/api/context.h"

http_handler job_commands_cancel, job_commands_pause, job_commands_resume, job_commands_retry,
    job_commands_deliver;

/* The members of a spec's group `queue` that PATCH can change. Ends with NULL. */
extern const char *const job_commands_patch_members[];

/* PATCH. With If-Match, the job is changed only if it has the revision of that ETag. */
http_handler job_commands_edit;

/* DELETE: deletes a job that has ended, with its results. */
http_handler job_commands_delete;

#endif
