// SPDX-License-Identifier: Apache-2.0
/* warnings: collects contradictions and ignored contents of a volume's header. */
#ifndef HEXAD_IO_VOLUMES_WARNINGS_H
#define HEXAD_IO_VOLUMES_WARNINGS_H

#include <stdint.h>

/* More than a header can cause, since each warning is given once. */
enum { DENSE_WARNINGS_MOST = 24, DENSE_WARNING_SIZE = 256 };

typedef struct dense_warnings {
    uint32_t count;
    char text[DENSE_WARNINGS_MOST][DENSE_WARNING_SIZE];
    char no_data[32]; /* the number that means "no data" by the file; "": none */
} dense_warnings;

/* Sets no_data to the number behind a name such as NODATA, missing_value or _FillValue, if the text has one. */
void dense_note_no_data(dense_warnings *w, const char *text);

/* Adds a warning. Control characters, which a header may contain, become spaces. */
void dense_warn(dense_warnings *w, const char *format, ...) __attribute__((format(printf, 2, 3)));

/* Adds a warning if the unit of the file is not the millimetre, because positions are in the unit of the
 * file. "" and "?": the unit is unknown. */
void dense_warn_of_unit(dense_warnings *w, const char *unit);

#endif
