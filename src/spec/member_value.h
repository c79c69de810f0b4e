// SPDX-License-Identifier: Apache-2.0
/* member_value: reads the value of a single member: its type, its range, its place in struct spec. Private
 * to src/spec. */
#ifndef HEXAD_SPEC_MEMBER_VALUE_H
#define HEXAD_SPEC_MEMBER_VALUE_H

#include "base/json/json.h"
#include "spec/reading.h"
#include "spec/spec_table.h"

/* Reads the value at this place, which is present, by its row, and puts it into `normal`, the normalised
 * object. A bad value is a fault and is not stored. Not for groups and surfaces, which have members. */
void member_value_read(reading *r, const json_at *at, const spec_row *row, json *normal);

#endif
