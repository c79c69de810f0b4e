// SPDX-License-Identifier: Apache-2.0
/* frame_check: checks the specs of all frames of a sequence that has values by frame, without reading each
 * of them completely.
 *
 * Private to src/spec. The values of a frame are inserted into the document of the previous frame, and only
 * what they change is read again: for a member of a surface, this member; for any other member, the whole
 * spec except its surfaces and the queue.
 */
#ifndef HEXAD_SPEC_FRAME_CHECK_H
#define HEXAD_SPEC_FRAME_CHECK_H

#include "base/json/json.h"
#include "spec/frame_values.h"
#include "spec/spec.h"

/* Checks each frame except the first, whose spec is `first`. `w`: the values of the document. Returns the
 * number of faults of the first frame that has any, and adds them with their places in queue.by_frame.
 * `first` is changed: afterwards it can only be freed with spec_free. */
size_t frame_check_all(spec *first, const json *document, const frame_values *w, spec_faults *faults);

#endif
