// SPDX-License-Identifier: Apache-2.0
#include "service/api/job_lookup.h"

void job_lookup_refuse(const char *id, reply *r)
{
    reply_set_problem(r, "not_found", NULL, "the job %s does not exist: list the jobs for their IDs", id);
}

bool job_lookup_find(const http_context *c, const http_request *request, queue_job *job, reply *r)
{
    error e = {0};
    bool found = false;
    const char *id = request->parameter[0];
    if (ulid_is_valid(id) && !queue_get(c->q, id, job, &found, &e)) {
        reply_set_error(r, &e, NULL);
        return false;
    }
    if (!found) job_lookup_refuse(id, r);
    return found;
}

bool job_lookup_find_own(const http_context *c, const http_request *request, queue_job *job, reply *r)
{
    if (!job_lookup_find(c, request, job, r)) return false;
    if (access_is_owner(request->caller, job->owner)) return true;
    reply_set_problem(r, "forbidden", NULL,
                      "the job %s belongs to %s: ask its owner or an administrator to do this", job->id,
                      job->owner);
    queue_job_clear(job);
    return false;
}
