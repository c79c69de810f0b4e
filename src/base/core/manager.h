// SPDX-License-Identifier: Apache-2.0
/* manager: communicates with the service manager (systemd) that started this process. Without one, functions
 * do nothing.
 *
 * Reports readiness, status and keep-alives, takes over listening sockets, and writes to the journal. The
 * only user of libsystemd. Any thread, except manager_sockets.
 */
#ifndef HEXAD_BASE_CORE_MANAGER_H
#define HEXAD_BASE_CORE_MANAGER_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <sys/uio.h>

#include "base/core/error.h"

bool manager_is_present(void); /* a manager is present and expects reports */

void manager_report_ready(void);
void manager_report_reloading(void); /* until the next manager_report_ready */
/* The start continues and may take this many more seconds. */
void manager_report_starting(double seconds);
/* The service is stopping, which may take this many seconds. */
void manager_report_stopping(double seconds);
void manager_report_status(const char *format, ...) __attribute__((format(printf, 1, 2)));
void manager_report_alive(void);

/* Maximum time between two calls of manager_report_alive before the manager kills the service; 0: no
 * watchdog. */
int64_t manager_watchdog_ms(void);

/* The number of sockets passed by the manager, with consecutive descriptors from *first. */
size_t manager_sockets(int *first);

/* Whether standard error is connected to the journal, so that records should have fields. */
bool manager_has_journal(void);
bool manager_journal(const struct iovec *fields, size_t count); /* each NAME=value; false: not written */

#endif
