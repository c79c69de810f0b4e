/* scene: how a point set stands, and of which sequence it is a frame. */
#ifndef HEXAD_FORMATS_SCENE_H
#define HEXAD_FORMATS_SCENE_H

#include <stdbool.h>
#include <stddef.h>

#include "geometry/vec3.h"

typedef struct scene {
    bool y_up; /* which axis of the set points up, y or z */
    vec3
        origin; /* glTF and USD hold positions minus this as floats, and this, in doubles, as a translation */
    size_t frame_count; /* of the sequence; 0: the set is a frame of none, and the rest is unused */
    int frame;
    const int *frames;    /* ascending */
    char *const *folders; /* where each frame's files are, relative to those of this one: "." or "../7" */
} scene;

#endif
