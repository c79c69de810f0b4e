/* attribute: values that points take over from files: at each point, what a grid, a dense volume or a mesh has there.
 *
 * Two steps: attribute_find checks whether a file has the requested attribute, before anything is computed; attribute_read
 * fills in the values once the points are known. World space; a file lies in a space of its own where the surface
 * is moved by transforms. Threads: one request at a time.
 */
#ifndef HEXAD_ATTRIBUTE_ATTRIBUTE_H
#define HEXAD_ATTRIBUTE_ATTRIBUTE_H

#include "attribute/stencil.h"
#include "base/error.h"
#include "dense/exr_stack.h"
#include "formats/points.h"

/* The mesh that was read last, which requests after one another share: it takes longer to be read than to be looked up.
 * Begins empty; attribute_forget empties it. */
typedef struct attribute_mesh attribute_mesh;

/* The requested attribute, and its file. Texts are the caller's. */
typedef struct attribute_request {
    int fd;           /* open for reading, at any offset; stays the caller's; -1 of a stack */
    const char *path; /* for messages and, of meshes, for the format */
    const char *name; /* NULL: all that there is at a place */
    bool has_kind;    /* otherwise the file says */
    point_attribute_kind kind;
    stencil_kind stencil;
    double from_file[3][4]; /* the file's space to the world */
    size_t memory_limit;
    const slices_files *files;     /* opens files that a header names */
    const exr_stack_params *stack; /* the images of a stack, whose channel `name` is; or NULL */
    const vec3 *voxel_size;        /* of a dense volume, in the place of the file's; or NULL */
    attribute_mesh **last;
} attribute_request;

/* Where there is nothing: the background of a grid, the last sample of a dense volume. */
typedef struct attribute_counts {
    size_t outside;          /* points where there is nothing */
    size_t not_finite;       /* points whose value is not finite and replaced by 0 */
    dense_warnings warnings; /* of a dense volume */
} attribute_counts;

/* What values there are, without reading them. Errors: attribute_missing, which names what the file holds, and
 * those of its reader; each names the file. */
bool attribute_find(const attribute_request *request, point_attribute_kind *kind, int *components, error *e);

void attribute_forget(attribute_mesh **last);

/* The values at `count` places, `components` each. */
bool attribute_read(const attribute_request *request, size_t count, const vec3 *position, double *values,
                    attribute_counts *counts, error *e);

#endif
