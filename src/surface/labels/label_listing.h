// SPDX-License-Identifier: Apache-2.0
/* label_listing: lists the labels of a segmentation: the number of voxels of each, their bounding box, and
 * the labels that they touch. */
#ifndef HEXAD_SURFACE_LABELS_LABEL_LISTING_H
#define HEXAD_SURFACE_LABELS_LABEL_LISTING_H

#include "base/json/json.h"
#include "surface/labels/label_volume.h"

enum { LABEL_LISTING_MOST = 1000 }; /* maximum number of labels in a listing */

/* Whether whole numbers are probably labels and not measurements: there are few different values, most voxels
 * have a neighbour of the same value, and so do the voxels of most labels. */
bool label_listing_suits(const label_volume *v);

/* Appends one object {label, voxels, low, high, neighbours} per label. Voxels with a common face are
 * neighbours. Errors: limit_memory. */
bool label_listing_describe(const label_volume *v, json *list, error *e);

#endif
