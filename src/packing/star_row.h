/* star_row: the lanes of star_lanes as vectors, for functions marked ISA_CLONES. */
#ifndef HEXAD_PACKING_STAR_ROW_H
#define HEXAD_PACKING_STAR_ROW_H

#include <stdint.h>

#include "packing/star_lanes.h"

/* A number or a yes (all bits) of each lane. */
typedef double row __attribute__((vector_size(8 * STAR_LANES), aligned(8), may_alias));
typedef int64_t mask __attribute__((vector_size(8 * STAR_LANES), aligned(8), may_alias));

/* Lane by lane a where `which` is set, else b; vectors, or a number for all. (No functions: vectors are not handed over alike with and
 * without AVX.) */
#define CHOOSE(which, a, b) ((row)(((mask)(a) & (which)) | ((mask)(b) & ~(which))))
#define ALL(number) ((row){0} + (number))

#endif
