// SPDX-License-Identifier: Apache-2.0
#include "base/core/ulid.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/random.h>

static const char alphabet[] = ULID_ALPHABET;

void ulid_make(int64_t wall_ms, char text[ULID_SIZE])
{
    unsigned char random[10];
    if (getrandom(random, sizeof random, 0) != sizeof random) {
        /* getrandom never returns less for up to 256 bytes, so this kernel has no getrandom */
        fputs("hexad: no random numbers\n", stderr);
        abort();
    }
    unsigned __int128 value = (unsigned __int128)((uint64_t)wall_ms & 0xFFFFFFFFFFFF) << 80;
    for (size_t i = 0; i < sizeof random; i++) value |= (unsigned __int128)random[i] << (8 * i);
    for (int i = ULID_SIZE - 2; i >= 0; i--, value >>= 5) text[i] = alphabet[(unsigned)value & 31];
    text[ULID_SIZE - 1] = '\0';
}

int64_t ulid_time_ms(const char *text)
{
    int64_t value = 0;
    for (int i = 0; i < 10; i++) value = value << 5 | (strchr(alphabet, text[i]) - alphabet);
    return value;
}

bool ulid_is_valid(const char *text)
{
    return strspn(text, alphabet) == ULID_SIZE - 1 && text[ULID_SIZE - 1] == '\0' && text[0] <= '7';
}
