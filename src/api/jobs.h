/* jobs: the handlers that submit, list and show jobs.
 *
 * Who may read sees that a job is there, whose it is and how it fares: one queue serves them all. Its spec, its
 * results, its log and its events are its owner's and the admins', and so is what changes it.
 */
#ifndef HEXAD_API_JOBS_H
#define HEXAD_API_JOBS_H

#include "api/context.h"

http_handler jobs_submit, jobs_validate, jobs_list, jobs_show;

/* Answers with the document of a job as it is now. */
void jobs_answer(const http_context *c, const http_request *request, const char *id, int status, reply *r);

#endif
