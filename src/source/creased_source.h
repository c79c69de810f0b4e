/* creased_source: the surface of a spec as patches that meet in its sharp edges. */
#ifndef HEXAD_SOURCE_CREASED_SOURCE_H
#define HEXAD_SOURCE_CREASED_SOURCE_H

#include "field/creased.h"
#include "source/source.h"

/* `part` is that of the whole surface, opened, `inside` that of its region, where that is one of a surface; they outlive what is
 * made, and so does the spec. Errors: those of creased_new, not_supported for too many smooth pieces, and for an open surface among
 * others. */
creased *creased_source_open(const spec *s, const source_part *part, const source_part *inside, error *e);

#endif
