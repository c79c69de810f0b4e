// SPDX-License-Identifier: Apache-2.0
/* exr_stack: a stack of OpenEXR images as a dense volume.
 *
 * The data windows of the slices span the volume; pixels outside of a slice's window are 0. Every slice is
 * examined when the stack is opened, so that one message can name all missing or damaged slices.
 */
#ifndef HEXAD_IO_VOLUMES_EXR_STACK_H
#define HEXAD_IO_VOLUMES_EXR_STACK_H

#include "io/volumes/slices.h"
#include "geometry/space/vec3.h"

typedef struct exr_stack_params {
    size_t count;
    const char *const *paths;   /* of the slices; owned by the caller, must outlive the stack */
    const int *numbers;         /* of the slices, for messages */
    const char *part, *channel; /* NULL: the only one */
    bool has_voxel_size;        /* voxel_size was given; it also replaces the size in the files */
    vec3 voxel_size, origin;    /* pixel (x, y) of slice k lies at origin + voxel_size (x, y, k) */
    const char *program;        /* program that decodes; NULL: this one */
    size_t memory_limit;        /* of its process */
    const slices_files *files;  /* must outlive the stack */
} exr_stack_params;

/* Errors: input_missing and input_damaged, with all slices concerned; input_unsupported, grid_missing,
 * grid_ambiguous, limit_memory; those of the opener. */
slices *exr_stack_open(const exr_stack_params *params, error *e);

/* The parts and channels of the first image, as a text (exr_reader.h) that the caller frees; independent of
 * the requested part and channel. Errors: input_damaged, those of the opener. */
char *exr_stack_list(const exr_stack_params *params, error *e);

#endif
