// SPDX-License-Identifier: Apache-2.0
/* maintenance: the commands `hexad --backup` and `hexad --check`. They copy the database, or check the whole
 * state directory, and exit. Both work with and without a running daemon; a running daemon makes the copy.
 */
#ifndef HEXAD_PROGRAMS_MAINTENANCE_H
#define HEXAD_PROGRAMS_MAINTENANCE_H

#include "service/config/config.h"

/* Both return an exit status and print faults. */
int maintenance_back_up(const config *settings); /* into settings->backup */
int maintenance_check(const config *settings);

#endif
