// SPDX-License-Identifier: Apache-2.0
#include "io/volumes/numbers.h"

#include <inttypes.h>
#include <stdio.h>

#include "base/core/precision.h"

const char *numbers_name(number_type type)
{
    static const char *const names[NUMBER_TYPES] = {"int8",   "uint8", "int16",  "uint16", "int32",
                                                    "uint32", "int64", "uint64", "float",  "double"};
    return names[type];
}

bool numbers_need_doubles(number_type type)
{
    return number_bytes(type) >= 4 && type != NUMBER_FLOAT;
}

void numbers_note_inexact(const unsigned char *bytes, number_type type, bool swapped,
                          char inexact[NUMBERS_INEXACT_SIZE])
{
    if (*inexact || (type != NUMBER_INT64 && type != NUMBER_UINT64)) return;
    const int64_t number = (int64_t)number_bits(bytes, sizeof number, swapped);
    if (type == NUMBER_UINT64 && (uint64_t)number > (uint64_t)PRECISION_WHOLE_MOST)
        snprintf(inexact, NUMBERS_INEXACT_SIZE, "%" PRIu64, (uint64_t)number);
    if (type == NUMBER_INT64 && (number > PRECISION_WHOLE_MOST || number < -PRECISION_WHOLE_MOST))
        snprintf(inexact, NUMBERS_INEXACT_SIZE, "%" PRId64, number);
}

void numbers_convert(const unsigned char *bytes, number_type type, bool swapped, int64_t count,
                     double *values, char inexact[NUMBERS_INEXACT_SIZE])
{
    const size_t size = number_bytes(type);
    for (int64_t k = 0; k < count; k++, bytes += size) {
        numbers_note_inexact(bytes, type, swapped, inexact);
        values[k] = number_value(bytes, type, swapped);
    }
}
