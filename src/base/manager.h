/* manager: the service manager, where one started this process; elsewhere each call does nothing.
 *
 * It is told when the service is ready, what it does and that it is alive, hands over a socket that it
 * listens on already, and takes the log. The only user of libsystemd. Any thread, but for manager_socket.
 */
#ifndef HEXAD_BASE_MANAGER_H
#define HEXAD_BASE_MANAGER_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <sys/uio.h>

#include "base/error.h"

bool manager_is_there(void); /* and wants to be told */

void manager_tell_ready(void);
void manager_tell_reloading(void); /* until the next manager_tell_ready */
/* Ending has begun, and may take so long. */
void manager_tell_stopping(double seconds);
void manager_tell_status(const char *format, ...) __attribute__((format(printf, 1, 2)));
void manager_tell_alive(void);

/* How long the manager waits between two manager_tell_alive before it ends the service; 0: it does not. */
int64_t manager_watchdog_ms(void);

/* The one socket that was handed over, or -1 when there is none. More than one is an error (spec_invalid). */
bool manager_socket(int *fd, error *e);

/* Whether standard error leads to the journal, which then is better given records of fields. */
bool manager_has_journal(void);
bool manager_journal(const struct iovec *fields, size_t count); /* each NAME=value; false: not taken */

#endif
