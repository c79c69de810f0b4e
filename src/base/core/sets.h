// SPDX-License-Identifier: Apache-2.0
/* sets: union-find on the numbers 0 to n - 1, in an array of the caller. The root of a set is its lowest
 * number. One thread at a time, except for functions named shared.
 */
#ifndef HEXAD_BASE_CORE_SETS_H
#define HEXAD_BASE_CORE_SETS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* Makes each number a set of its own. */
static inline void sets_reset(uint32_t *parent, size_t n)
{
    for (uint32_t k = 0; k < n; k++) parent[k] = k;
}

static inline uint32_t sets_root(uint32_t *parent, uint32_t k)
{
    while (parent[k] != k) k = parent[k] = parent[parent[k]]; /* path halving */
    return k;
}

/* Merges the sets of a and b. Returns whether they were different. */
static inline bool sets_join(uint32_t *parent, uint32_t a, uint32_t b)
{
    a = sets_root(parent, a);
    b = sets_root(parent, b);
    parent[a > b ? a : b] = a < b ? a : b;
    return a != b;
}

/* sets_root while other threads call shared functions. A number that is not a root never becomes one, so that
 * concurrent path halving is correct. */
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

/* sets_join while other threads call shared functions; the result does not depend on the order. */
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

/* Sets the parent of k to its root, while other threads do so for other numbers, after all joins. It does not
 * shorten other paths: that could replace a root that another thread has stored by a number that is not a
 * root. */
static inline void sets_flatten_shared(uint32_t *parent, uint32_t k)
{
    uint32_t root = k, up;
    while ((up = __atomic_load_n(&parent[root], __ATOMIC_RELAXED)) != root) root = up;
    __atomic_store_n(&parent[k], root, __ATOMIC_RELAXED);
}

#endif
