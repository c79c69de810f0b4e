/* jobs: the handlers that submit, list and show jobs.
 *
 * All callers with the scope `read` see what api/job_json shows of a job, since all jobs share one queue. Only the owner and
 * administrators see the rest, its results and its log, and only they may change it.
 */
#ifndef HEXAD_API_JOBS_H
#define HEXAD_API_JOBS_H

#include "api/context.h"

http_handler jobs_submit, jobs_validate, jobs_list, jobs_show;
/* The `kept` of jobs_show: from the cache of documents. */
http_keeper jobs_show_kept;
/* The `awaiting` of routes whose handlers call jobs_wait. */
http_handler jobs_await;

/* Answers with the current document of a job. */
void jobs_answer(const http_context *c, const http_request *request, const char *id, int status, reply *r);

/* Makes the answer, which has the document of this job, wait for the end of the job if the request prefers that. */
void jobs_wait(const http_context *c, const http_request *request, const char *id, reply *r);

/* Whether the caller may give this priority; otherwise answers why not. `pointer` names it in the body. */
bool jobs_admit_priority(const http_context *c, const http_request *request, int priority,
                         const char *pointer, reply *r);

#endif
