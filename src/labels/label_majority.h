/* label_majority: each voxel gets the label that most of the voxels around it have, and each label keeps its volume.
 *
 * Slices that were segmented by hand do not fit to each other, and single voxels are strays: that is noise of several
 * voxels, which label_smoothing does not take out, since it keeps each voxel where it is. Here a voxel gets the label
 * whose indicator function, smoothed by a Gaussian that is as wide along each axis of the world, is the largest, times a
 * weight of the label (Meyer and others 2008 without; label_weights); its own where two are alike. So a ball keeps its
 * radius, and a flat side its place. Thin parts of a label shrink or are lost, and the others grow; a
 * speck with a radius below the width is lost.
 */
#ifndef HEXAD_LABELS_LABEL_MAJORITY_H
#define HEXAD_LABELS_LABEL_MAJORITY_H

#include "base/threads.h"
#include "labels/label_volume.h"

/* `width`: the standard deviation, in voxels along their smallest side; 0: nothing is done. The layer around a volume
 * that is closed stays, and counts for nothing. Voxels and boxes of materials are counted anew; `changed` of the volume
 * is the number of voxels whose label has changed. The same for any number of threads. Errors, after which the voxels
 * are as before: limit_memory (voxels, what each thread works on and 18 bytes of each voxel that two labels may get
 * exceed `memory_limit`). */
bool label_majority_apply(label_volume *v, double width, size_t memory_limit, threads *pool, error *e);

#endif
