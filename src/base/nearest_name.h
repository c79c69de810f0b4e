/* nearest_name: the known name that a misspelt one probably stands for, among names that the caller offers.
 *
 * A third of the letters of the given name may differ, and two of a short name; two adjacent letters that are swapped
 * count as 1 (Levenshtein's distance with transpositions). Of several names with the same distance the first is kept.
 */
#ifndef HEXAD_BASE_NEAREST_NAME_H
#define HEXAD_BASE_NEAREST_NAME_H

#include <stddef.h>

typedef struct nearest_name {
    const char *given;
    size_t length;    /* of the given name, which may be followed by other text */
    const char *name; /* the nearest one that was offered; NULL: none is near */
    size_t distance;  /* of that name; or the least distance that is too far */
} nearest_name;

/* A search for the given name, which stays the caller's. */
nearest_name nearest_name_to(const char *given, size_t length);

/* Offers a known name, which stays the caller's. */
void nearest_name_offer(nearest_name *n, const char *name);

#endif
