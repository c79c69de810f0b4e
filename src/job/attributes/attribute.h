// SPDX-License-Identifier: Apache-2.0
/* attribute: evaluates values of grids, dense volumes and meshes of files at points.
 *
 * There are two steps. attribute_find checks, before the computation, whether a file has the requested
 * attribute. attribute_read computes the values once the points are known. World space; the space of a file
 * differs if transforms move the surface. One request at a time.
 */
#ifndef HEXAD_JOB_ATTRIBUTES_ATTRIBUTE_H
#define HEXAD_JOB_ATTRIBUTES_ATTRIBUTE_H

#include "job/attributes/stencil.h"
#include "base/core/error.h"
#include "io/volumes/exr_stack.h"
#include "io/points/points.h"

/* The last mesh that was read, for consecutive requests: reading takes longer than evaluating. Initially
 * empty; attribute_forget empties it. */
typedef struct attribute_mesh attribute_mesh;

/* The requested attribute and its file. Texts are owned by the caller. */
typedef struct attribute_request {
    int fd;           /* open for reading, at any offset; owned by the caller; -1 for a stack */
    const char *path; /* for messages; for meshes it determines the format */
    const char *name; /* NULL: all values at a position */
    bool has_kind;    /* otherwise the file determines it */
    point_attribute_kind kind;
    stencil_kind stencil;
    double from_file[3][4]; /* space of the file to world space */
    size_t memory_limit;
    const slices_files *files;          /* opens files that a header names */
    const exr_stack_params *stack;      /* the images of a stack; `name` is their channel; or NULL */
    uint64_t image_pixels, image_scans; /* limits of an image of a mesh (io/images/image_decode.h) */
    bool is_of_surface;     /* the surface is made from the file and has the warnings of its reader */
    bool is_sent;           /* the file was uploaded: no other file lies beside it */
    const vec3 *voxel_size; /* of a dense volume; replaces the size in the file; or NULL */
    attribute_mesh **last;
    const double *spacing; /* for attribute_read: requested spacing of each point */
} attribute_request;

/* Points outside get the background of a grid, or the last sample of a dense volume. */
typedef struct attribute_counts {
    size_t outside;          /* number of points without data at their position */
    size_t far;              /* number of points farther than their spacing from a mesh */
    size_t not_finite;       /* number of points whose value is not finite and was replaced by 0 */
    dense_warnings warnings; /* of the file; and of materials and images of a mesh */
} attribute_counts;

/* Determines the kind and number of values without reading them. Errors, with the file: attribute_missing
 * (with the attributes of the file), and those of the reader. */
bool attribute_find(const attribute_request *request, point_attribute_kind *kind, int *components, error *e);

void attribute_forget(attribute_mesh **last);

/* Computes the values at `count` positions, `components` values each. */
bool attribute_read(const attribute_request *request, size_t count, const vec3 *position, double *values,
                    attribute_counts *counts, error *e);

#endif
