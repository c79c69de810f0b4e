// SPDX-License-Identifier: Apache-2.0
/* job_lookup: finds the job that the path of a request names. Any thread. */
#ifndef HEXAD_SERVICE_API_JOB_LOOKUP_H
#define HEXAD_SERVICE_API_JOB_LOOKUP_H

#include "service/api/context.h"

/* Reads the job of parameter 0 of the path. On success the caller calls queue_job_clear; otherwise *r is set
 * to a problem. */
bool job_lookup_find(const http_context *c, const http_request *request, queue_job *job, reply *r);

/* Like job_lookup_find, and fails if the caller is neither the owner of the job nor an administrator. */
bool job_lookup_find_own(const http_context *c, const http_request *request, queue_job *job, reply *r);

/* Answers that the job does not exist. */
void job_lookup_refuse(const char *id, reply *r);

#endif
