// SPDX-License-Identifier: Apache-2.0
/* instances: the orientations and sizes of the points (output.orient, output.usd.instancer). */
#ifndef HEXAD_JOB_PHASES_INSTANCES_H
#define HEXAD_JOB_PHASES_INSTANCES_H

#include "base/core/error.h"
#include "io/points/points.h"
#include "io/points/scene.h"
#include "spec/spec.h"

typedef struct instances {
    double *orient;        /* see points.orient; NULL: nothing needs it */
    double *scale;         /* see scene_instancer; NULL: there is no instancer */
    scene_instancer scene; /* of the arrays above */
} instances;

/* Whether the attributes that orientations and sizes are to be taken from are there and have a suitable
 * number of components. The values of the set are not used. Errors: attribute_missing, spec_invalid. */
bool instances_check(const spec *s, const points *set, error *e);

/* The instances of a set in the order of the outputs, with attributes. Free also after failure. Error:
 * limit_memory. */
bool instances_make(const spec *s, const points *set, instances *out, error *e);
void instances_free(instances *i);

#endif
