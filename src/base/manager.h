/* manager: talks to the service manager (systemd) that started this process; without one each call does nothing.
 *
 * Reports readiness, status and life signs, takes over a listening socket, and writes to the journal. The only user of
 * libsystemd. Any thread, except manager_socket.
 */
#ifndef HEXAD_BASE_MANAGER_H
#define HEXAD_BASE_MANAGER_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <sys/uio.h>

#include "base/error.h"

bool manager_is_there(void); /* a manager expects reports */

void manager_tell_ready(void);
void manager_tell_reloading(void); /* until the next manager_tell_ready */
/* The start goes on and may take this many seconds more. */
void manager_tell_starting(double seconds);
/* The service is ending, which may take so many seconds. */
void manager_tell_stopping(double seconds);
void manager_tell_status(const char *format, ...) __attribute__((format(printf, 1, 2)));
void manager_tell_alive(void);

/* The longest time between two manager_tell_alive before the manager ends the service; 0: no watchdog. */
int64_t manager_watchdog_ms(void);

/* The one socket that was handed over, or -1 when there is none. More than one is an error (spec_invalid). */
bool manager_socket(int *fd, error *e);

/* Whether standard error is connected to the journal: then records should have fields. */
bool manager_has_journal(void);
bool manager_journal(const struct iovec *fields, size_t count); /* each NAME=value; false: not written */

#endif
