// SPDX-License-Identifier: Apache-2.0
/* descriptors: the file descriptors of the daemon. */
#ifndef HEXAD_PROGRAMS_DESCRIPTORS_H
#define HEXAD_PROGRAMS_DESCRIPTORS_H

#include <stddef.h>

/* Opens closed standard descriptors, and raises the limit of open files. Call it once, first in main. */
void descriptors_prepare(void);

/* The number of descriptors that this process may have (RLIMIT_NOFILE), and the number that it has. */
size_t descriptors_limit(void);
size_t descriptors_open(void);

#endif
