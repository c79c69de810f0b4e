// SPDX-License-Identifier: Apache-2.0
/* nearest_name: finds the known name that is most similar to a misspelt one.
 *
 * Up to a third of the letters of the given name may differ, and two in a short name. A transposition of
 * adjacent letters counts as 1 (optimal string alignment distance). If several names have the same distance,
 * the first one is kept. Any thread.
 */
#ifndef HEXAD_BASE_CORE_NEAREST_NAME_H
#define HEXAD_BASE_CORE_NEAREST_NAME_H

#include <stddef.h>

typedef struct nearest_name {
    const char *given;
    size_t length;    /* length of the given name, bytes; other text may follow */
    const char *name; /* the nearest name so far; NULL: none is near */
    size_t distance;  /* its distance; or the minimum distance that is too far */
} nearest_name;

/* Starts a search; `given` is not owned. */
nearest_name nearest_name_to(const char *given, size_t length);

/* Compares with a known name, which is not owned. */
void nearest_name_offer(nearest_name *n, const char *name);

#endif
