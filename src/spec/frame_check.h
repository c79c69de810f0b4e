// SPDX-License-Identifier: Apache-2.0
/* frame_check: checks the specs of all frames of a sequence that has values by frame, without reading each as
 * a whole.
 *
 * Private to src/spec. A frame's values are put into the document of the frame before, and only what they
 * change is read again: a member of a surface by itself; with any other member, all of the spec but its
 * surfaces and the queue.
 */
#ifndef HEXAD_SPEC_FRAME_CHECK_H
#define HEXAD_SPEC_FRAME_CHECK_H

#include "base/json/json.h"
#include "spec/frame_values.h"
#include "spec/spec.h"

/* Checks each frame but the first, whose spec is `first`; `w` are the values of the document. Returns the
 * number of faults of the first frame that has any, and notes them with their places in queue.by_frame.
 * `first` is changed: it is good for spec_free only. */
size_t frame_check_all(spec *first, const json *document, const frame_values *w, spec_faults *faults);

#endif
