/* change: the handlers that change a job that is there, which its owner and admins may. */
#ifndef HEXAD_HTTP_CHANGE_H
#define HEXAD_HTTP_CHANGE_H

#include "http/handler.h"

http_handler change_cancel, change_pause, change_resume, change_retry;

/* What can be changed: these members of a spec's `queue`; ended by NULL. */
extern const char *const change_members[];

/* PATCH of some of them. With If-Match only when the job is still as the ETag says. */
http_handler change_edit;

/* Forgets a job that has ended, with its results. */
http_handler change_delete;

#endif
