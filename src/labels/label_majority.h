/* label_majority: each voxel gets the label that most of the voxels around it have.
 *
 * Slices that were segmented by hand do not fit to each other, and single voxels are strays: that is noise of several voxels,
 * which label_smoothing does not take out, since it keeps each voxel where it is. Here a voxel gets the label whose indicator
 * function, smoothed by a Gaussian, is the largest, its own where two are alike (Meyer and others 2008). What is thinner than
 * 1.35 widths, or a rod thinner than 2.35, is lost; a ball's radius becomes smaller by width^2 / radius.
 */
#ifndef HEXAD_LABELS_LABEL_MAJORITY_H
#define HEXAD_LABELS_LABEL_MAJORITY_H

#include "base/threads.h"
#include "labels/label_volume.h"

/* `width`: the standard deviation, in voxels; 0: nothing is done. The layer around a volume that is closed stays, and counts
 * for nothing. Voxels and boxes of materials are counted anew; `changed` of the volume tells how many took another. Errors:
 * limit_memory (both arrays of voxels and what each thread works on exceed `memory_limit`). */
bool label_majority_apply(label_volume *v, double width, size_t memory_limit, threads *pool, error *e);

#endif
