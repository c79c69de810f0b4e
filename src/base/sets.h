/* sets: disjoint sets of the numbers 0 to n - 1, as a forest in an array of the caller's. The least of a set is its
 * root. Joining is not for several threads at once. */
#ifndef HEXAD_BASE_SETS_H
#define HEXAD_BASE_SETS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* Each number alone. */
static inline void sets_reset(uint32_t *parent, size_t n)
{
    for (uint32_t k = 0; k < n; k++) parent[k] = k;
}

static inline uint32_t sets_root(uint32_t *parent, uint32_t k)
{
    while (parent[k] != k) k = parent[k] = parent[parent[k]]; /* and makes the way shorter */
    return k;
}

/* Makes one of the sets of a and b; whether they were two. */
static inline bool sets_join(uint32_t *parent, uint32_t a, uint32_t b)
{
    a = sets_root(parent, a);
    b = sets_root(parent, b);
    parent[a > b ? a : b] = a < b ? a : b;
    return a != b;
}

#endif
