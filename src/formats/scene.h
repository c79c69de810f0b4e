/* scene: the orientation of a point set, and the sequence of which it is a frame. */
#ifndef HEXAD_FORMATS_SCENE_H
#define HEXAD_FORMATS_SCENE_H

#include <stdbool.h>
#include <stddef.h>

#include "geometry/vec3.h"

typedef struct scene {
    bool y_up; /* y, not z, points up in the set */
    /* glTF and USD have positions minus the origin as floats, and the origin, in doubles, as a translation. */
    vec3 origin;
    /* frames of the sequence; 0: there is no sequence, and the next members are unused */
    size_t frame_count;
    int frame;
    const int *frames;    /* ascending */
    char *const *folders; /* folder of each frame relative to that of this frame: "." or "../7" */
} scene;

#endif
