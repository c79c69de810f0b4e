// SPDX-License-Identifier: Apache-2.0
/* label_thinness: which labels are too thin for a regular packing of points: layers, threads and specks of
 * one voxel.
 */
#ifndef HEXAD_SURFACE_LABELS_LABEL_THINNESS_H
#define HEXAD_SURFACE_LABELS_LABEL_THINNESS_H

#include "base/core/threads.h"
#include "base/json/json.h"
#include "surface/labels/label_volume.h"

/* Sets `thin` and `rows` of all materials. Requires the voxels. */
void label_thinness_find(label_volume *v, threads *pool);

/* At least half of the voxels of the material are thin; label_thinness_is_row: at least half are single or in
 * rows. False for the background. */
bool label_thinness_is_thin(const label_material *m);
bool label_thinness_is_row(const label_material *m);

/* Adds a warning that lists the thin labels, the first few if there are many. */
void label_thinness_warn(const label_volume *v, json *warnings);

#endif
