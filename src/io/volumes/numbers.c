#include "io/volumes/numbers.h"

#include <inttypes.h>
#include <stdio.h>
#include <string.h>

#include "base/core/precision.h"

static const struct {
    int bytes;
    const char *name;
} types[HEADER_TYPE_COUNT] = {
    [HEADER_INT8] = {1, "int8"},     [HEADER_UINT8] = {1, "uint8"},   [HEADER_INT16] = {2, "int16"},
    [HEADER_UINT16] = {2, "uint16"}, [HEADER_INT32] = {4, "int32"},   [HEADER_UINT32] = {4, "uint32"},
    [HEADER_INT64] = {8, "int64"},   [HEADER_UINT64] = {8, "uint64"}, [HEADER_FLOAT] = {4, "float"},
    [HEADER_DOUBLE] = {8, "double"}};

int numbers_bytes(header_type type)
{
    return types[type].bytes;
}

const char *numbers_name(header_type type)
{
    return types[type].name;
}

bool numbers_need_doubles(header_type type)
{
    return types[type].bytes >= 4 && type != HEADER_FLOAT;
}

double numbers_value(const unsigned char *bytes, header_type type)
{
    union {
        int8_t i8;
        uint8_t u8;
        int16_t i16;
        uint16_t u16;
        int32_t i32;
        uint32_t u32;
        int64_t i64;
        uint64_t u64;
        float f;
        double d;
    } v;
    memcpy(&v, bytes, (size_t)types[type].bytes);
    switch (type) {
    case HEADER_INT8:
        return v.i8;
    case HEADER_UINT8:
        return v.u8;
    case HEADER_INT16:
        return v.i16;
    case HEADER_UINT16:
        return v.u16;
    case HEADER_INT32:
        return v.i32;
    case HEADER_UINT32:
        return v.u32;
    case HEADER_INT64:
        return (double)v.i64;
    case HEADER_UINT64:
        return (double)v.u64;
    case HEADER_FLOAT:
        return (double)v.f;
    default:
        return v.d;
    }
}

void numbers_note_inexact(const unsigned char *bytes, header_type type, char inexact[NUMBERS_INEXACT_SIZE])
{
    int64_t number;
    if (*inexact || (type != HEADER_INT64 && type != HEADER_UINT64)) return;
    memcpy(&number, bytes, sizeof number);
    if (type == HEADER_UINT64 && (uint64_t)number > (uint64_t)PRECISION_WHOLE_MOST)
        snprintf(inexact, NUMBERS_INEXACT_SIZE, "%" PRIu64, (uint64_t)number);
    if (type == HEADER_INT64 && (number > PRECISION_WHOLE_MOST || number < -PRECISION_WHOLE_MOST))
        snprintf(inexact, NUMBERS_INEXACT_SIZE, "%" PRId64, number);
}

void numbers_convert(const unsigned char *bytes, header_type type, bool swapped, int64_t count,
                     double *values, char inexact[NUMBERS_INEXACT_SIZE])
{
    const int size = types[type].bytes;
    for (int64_t k = 0; k < count; k++, bytes += size) {
        unsigned char one[8];
        for (int b = 0; b < size; b++) one[b] = bytes[swapped ? size - 1 - b : b];
        numbers_note_inexact(one, type, inexact);
        values[k] = numbers_value(one, type);
    }
}
