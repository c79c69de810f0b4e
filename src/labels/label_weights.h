/* label_weights: how much the smoothed indicator of each label counts, so that each label keeps its number of voxels.
 *
 * Smoothing takes from what bends outwards or is thin, and gives to what is around it. Where a voxel goes to the label whose
 * indicator times a weight is the largest, a weight for each label undoes that: threshold dynamics with volumes that are kept
 * (Jacobs, Merkurjev and Esedoglu 2018, "Auction dynamics"), with factors instead of prices, so that thin parts gain, too.
 */
#ifndef HEXAD_LABELS_LABEL_WEIGHTS_H
#define HEXAD_LABELS_LABEL_WEIGHTS_H

#include <stddef.h>
#include <stdint.h>

#include "base/error.h"
#include "base/threads.h"

/* The labels that may get a voxel, the likeliest first, and their indicators there over that one's, in 1/65535. Labels
 * whose indicator is less than 1 / LABEL_WEIGHTS_RATIO of the largest never win, since no weight is LABEL_WEIGHTS_RATIO
 * times another. */
enum { LABEL_RIVALS = 4, LABEL_WEIGHTS_RATIO = 16 };

typedef struct label_contest {
    uint16_t place;                                    /* of the voxel, for the caller */
    uint16_t label[LABEL_RIVALS], share[LABEL_RIVALS]; /* 0: no more */
} label_contest;

typedef struct label_contests {
    label_contest *at;
    size_t count;
} label_contests;

/* Returns which of its rivals gets a voxel: of equals the first. */
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

/* For a label: the voxels that it has, and how many of the listed voxels it is to win. */
typedef struct label_wish {
    int64_t voxels, wanted;
} label_wish;

/* Weights for which each label has its voxels but for a thousandth, or as nearly as rounds come (a layer of voxels
 * between two labels may be won as a whole or not at all), into weight[]: within 1 / 4 .. 4, so that what is too thin
 * gets too few. The same for any number of threads. Errors: limit_memory. */
bool label_weights_find(const label_contests *list, size_t lists, const label_wish *wish, size_t labels,
                        threads *pool, float *weight, error *e);
size_t label_weights_bytes(size_t labels, size_t workers); /* what it takes, weight[] and wish[] */

#endif
