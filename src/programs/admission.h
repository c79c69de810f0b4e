// SPDX-License-Identifier: Apache-2.0
/* admission: `hexad --allow` and `hexad --deny`: permits and removes users of the Unix socket of the systemd
 * service.
 */
#ifndef HEXAD_PROGRAMS_ADMISSION_H
#define HEXAD_PROGRAMS_ADMISSION_H

#include "service/auth/access.h"
#include "service/config/config.h"

/* Adds settings->admit, a user or @GROUP, to unix_users or unix_groups of the settings file. If systemd runs
 * the service with this file (there is no --config, or hexad.service names the same file), it also opens the
 * socket to all users: by a drop-in of hexad.socket, and by the mode of the existing socket. It then makes
 * systemd and the service read both again. With CONFIG_DENY it removes the name, and the drop-in if no user
 * and no group remains. Prints each step; a completed step changes nothing. Warns if the admitted user still
 * cannot reach the socket, and if other settings still admit a denied user. Returns an exit status. 2: the
 * name or the settings are wrong, and no file was changed. */
int admission_change(const config *settings, config_action action);

/* The names of a list setting; they remain owned by the setting. */
static inline access_names admission_names(const config_list *list)
{
    return (access_names){(const char *const *)list->item, list->count};
}

#endif
