// SPDX-License-Identifier: Apache-2.0
/* jobs: the handlers that submit, validate, list and show jobs.
 *
 * All jobs share one queue, so every caller with the scope `read` gets the members of all jobs that
 * service/api/job_json shows to a JOB_JSON_READER. The other members, results and logs are for the owner and
 * administrators, and only they may change a job.
 */
#ifndef HEXAD_SERVICE_API_JOBS_H
#define HEXAD_SERVICE_API_JOBS_H

#include "service/api/context.h"

http_handler jobs_submit, jobs_validate, jobs_list, jobs_show;
/* The member `kept` of the route of jobs_show: answers from the cache of documents. */
http_keeper jobs_show_kept;
/* The member `awaiting` of routes whose handlers call jobs_wait. */
http_handler jobs_await;

/* Sets a reply of this status with the current document of a job, or a problem. Any thread. */
void jobs_answer(const http_context *c, const http_request *request, const char *id, int status, reply *r);

/* If the request has `Prefer: wait`, marks the reply, which must have the document of this job, as
 * provisional: jobs_await replaces it after the end of the job or of the wait. */
void jobs_wait(const http_context *c, const http_request *request, const char *id, reply *r);

/* Whether the caller may use this priority; otherwise sets a problem. `pointer`: the JSON Pointer of the
 * priority in the body. */
bool jobs_admit_priority(const http_context *c, const http_request *request, int priority,
                         const char *pointer, reply *r);

#endif
