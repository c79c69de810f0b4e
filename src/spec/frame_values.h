// SPDX-License-Identifier: Apache-2.0
/* frame_values: members of a spec that have another value in each frame (queue.by_frame): the JSON Pointer of
 * each, with a list of one value for each frame, or a ramp from a first to a last number.
 *
 * Private to src/spec. They borrow the document that they were opened from.
 */
#ifndef HEXAD_SPEC_FRAME_VALUES_H
#define HEXAD_SPEC_FRAME_VALUES_H

#include <stdbool.h>
#include <stddef.h>

#include "base/json/json.h"
#include "spec/reading.h"
#include "spec/spec_table.h"

typedef struct frame_values_member {
    const char *pointer;
    const json **values; /* one for each frame; NULL: a ramp */
    double from, to;     /* at the lowest and the highest frame number */
} frame_values_member;

typedef struct frame_values {
    frame_values_member *member;
    size_t count;
    int *frame;
    size_t frame_count;
    int lowest, highest;
} frame_values;

/* Reads the member of a spec and notes its faults. */
void frame_values_read(reading *r, const json_at *at, const spec_row *row, json *normal);

/* Notes lists of another length than the frames have. `at` is the group queue, whose members are good by
 * themselves. */
void frame_values_check(reading *r, const json_at *at);

/* Notes members that have no place in the spec, whose document `root` is. */
void frame_values_check_places(reading *r, const json_at *root);

/* Opens those of a spec's document. False: it has none, or they have faults, which reading it will note.
 * Lists may still have another length than the frames: then only the first frame may be read. */
bool frame_values_open(const json *document, frame_values *w);
void frame_values_close(frame_values *w); /* accepts an empty one */

/* The value of a member in the index-th frame, the caller's. */
json *frame_values_at(const frame_values *w, const frame_values_member *m, size_t index);

/* Puts the values of the index-th frame into the document. NULL, or the pointer of the first member
 * without a place. */
const char *frame_values_apply(const frame_values *w, size_t index, json *document);

/* A copy of the document, whose values `w` are, for the index-th frame alone: its values are in their places,
 * and those of other frames are gone. */
json *frame_values_document(const frame_values *w, size_t index, const json *document);

/* Gives faults at members that have values by frame the place in queue.by_frame that the value is from. With
 * `all` the others get the frame's number, too. */
void frame_values_place_faults(const frame_values *w, size_t index, bool all, spec_faults *faults);

#endif
