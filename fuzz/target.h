// SPDX-License-Identifier: Apache-2.0
/* target: what each program of this folder is made of.
 *
 * A target takes bytes from outside to a function of the project and stops (expect) where the function's
 * contract is broken; crashes, leaks and undefined behaviour are for the sanitizers to see. It is linked with
 * libFuzzer (fuzz/fuzz_NAME, `make fuzz`) and with replay.c (fuzz/replay_NAME), which runs files without
 * clang.
 */
#ifndef HEXAD_FUZZ_TARGET_H
#define HEXAD_FUZZ_TARGET_H

#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>

#ifdef __cplusplus
extern "C"
#endif
    int
    LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

/* An assertion that is there in every build. */
#define expect(what)                                                         \
    do {                                                                     \
        if (what) break;                                                     \
        fprintf(stderr, "%s:%d: expected: %s\n", __FILE__, __LINE__, #what); \
        abort();                                                             \
    } while (0)

#endif
