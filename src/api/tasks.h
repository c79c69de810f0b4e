/* tasks: the handlers of what a job consists of: its tasks, their attempts and what those said. */
#ifndef HEXAD_API_TASKS_H
#define HEXAD_API_TASKS_H

#include "api/context.h"

http_handler tasks_list, tasks_list_attempts, tasks_show_log;

void tasks_append_attempt(json *list, const queue_attempt *attempt);

/* Puts a time as RFC 3339, null for 0. */
void tasks_put_time(json *object, const char *key, int64_t wall_ms);

#endif
