// SPDX-License-Identifier: Apache-2.0
#include "io/meshes/base64.h"

#include <ctype.h>
#include <stdint.h>

static int digit_of(char c)
{
    if (c >= 'A' && c <= 'Z') return c - 'A';
    if (c >= 'a' && c <= 'z') return c - 'a' + 26;
    if (c >= '0' && c <= '9') return c - '0' + 52;
    return c == '+' ? 62 : c == '/' ? 63 : -1;
}

bool base64_read(const char **at, const char *end, unsigned char *to, size_t count)
{
    const char *from = *at;
    for (size_t done = 0; done < count; done += 3) {
        uint32_t bits = 0;
        for (int k = 0; k < 4;) {
            if (from == end) return false;
            const char c = *from++;
            if (isspace((unsigned char)c)) continue;
            const int digit = c == '=' ? 0 : digit_of(c);
            if (digit < 0) return false;
            bits = bits << 6 | (uint32_t)digit;
            k++;
        }
        for (size_t k = 0; k < 3 && done + k < count; k++)
            to[done + k] = (unsigned char)(bits >> (16 - 8 * k));
    }
    *at = from;
    return true;
}

size_t base64_count(const char *at, const char *end)
{
    size_t digits = 0, padding = 0;
    for (; at < end; at++) {
        digits += !isspace((unsigned char)*at);
        padding += *at == '=';
    }
    const size_t bytes = digits / 4 * 3;
    return padding < bytes ? bytes - padding : 0;
}
