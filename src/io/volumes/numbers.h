// SPDX-License-Identifier: Apache-2.0
/* numbers: the numbers of a dense volume as they are stored, and as doubles. Pure functions; any thread. */
#ifndef HEXAD_IO_VOLUMES_NUMBERS_H
#define HEXAD_IO_VOLUMES_NUMBERS_H

#include <stdbool.h>
#include <stdint.h>

#include "io/volumes/volume_header.h"

enum { NUMBERS_INEXACT_SIZE = 24 };

/* The name of a type: "int8", ..., "float", "double". */
const char *numbers_name(number_type type);

/* Whether the type has numbers that a float does not represent. */
bool numbers_need_doubles(number_type type);

/* If the number is a whole number that a double may not represent, writes it to `inexact`, unless it has a
 * number already. */
void numbers_note_inexact(const unsigned char *bytes, number_type type, bool swapped,
                          char inexact[NUMBERS_INEXACT_SIZE]);

/* Converts `count` numbers, in the opposite byte order if `swapped`, to doubles. `inexact` as in
 * numbers_note_inexact. */
void numbers_convert(const unsigned char *bytes, number_type type, bool swapped, int64_t count,
                     double *values, char inexact[NUMBERS_INEXACT_SIZE]);

#endif
