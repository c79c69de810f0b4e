/* sets: disjoint sets of the numbers 0 to n - 1, as a forest in an array of the caller's. The least of a set is its
 * root. Joining is not for several threads at once, but for what is called shared. */
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

/* The same while other threads do. Who is no root stays none, so that ways made shorter by others are right as well. */
static inline uint32_t sets_root_shared(uint32_t *parent, uint32_t k)
{
    for (;;) {
        const uint32_t up = __atomic_load_n(&parent[k], __ATOMIC_RELAXED);
        const uint32_t next = __atomic_load_n(&parent[up], __ATOMIC_RELAXED);
        if (next == up) return up;
        __atomic_store_n(&parent[k], next, __ATOMIC_RELAXED);
        k = next;
    }
}

/* Likewise; the sets are the same whoever comes first. */
static inline void sets_join_shared(uint32_t *parent, uint32_t a, uint32_t b)
{
    for (;;) {
        a = sets_root_shared(parent, a);
        b = sets_root_shared(parent, b);
        if (a == b) return;
        uint32_t high = a > b ? a : b;
        const uint32_t low = a < b ? a : b;
        if (__atomic_compare_exchange_n(&parent[high], &high, low, false, __ATOMIC_RELAXED, __ATOMIC_RELAXED))
            return;
    }
}

/* Makes its root the parent of k, while other threads do so of other numbers, once nobody joins any more. It shortens no other's way:
 * a way that is shorter need not end at the root. */
static inline void sets_flatten_shared(uint32_t *parent, uint32_t k)
{
    uint32_t root = k, up;
    while ((up = __atomic_load_n(&parent[root], __ATOMIC_RELAXED)) != root) root = up;
    __atomic_store_n(&parent[k], root, __ATOMIC_RELAXED);
}

#endif
