// SPDX-License-Identifier: Apache-2.0
/* label_volume: a segmentation: each voxel has a label. The labels that a job distinguishes are its
 * materials.
 *
 * Ownership: label_volume_free. Not synchronised; concurrent reads are permitted.
 */
#ifndef HEXAD_SURFACE_LABELS_LABEL_VOLUME_H
#define HEXAD_SURFACE_LABELS_LABEL_VOLUME_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/core/error.h"
#include "io/volumes/slices.h"
#include "spec/spec.h"

enum { LABEL_VOLUME_MOST = 65535 }; /* the maximum number of labels */

typedef struct label_material {
    int64_t value;
    bool background;
    /* listed in the report: not the background, and part of a chosen interface if interfaces are chosen */
    bool asked;
    /* the number of voxels in the file; after label_majority, the number that results from it */
    uint64_t voxels;
    uint64_t before; /* after label_majority: the number of voxels in the file; otherwise 0 */
    /* thin: number of voxels that are in no block of 2 x 2 x 2 voxels of the material. rows: the number of
     * these that are in no square of 2 x 2 voxels (label_thinness) */
    uint64_t thin, rows;
    /* the bounding box of the voxels, in voxels of the file; low > high: no voxels */
    int64_t low[3], high[3];
} label_material;

typedef struct label_volume {
    int64_t size[3];             /* in voxels, including the layer around a closed volume */
    int64_t around;              /* thickness of this layer, in voxels: 1 or 0 */
    double index_to_world[3][4]; /* from indices of `at` to world positions */
    uint16_t *at;                /* the material of each voxel, x fastest */
    uint64_t changed;            /* number of voxels whose label label_majority changed */
    size_t count;
    label_material *material; /* ascending values, the background last: normals point to the later one */
} label_volume;

/* `memory_limit`: the maximum memory of *out, in bytes. Errors: input_unsupported (values that are not whole
 * numbers, or too many different values), spec_invalid (a chosen label does not occur), limit_memory, those
 * of the slices. Messages do not contain the path. */
bool label_volume_read(slices *from, const spec_labels *choice, size_t memory_limit, label_volume *out,
                       error *e);
void label_volume_free(label_volume *v); /* accepts a zeroed object */
size_t label_volume_bytes(const label_volume *v);

/* The sides of a voxel, in world units. Returns the smallest. */
double label_volume_sides(const label_volume *v, double side[3]);

/* Removes all voxels from the count and the box. */
static inline void label_material_clear(label_material *m)
{
    m->voxels = 0;
    for (int k = 0; k < 3; k++) {
        m->low[k] = INT64_MAX;
        m->high[k] = -1;
    }
}

/* Adds a voxel to the count and the box. */
static inline void label_material_note(label_material *m, const int64_t at[3])
{
    m->voxels++;
    for (int k = 0; k < 3; k++) {
        if (at[k] < m->low[k]) m->low[k] = at[k];
        if (at[k] > m->high[k]) m->high[k] = at[k];
    }
}

static inline uint16_t label_volume_at(const label_volume *v, int64_t x, int64_t y, int64_t z)
{
    return v->at[(z * v->size[1] + y) * v->size[0] + x];
}

#endif
