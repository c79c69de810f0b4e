// SPDX-License-Identifier: Apache-2.0
/* frame_values: members of a spec whose values differ by frame (queue.by_frame): the JSON Pointer of each
 * member, with a list of one value for each frame, or with a ramp from a first to a last number.
 *
 * Private to src/spec. frame_values borrow the document from which they were opened.
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
    const json **values; /* one value for each frame; NULL: a ramp */
    double from, to;     /* values at the lowest and at the highest frame number */
} frame_values_member;

typedef struct frame_values {
    const json *document;
    frame_values_member *member;
    size_t count;
    int *frame;
    size_t frame_count;
    int lowest, highest;
} frame_values;

/* Reads the member of a spec and adds its faults. */
void frame_values_read(reading *r, const json_at *at, const spec_row *row, json *normal);

/* Adds a fault for each list whose length is not the number of frames. `at` is the group queue, each of
 * whose members is valid. */
void frame_values_check(reading *r, const json_at *at);

/* Adds a fault for each pointer that refers to no place in the spec. `root`: the document of the spec. */
void frame_values_check_places(reading *r, const json_at *root);

/* Opens the values of a spec's document. False: there are none, or they have faults, which reading the spec
 * reports. The lengths of lists are not checked: if they differ from the number of frames, only the first
 * frame may be read. */
bool frame_values_open(const json *document, frame_values *w);
void frame_values_close(frame_values *w); /* accepts an empty one */

/* The value of a member in the frame number `index`, from 0; the caller frees it. */
json *frame_values_at(const frame_values *w, const frame_values_member *m, size_t index);

/* Inserts the values of a frame into the document. Returns the pointer of the first member that has no place
 * in it; NULL: all have one. */
const char *frame_values_apply(const frame_values *w, size_t index, json *document);

/* A copy of the document of `w` for one frame: its values are at their places, and queue.by_frame is reduced
 * to this frame. */
json *frame_values_document(const frame_values *w, size_t index, const json *document);

/* Moves faults at members with values by frame to the place of the value in queue.by_frame, and faults in an object
 * that only such a value adds to the place of that member. `all`: the number of the frame is added to all other
 * faults. */
void frame_values_place_faults(const frame_values *w, size_t index, bool all, spec_faults *faults);

#endif
