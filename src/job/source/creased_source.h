// SPDX-License-Identifier: Apache-2.0
/* creased_source: the surface of a spec as smooth patches that meet in its sharp edges. */
#ifndef HEXAD_JOB_SOURCE_CREASED_SOURCE_H
#define HEXAD_JOB_SOURCE_CREASED_SOURCE_H

#include "surface/field/creased.h"
#include "job/source/source.h"

/* `part`: the whole surface, opened. `inside`: the surface of the region, if the region is bounded by a
 * surface. Both, and the spec, outlive the result. Errors: those of creased_new; not_supported (too many
 * smooth pieces, or an open surface in a combination). */
creased *creased_source_open(const spec *s, const source_part *part, const source_part *inside, error *e);

#endif
