// SPDX-License-Identifier: Apache-2.0
#include "base/core/nearest_name.h"

#include <stdint.h>
#include <string.h>

enum { LENGTH_MOST = 64 }; /* bytes; longer names are not compared */

static size_t least(size_t a, size_t b)
{
    return a < b ? a : b;
}

/* Levenshtein distance in which a transposition of adjacent letters counts as 1 (optimal string
 * alignment). */
static size_t edit_distance(const char *a, size_t na, const char *b, size_t nb)
{
    size_t rows[3][LENGTH_MOST + 1];
    if (na > LENGTH_MOST || nb > LENGTH_MOST) return SIZE_MAX;
    for (size_t j = 0; j <= nb; j++) rows[0][j] = j;
    for (size_t i = 1; i <= na; i++) {
        size_t *row = rows[i % 3], *above = rows[(i + 2) % 3], *second = rows[(i + 1) % 3];
        row[0] = i;
        for (size_t j = 1; j <= nb; j++) {
            row[j] = least(above[j - 1] + (a[i - 1] != b[j - 1]), 1 + least(above[j], row[j - 1]));
            if (i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1])
                row[j] = least(row[j], second[j - 2] + 1);
        }
    }
    return rows[na % 3][nb];
}

nearest_name nearest_name_to(const char *given, size_t length)
{
    size_t most = length / 3 > 2 ? length / 3 : length > 3 ? 2 : 1;
    return (nearest_name){.given = given, .length = length, .distance = most + 1};
}

void nearest_name_offer(nearest_name *n, const char *name)
{
    size_t distance = edit_distance(n->given, n->length, name, strlen(name));
    if (distance >= n->distance) return;
    n->name = name;
    n->distance = distance;
}
