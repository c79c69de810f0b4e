/* admission: `hexad --allow` and `hexad --deny`: permits and removes users of the Unix socket of the systemd service. */
#ifndef HEXAD_PROGRAMS_ADMISSION_H
#define HEXAD_PROGRAMS_ADMISSION_H

#include "auth/access.h"
#include "config/config.h"

/* Adds settings->admit, a user or @GROUP, to unix_users or unix_groups of the settings file. Where systemd runs the service
 * with this file (no --config, or hexad.service names it) it also opens the socket to all users (a drop-in of hexad.socket,
 * and the mode of the socket that is there) and has systemd and the service read both again. With CONFIG_DENY removes the
 * name, and the drop-in when no user and no group remains. Prints each step; a step that is done already changes nothing.
 * Warns if the admitted user still cannot reach the socket, and of settings that still admit a denied one. Returns an exit
 * status: 2 when the name or the settings are wrong, and then no file has changed. */
int admission_change(const config *settings, config_action action);

/* The names of a list setting, which stay the setting's. */
static inline access_names admission_names(const config_list *list)
{
    return (access_names){(const char *const *)list->item, list->count};
}

#endif
