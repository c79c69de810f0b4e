/* numbers: the numbers of a dense volume as they are stored, and as doubles. Pure functions; any thread. */
#ifndef HEXAD_DENSE_NUMBERS_H
#define HEXAD_DENSE_NUMBERS_H

#include <stdbool.h>
#include <stdint.h>

#include "dense/header.h"

enum { NUMBERS_INEXACT_SIZE = 24 };

/* Bytes of a number; its name: "int8", ..., "float", "double". */
int numbers_bytes(header_type type);
const char *numbers_name(header_type type);

/* Whether a float does not hold all numbers of the type. */
bool numbers_need_doubles(header_type type);

/* The number in the machine's byte order, at any address. */
double numbers_value(const unsigned char *bytes, header_type type);

/* Writes to `inexact` a whole number that a double may not hold, unless there is one. */
void numbers_note_inexact(const unsigned char *bytes, header_type type, char inexact[NUMBERS_INEXACT_SIZE]);

/* `count` numbers, in the other byte order if `swapped`, as doubles. `inexact` as above. */
void numbers_convert(const unsigned char *bytes, header_type type, bool swapped, int64_t count,
                     double *values, char inexact[NUMBERS_INEXACT_SIZE]);

#endif
