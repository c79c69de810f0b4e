/* label_volume: a segmentation: each voxel has one of some labels. Those that a job tells apart are its materials.
 *
 * Ownership: label_volume_free. Threads: none of its own; reading is safe in any number.
 */
#ifndef HEXAD_LABELS_LABEL_VOLUME_H
#define HEXAD_LABELS_LABEL_VOLUME_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/error.h"
#include "dense/slices.h"
#include "spec/spec.h"

enum { LABEL_VOLUME_MOST = 65535 }; /* labels */

typedef struct label_material {
    int64_t value;
    bool background;
    bool
        asked; /* listed in the report: not the background, and part of a chosen interface if interfaces are chosen */
    uint64_t voxels; /* in the file, or after label_majority */
    uint64_t before; /* of it, in the file; 0 without */
    uint64_t thin,
        rows; /* of these: in no block of 2 x 2 x 2 of the material; besides in no square (label_thinness) */
    int64_t low[3], high[3]; /* the box of these, in the file's voxels; low > high: there are none */
} label_material;

typedef struct label_volume {
    int64_t size[3];             /* with a layer around it where it is closed */
    int64_t around;              /* voxels of that layer: 1, or 0 */
    double index_to_world[3][4]; /* of voxel (0, 0, 0) of these */
    uint16_t *at;                /* the material of each voxel, x fastest */
    uint64_t changed;            /* voxels, by label_majority */
    size_t count;
    label_material *material; /* ascending values, the background last: normals point to the later one */
} label_volume;

/* `memory_limit` bounds what it holds. Errors: input_unsupported (values that are not whole numbers, or too many),
 * spec_invalid (a label that is chosen and not there), limit_memory, those of the slices; without the path. */
bool label_volume_read(slices *from, const spec_labels *choice, size_t memory_limit, label_volume *out,
                       error *e);
void label_volume_free(label_volume *v); /* a zeroed one will do */
size_t label_volume_bytes(const label_volume *v);

/* The sides of a voxel, in world units. Returns the smallest. */
double label_volume_sides(const label_volume *v, double side[3]);

/* It has no voxels. */
static inline void label_material_clear(label_material *m)
{
    m->voxels = 0;
    for (int k = 0; k < 3; k++) {
        m->low[k] = INT64_MAX;
        m->high[k] = -1;
    }
}

/* It has this voxel, too. */
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
