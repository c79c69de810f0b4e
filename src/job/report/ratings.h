// SPDX-License-Identifier: Apache-2.0
/* ratings: how regular the packing of a result is, in words.
 *
 * Ratings are shown; they decide no outcome. doc/report.md has the same table for readers.
 */
#ifndef HEXAD_JOB_REPORT_RATINGS_H
#define HEXAD_JOB_REPORT_RATINGS_H

#include "base/json/json.h"
#include "sampling/measures/measures.h"

/* Adds the member `ratings`: the measures of packing, or with blue noise the measures that it bounds, each
 * with its value and its rating. A measure without a value has the rating null. */
void ratings_describe(const measures *m, bool is_blue_noise, json *report);

#endif
