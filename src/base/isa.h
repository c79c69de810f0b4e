/* isa: the instruction sets that each numerical kernel is compiled for, from one source. All give the same bits, since
 * sums have one fixed order; only the time differs. */
#ifndef HEXAD_BASE_ISA_H
#define HEXAD_BASE_ISA_H

#include <stdbool.h>

#include "base/words.h"

#define ISA_LIST(ENTRY, prefix)         \
    ENTRY(prefix, PORTABLE, "portable") \
    ENTRY(prefix, AVX2, "avx2")         \
    ENTRY(prefix, AVX512, "avx512")

typedef enum isa { ISA_LIST(WORDS_ENUMERATOR, ISA) ISA_COUNT } isa;

isa isa_best(void); /* the best of this machine */
bool isa_available(isa which);
const char *isa_name(isa which); /* "portable", "avx2", "avx512" */

/* How a kernel's versions are marked; on other machines they are all the portable one. */
#ifdef __x86_64__
#define ISA_TARGET_AVX2 __attribute__((target("avx2")))
#define ISA_TARGET_AVX512 __attribute__((target("avx512f,avx512dq,avx512vl,prefer-vector-width=512")))
#else
#define ISA_TARGET_AVX2
#define ISA_TARGET_AVX512
#endif
/* A function in versions of which the loader takes the best: for what nobody has to choose. _OF_128: for what needs no more than 128
 * bits. With AVX-512, GCC 12 moves these by whole registers and leaves the upper parts full, for which later code without AVX waits. A
 * test looks for such. */
#ifdef __x86_64__
#define ISA_CLONES __attribute__((target_clones("default", "avx2", "avx512f")))
#define ISA_CLONES_OF_128 __attribute__((target_clones("default", "avx2")))
#else
#define ISA_CLONES
#define ISA_CLONES_OF_128
#endif
#define ISA_INLINE static inline __attribute__((always_inline))

#endif
