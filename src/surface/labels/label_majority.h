// SPDX-License-Identifier: Apache-2.0
/* label_majority: gives each voxel the label of the majority of the voxels around it; each label keeps its
 * volume.
 *
 * Slices that were segmented by hand do not match, and single voxels are wrong. This is noise of several
 * voxels, which label_smoothing does not remove, since it keeps the label of each voxel. Here the indicator
 * function of each label is smoothed by a Gaussian of equal width along each axis of the world and multiplied
 * by a weight of the label (Meyer and others 2008, without weights; label_weights). A voxel gets the label
 * with the largest product; on a tie it keeps its own. Thus a ball keeps its radius, and a flat side its
 * position. Thin parts of a label shrink or vanish, and the other labels grow. A speck with a radius below
 * the width vanishes.
 */
#ifndef HEXAD_SURFACE_LABELS_LABEL_MAJORITY_H
#define HEXAD_SURFACE_LABELS_LABEL_MAJORITY_H

#include "base/core/threads.h"
#include "surface/labels/label_volume.h"

/* `width`: the standard deviation, in units of the smallest side of a voxel; 0: the volume is unchanged. The
 * layer around a closed volume is unchanged and has no influence. Recounts the voxels and boxes of the
 * materials. Sets `changed` of the volume to the number of voxels whose label has changed. The result does
 * not depend on the number of threads. Errors, after which the voxels are unchanged: limit_memory (the
 * voxels, the working memory of each thread and 18 bytes for each voxel that may get one of several labels
 * exceed `memory_limit`). */
bool label_majority_apply(label_volume *v, double width, size_t memory_limit, threads *pool, error *e);

#endif
