// SPDX-License-Identifier: Apache-2.0
/* systemd_units: commands of `hexad` that change the units of the service call systemctl. */
#ifndef HEXAD_PROGRAMS_SYSTEMD_UNITS_H
#define HEXAD_PROGRAMS_SYSTEMD_UNITS_H

#include <stdbool.h>

/* The first directory of $SYSTEMD_UNIT_PATH if it is set, since systemd reads units there; otherwise the
 * administrator's directory. The caller frees it. */
char *systemd_units_directory(void);

/* The value of a property of a unit, which the caller frees; "" if systemd does not answer. `words`: the
 * arguments of systemctl. */
char *systemd_units_show(const char *words);

/* Whether systemd has not read a changed file of the service's socket, such as after a failed reload. */
bool systemd_units_are_unread(void);

/* Runs systemctl with these words, and prints the command and its output on separate lines. A failed command is
 * appended to the text *failed, which is freed and replaced. */
void systemd_units_obey(const char *words, char **failed);

#endif
