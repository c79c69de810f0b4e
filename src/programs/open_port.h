// SPDX-License-Identifier: Apache-2.0
/* open_port: `hexad --open-port`: opens a TCP port of the systemd service for the web page. */
#ifndef HEXAD_PROGRAMS_OPEN_PORT_H
#define HEXAD_PROGRAMS_OPEN_PORT_H

#include "service/config/config.h"

/* Creates a token for the user settings->admit unless the user has one, writes the drop-in
 * hexad.socket.d/tcp.conf unless it exists, starts hexad.socket and hexad.service (after a stop if the drop-in
 * is new), and prints the addresses. Returns an exit status; 2: this machine has no such user, or systemd does
 * not run the service; nothing was changed. */
int open_port(const config *settings);

#endif
