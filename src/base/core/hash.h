// SPDX-License-Identifier: Apache-2.0
/* hash: Fowler, Noll and Vo's hash (FNV-1a, 64 bits), for C and C++. It does not resist an attack. Pure functions;
 * any thread. */
#ifndef HEXAD_BASE_CORE_HASH_H
#define HEXAD_BASE_CORE_HASH_H

#include <stdint.h>

#define HASH_NONE 14695981039346656037u /* of no bytes */

/* Adds a byte, or a word in its place. */
static inline uint64_t hash_add(uint64_t hash, uint32_t byte)
{
    return (hash ^ byte) * 1099511628211u;
}

/* Adds the bytes of a text; NULL: none. */
static inline uint64_t hash_add_text(uint64_t hash, const char *text)
{
    for (; text && *text; text++) hash = hash_add(hash, (unsigned char)*text);
    return hash;
}

#endif
