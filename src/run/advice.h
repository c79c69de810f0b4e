/* advice: what to change in a spec so that its result is better, as members of the spec with values computed from the data.
 *
 * Reports, estimates and descriptions of files have it as `advice: [{code, message, set}]`: a stable code, a sentence that
 * says all to people, and the members that it would set, by their JSON Pointers. Pure functions, any thread.
 */
#ifndef HEXAD_RUN_ADVICE_H
#define HEXAD_RUN_ADVICE_H

#include <stddef.h>

#include "json/json.h"
#include "spec/spec.h"

typedef struct advice_resolution {
    double spacing; /* of an even packing on the surface */
    double count;   /* that many points; rounded up to two digits, what `spacing` and `count` say agrees */
} advice_resolution;

/* What separates the walls of a surface of this area, on which `count` points have a spacing that is to become `factor` times as large. A
 * factor of 1 is not known, and taken for a half. */
advice_resolution advice_resolve(double area, size_t count, double factor);

/* The warning that this share of the surface are walls thinner than the spacing, and what separates them; to be freed. */
char *advice_warn_of_walls(double share, advice_resolution to);

/* Appends an item, and returns its object `set`. */
json *advice_append(json *list, const char *code, const char *message);

/* Appends an item that sets the target of the spec so, with the code `unresolved`. `memory_mb`: what so many points need of limits.memory_mb; set, too,
 * where it is more than `limit_mb`. */
void advice_append_resolution(json *list, const spec *s, double area, advice_resolution to, double memory_mb,
                              double limit_mb);

#endif
