// SPDX-License-Identifier: Apache-2.0
/* scene: the orientation of a point set, and the sequence that it belongs to. */
#ifndef HEXAD_IO_POINTS_SCENE_H
#define HEXAD_IO_POINTS_SCENE_H

#include <stdbool.h>
#include <stddef.h>

#include "geometry/space/vec3.h"

/* In points.usda the points are instances of a prototype. */
typedef struct scene_instancer {
    const char *prototype; /* path of an asset, as the file has it */
    const double *orient;  /* of each point a unit quaternion x y z w */
    const double *scale;   /* per point, along x, y and z of the prototype */
} scene_instancer;

typedef struct scene {
    bool y_up; /* y, not z, points up in the set */
    /* glTF and USD have positions minus the origin as floats, and the origin, in doubles, as a
     * translation. */
    vec3 origin;
    const scene_instancer *instancer; /* instances of the points in USD; or NULL */
    /* frames of the sequence; 0: there is no sequence, and the next members are unused */
    size_t frame_count;
    int frame;
    const int *frames;    /* ascending */
    char *const *folders; /* folder of each frame relative to that of this frame: "." or "../7" */
    char *const *below;   /* folder of each frame relative to the folder that contains all of them: "./7" */
} scene;

#endif
