/* job_lookup: finds the job that the path of a request names. Any thread. */
#ifndef HEXAD_API_JOB_LOOKUP_H
#define HEXAD_API_JOB_LOOKUP_H

#include "api/context.h"

/* On success the caller clears *job; otherwise the reply says why not. */
bool job_lookup_find(const http_context *c, const http_request *request, queue_job *job, reply *r);

/* As job_lookup_find; it also refuses callers who are neither the owner of the job nor administrators. */
bool job_lookup_find_own(const http_context *c, const http_request *request, queue_job *job, reply *r);

#endif
