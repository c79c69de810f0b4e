/* warnings: what a volume's header says that is ignored, or that contradicts itself. */
#ifndef HEXAD_DENSE_WARNINGS_H
#define HEXAD_DENSE_WARNINGS_H

#include <stdint.h>

/* More than any header can give: each warning is given once. */
enum { DENSE_WARNINGS_MOST = 12, DENSE_WARNING_SIZE = 256 };

typedef struct dense_warnings {
    uint32_t count;
    char text[DENSE_WARNINGS_MOST][DENSE_WARNING_SIZE];
} dense_warnings;

/* Control characters, which a header may contain, become spaces. */
void dense_warn(dense_warnings *w, const char *format, ...) __attribute__((format(printf, 2, 3)));

/* Positions are in the unit of the file. A warning if that is another one than the millimetre; "" and "?": it is unknown. */
void dense_warn_of_unit(dense_warnings *w, const char *unit);

#endif
