/* upright: which axis points up in pictures and scenes of a result. */
#ifndef HEXAD_RUN_UPRIGHT_H
#define HEXAD_RUN_UPRIGHT_H

#include <stdbool.h>

#include "formats/points.h"
#include "spec/spec.h"

/* Whether that is y, and not z: as the spec or the kind of file says. Of files that are saved either way (spec_up_is_told)
 * the one of the two axes along which the surface stands on a flat base, where the other has none. */
bool upright_y(const spec *s, const points *set);

#endif
