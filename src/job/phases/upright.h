// SPDX-License-Identifier: Apache-2.0
/* upright: the axis that points up in pictures and scenes of a result. */
#ifndef HEXAD_JOB_PHASES_UPRIGHT_H
#define HEXAD_JOB_PHASES_UPRIGHT_H

#include <stdbool.h>

#include "io/points/points.h"
#include "spec/spec.h"

/* Whether y points up, not z, as the spec or the kind of file determines. For kinds of file with no
 * convention (spec_up_is_certain): the axis along which the surface has a flat base, if only one of y and
 * z has. */
bool upright_y(const spec *s, const points *set);

#endif
