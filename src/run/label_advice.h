/* label_advice: what to do about labels that are too thin for points on them to be in order. */
#ifndef HEXAD_RUN_LABEL_ADVICE_H
#define HEXAD_RUN_LABEL_ADVICE_H

#include "json/json.h"
#include "labels/label_surface.h"
#include "spec/spec.h"

/* Appends the item `thin_labels`, if there are such: which groups leave their voxels to labels that they touch; or that
 * there is nothing to do. */
void label_advice_append(json *list, const spec_labels *s, const label_surface *labels);

/* Appends the item `ragged_labels`, where points that are `spacing` apart cannot show what most labels are in places, and these are larger
 * than what it takes to even that out: a majority, or a wider one. */
void label_advice_append_majority(json *list, const spec_labels *s, const label_surface *labels,
                                  double spacing);

/* Whether few counts bring the points to order: all labels but one are voxels alone, or in rows. */
bool label_advice_is_hopeless(const label_surface *labels);

#endif
