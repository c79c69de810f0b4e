// SPDX-License-Identifier: Apache-2.0
/* isa: the instruction sets for which each numerical kernel is compiled, from one source. Results are bitwise
 * equal, since sums have a fixed order; only the time differs.
 */
#ifndef HEXAD_BASE_CORE_ISA_H
#define HEXAD_BASE_CORE_ISA_H

#include <stdbool.h>

#include "base/core/words.h"

#define ISA_LIST(ENTRY, prefix)         \
    ENTRY(prefix, PORTABLE, "portable") \
    ENTRY(prefix, AVX2, "avx2")         \
    ENTRY(prefix, AVX512, "avx512")

typedef enum isa { ISA_LIST(WORDS_ENUMERATOR, ISA) ISA_COUNT } isa;

isa isa_best(void); /* the fastest one of this machine */
bool isa_available(isa which);
const char *isa_name(isa which); /* "portable", "avx2", "avx512" */

/* Attributes of the versions of a kernel; on other machines all versions are portable. */
#ifdef __x86_64__
#define ISA_TARGET_AVX2 __attribute__((target("avx2")))
#define ISA_TARGET_AVX512 __attribute__((target("avx512f,avx512dq,avx512vl,prefer-vector-width=512")))
#else
#define ISA_TARGET_AVX2
#define ISA_TARGET_AVX512
#endif
/* Attribute of a function that is compiled for several instruction sets; the loader selects the fastest
 * version. Use it for functions whose instruction set is not a setting. _OF_128: for functions with vectors
 * of at most 128 bits. With AVX-512, GCC 12 moves these in whole registers and leaves the upper parts dirty,
 * which delays later code without AVX. A test finds such functions. ThreadSanitizer's code in the functions that select
 * a version would run before its library is loaded. */
#if defined __x86_64__ && !defined __SANITIZE_THREAD__
#define ISA_CLONES __attribute__((target_clones("default", "avx2", "avx512f")))
#define ISA_CLONES_OF_128 __attribute__((target_clones("default", "avx2")))
#else
#define ISA_CLONES
#define ISA_CLONES_OF_128
#endif
#define ISA_INLINE static inline __attribute__((always_inline))

#endif
