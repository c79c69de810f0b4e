// SPDX-License-Identifier: Apache-2.0
/* tasks: the handlers of the parts of a job: its tasks, their attempts, and the logs and snapshots of
 * attempts. */
#ifndef HEXAD_SERVICE_API_TASKS_H
#define HEXAD_SERVICE_API_TASKS_H

#include "service/api/context.h"

http_handler tasks_list, tasks_list_attempts, tasks_show_log, tasks_send_snapshot;

#endif
