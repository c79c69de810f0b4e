// SPDX-License-Identifier: Apache-2.0
#include "io/volumes/warnings.h"

#include <assert.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

void dense_warn(dense_warnings *w, const char *format, ...)
{
    assert(w->count < DENSE_WARNINGS_MOST);
    char *text = w->text[w->count++];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(text, DENSE_WARNING_SIZE, format, arguments);
    va_end(arguments);
    for (; *text; text++)
        if ((unsigned char)*text < ' ') *text = ' ';
}

void dense_note_no_data(dense_warnings *w, const char *text)
{
    static const char *const names[] = {"nodata",        "no_data",       "no data",
                                        "missing_value", "missing value", "_FillValue"};
    for (size_t k = 0; k < sizeof names / sizeof *names; k++) {
        const char *at = strcasestr(text, names[k]);
        if (!at) continue;
        at += strcspn(at, ":=>");
        at += strspn(at, ":=>\"' \t");
        char *end;
        const double value = strtod(at, &end);
        if (end != at) snprintf(w->no_data, sizeof w->no_data, "%.9g", value);
    }
}

void dense_warn_of_unit(dense_warnings *w, const char *unit)
{
    static const char *const expected[] = {"mm", "millimeter", "millimeters", "millimetre", "millimetres"};
    bool known = unit[strspn(unit, "? ")] != '\0';
    for (size_t k = 0; k < sizeof expected / sizeof *expected; k++)
        known = known && strcasecmp(unit, expected[k]) != 0;
    if (known)
        dense_warn(
            w,
            "The header's unit of length is \"%.40s\": positions are in that unit. Give the surface a transform if "
            "another unit is needed.",
            unit);
}
