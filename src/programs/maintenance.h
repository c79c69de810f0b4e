/* maintenance: what the program hexad does at once and ends: a backup of the database, and a check of the whole state
 * directory. Both work while a daemon runs, which they ask for a copy, and otherwise. */
#ifndef HEXAD_PROGRAMS_MAINTENANCE_H
#define HEXAD_PROGRAMS_MAINTENANCE_H

#include "config/config.h"

/* Exit statuses; what is wrong is printed. */
int maintenance_back_up(const config *settings); /* into settings->backup */
int maintenance_check(const config *settings);

#endif
