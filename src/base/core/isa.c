// SPDX-License-Identifier: Apache-2.0
#include "base/core/isa.h"

bool isa_available(isa which)
{
    switch (which) {
#ifdef __x86_64__
    case ISA_AVX2:
        return __builtin_cpu_supports("avx2");
    case ISA_AVX512:
        return __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") &&
               __builtin_cpu_supports("avx512vl");
#endif
    default:
        return which == ISA_PORTABLE;
    }
}

isa isa_best(void)
{
    isa best = ISA_PORTABLE;
    for (isa k = ISA_PORTABLE; k < ISA_COUNT; k++)
        if (isa_available(k)) best = k;
    return best;
}

const char *isa_name(isa which)
{
    static const char *const names[ISA_COUNT] = {ISA_LIST(WORDS_TEXT, )};
    return names[which];
}
