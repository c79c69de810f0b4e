// SPDX-License-Identifier: Apache-2.0
/* label_advice: advice on labels that are too thin for a regular packing on them. */
#ifndef HEXAD_JOB_REPORT_LABEL_ADVICE_H
#define HEXAD_JOB_REPORT_LABEL_ADVICE_H

#include "base/json/json.h"
#include "surface/labels/label_surface.h"
#include "spec/spec.h"

/* Appends the item `thin_labels` if there are thin labels: groups that merge them with adjacent labels, or
 * the statement that nothing can be done. */
void label_advice_append(json *list, const spec_labels *s, const label_surface *labels);

/* Appends the item `ragged_labels` if most labels have places too rough for points at distance `spacing`
 * (world units), and the labels are larger than the majority filter that would smooth them: it recommends
 * a filter, or a wider one. */
void label_advice_append_majority(json *list, const spec_labels *s, const label_surface *labels,
                                  double spacing);

/* Whether hardly any number of points can give a regular packing: all labels but one consist of single voxels
 * or rows of voxels. */
bool label_advice_is_hopeless(const label_surface *labels);

#endif
