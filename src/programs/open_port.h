// SPDX-License-Identifier: Apache-2.0
/* open_port: `hexad --open-port`: opens a TCP port of the systemd service for the web page. */
#ifndef HEXAD_PROGRAMS_OPEN_PORT_H
#define HEXAD_PROGRAMS_OPEN_PORT_H

#include "service/config/config.h"

/* Creates a token for the user settings->admit, writes the drop-in hexad.socket.d/tcp.conf unless it exists,
 * restarts hexad.socket with it, and prints the address and the token. Returns an exit status; 2: the user is
 * wrong, and nothing was changed. */
int open_port(const config *settings);

#endif
