/* exr_stack: OpenEXR images one upon the other as a dense volume.
 *
 * The slices' data windows span the volume; pixels outside of a slice's own are 0. Every slice is looked at
 * when the stack is opened, so that all that are missing or damaged can be named at once.
 */
#ifndef HEXAD_DENSE_EXR_STACK_H
#define HEXAD_DENSE_EXR_STACK_H

#include "dense/slices.h"
#include "geometry/vec3.h"

typedef struct exr_stack_params {
    size_t count;
    const char *const *paths;   /* of the slices, the caller's, who keeps them as long as the stack lives */
    const int *numbers;         /* that messages call them by */
    const char *part, *channel; /* NULL: the only one */
    bool has_voxel_size;        /* it was given: it counts for files with a size of their own, too */
    vec3 voxel_size, origin;    /* pixel (x, y) of slice k lies at origin + voxel_size (x, y, k) */
    const char *program;        /* that decodes; NULL: this one */
    size_t memory_limit;        /* of its process */
    const slices_files *files;  /* as above */
} exr_stack_params;

/* Errors: input_missing, input_damaged with all the slices concerned; input_unsupported, grid_missing,
 * grid_ambiguous, limit_memory; those of the opener. */
slices *exr_stack_open(const exr_stack_params *params, error *e);

/* The parts and channels of the first image, as a text (exr_reader.h) to be freed; independent of the requested part and
 * channel. Errors: input_damaged, those of the opener. */
char *exr_stack_list(const exr_stack_params *params, error *e);

#endif
