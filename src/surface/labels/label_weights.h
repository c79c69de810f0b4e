// SPDX-License-Identifier: Apache-2.0
/* label_weights: weights of the smoothed indicators of labels with which each label keeps its number of
 * voxels.
 *
 * Smoothing reduces convex and thin parts of a label and enlarges the labels around them. If a voxel gets the
 * label with the largest product of indicator and weight, a weight per label compensates for this: threshold
 * dynamics with preserved volumes (Jacobs, Merkurjev and Esedoglu 2018, "Auction dynamics"), with factors
 * instead of prices, so that thin parts grow, too.
 */
#ifndef HEXAD_SURFACE_LABELS_LABEL_WEIGHTS_H
#define HEXAD_SURFACE_LABELS_LABEL_WEIGHTS_H

#include <stddef.h>
#include <stdint.h>

#include "base/core/error.h"
#include "base/core/threads.h"

/* LABEL_RIVALS: the maximum number of candidate labels of a voxel. LABEL_WEIGHTS_RATIO: the maximum ratio of
 * two weights. A label whose indicator is less than 1 / LABEL_WEIGHTS_RATIO of the largest cannot win. */
enum { LABEL_RIVALS = 4, LABEL_WEIGHTS_RATIO = 16 };

typedef struct label_contest {
    uint16_t place; /* identifies the voxel; defined by the caller */
    /* the candidate labels of the voxel, largest indicator first, and the ratios of their indicators to the
     * largest, in 1/65535; a share of 0 ends the list */
    uint16_t label[LABEL_RIVALS], share[LABEL_RIVALS];
} label_contest;

typedef struct label_contests {
    label_contest *at;
    size_t count;
} label_contests;

/* Returns the index of the label that gets the voxel; on a tie the first. */
static inline int label_weights_winner(const label_contest *c, const float *weight)
{
    int best = 0;
    float most = 0;
    for (int k = 0; k < LABEL_RIVALS && c->share[k] > 0; k++) {
        const float score = (float)c->share[k] * weight[c->label[k]];
        if (!(score > most)) continue;
        most = score;
        best = k;
    }
    return best;
}

/* The number of voxels of a label, and the number of listed voxels that it should win. */
typedef struct label_wish {
    int64_t voxels, wanted;
} label_wish;

/* Stores in weight[] weights for which each label keeps its number of voxels to within a thousandth. If that
 * is not reached in the available rounds, it stores the weights with the smallest error: a layer of voxels
 * between two labels may be won only as a whole. Weights are within 1/4 .. 4, so that very thin labels may
 * get too few voxels. The result does not depend on the number of threads. Errors: limit_memory. */
bool label_weights_find(const label_contests *list, size_t lists, const label_wish *wish, size_t labels,
                        threads *pool, float *weight, error *e);
/* bytes that label_weights_find uses, including weight[] and wish[] */
size_t label_weights_bytes(size_t labels, size_t workers);

#endif
