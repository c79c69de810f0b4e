// SPDX-License-Identifier: Apache-2.0
/* number: numbers as files store them, by type and byte order, at any address. Pure functions; any thread. */
#ifndef HEXAD_BASE_CORE_NUMBER_H
#define HEXAD_BASE_CORE_NUMBER_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>
#include <strings.h>

typedef enum number_type {
    NUMBER_INT8,
    NUMBER_UINT8,
    NUMBER_INT16,
    NUMBER_UINT16,
    NUMBER_INT32,
    NUMBER_UINT32,
    NUMBER_INT64,
    NUMBER_UINT64,
    NUMBER_FLOAT,
    NUMBER_DOUBLE,
    NUMBER_TYPES
} number_type;

/* Whether a file in this byte order has the opposite order to that of the machine. */
enum {
    NUMBER_LITTLE_SWAPPED = __BYTE_ORDER__ == __ORDER_BIG_ENDIAN__,
    NUMBER_BIG_SWAPPED = __BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__
};

static inline size_t number_bytes(number_type type)
{
    static const unsigned char bytes[NUMBER_TYPES] = {1, 1, 2, 2, 4, 4, 8, 8, 4, 8};
    return bytes[type];
}

static inline bool number_is_whole(number_type type)
{
    return type < NUMBER_FLOAT;
}

/* The type of a name in any case: "int8", ..., "uint64", "float32", "float64". False: there is none. */
static inline bool number_find(const char *name, number_type *out)
{
    static const char *const names[NUMBER_TYPES] = {"int8",   "uint8", "int16",  "uint16",  "int32",
                                                    "uint32", "int64", "uint64", "float32", "float64"};
    for (int k = 0; k < NUMBER_TYPES; k++)
        if (strcasecmp(name, names[k]) == 0) {
            *out = (number_type)k;
            return true;
        }
    return false;
}

/* The bits of a number of 1, 2, 4 or 8 bytes. */
static inline uint64_t number_bits(const void *at, size_t bytes, bool swapped)
{
    uint8_t one;
    uint16_t two;
    uint32_t four;
    uint64_t eight;
    switch (bytes) {
    case 1:
        memcpy(&one, at, sizeof one);
        return one;
    case 2:
        memcpy(&two, at, sizeof two);
        return swapped ? __builtin_bswap16(two) : two;
    case 4:
        memcpy(&four, at, sizeof four);
        return swapped ? __builtin_bswap32(four) : four;
    default:
        memcpy(&eight, at, sizeof eight);
        return swapped ? __builtin_bswap64(eight) : eight;
    }
}

/* A number of an integer type. Values of uint64 are clamped to INT64_MAX. */
static inline int64_t number_whole(const void *at, number_type type, bool swapped)
{
    const uint64_t bits = number_bits(at, number_bytes(type), swapped);
    switch (type) {
    case NUMBER_INT8:
        return (int8_t)bits;
    case NUMBER_INT16:
        return (int16_t)bits;
    case NUMBER_INT32:
        return (int32_t)bits;
    case NUMBER_UINT64:
        return bits > INT64_MAX ? INT64_MAX : (int64_t)bits;
    default:
        return (int64_t)bits;
    }
}

static inline double number_value(const void *at, number_type type, bool swapped)
{
    const uint64_t bits = number_bits(at, number_bytes(type), swapped);
    const uint32_t low = (uint32_t)bits;
    float single;
    double value;
    switch (type) {
    case NUMBER_FLOAT:
        memcpy(&single, &low, sizeof single);
        return (double)single;
    case NUMBER_DOUBLE:
        memcpy(&value, &bits, sizeof value);
        return value;
    case NUMBER_UINT64:
        return (double)bits;
    default:
        return (double)number_whole(at, type, swapped);
    }
}

#endif
