// SPDX-License-Identifier: Apache-2.0
/* group: reads the groups of a spec, objects of members, into struct spec and the normalised document.
 *
 * Private to src/spec.
 */
#ifndef HEXAD_SPEC_GROUP_H
#define HEXAD_SPEC_GROUP_H

#include "base/json/json.h"
#include "spec/reading.h"
#include "spec/spec_table.h"

/* Reads the members of a group ("" is the whole spec). If `at` has no node, the group is treated as an
 * object without members. */
void group_read(reading *r, const json_at *at, const char *group, json *normal);

/* Reads one member of a group, or its default. */
void group_read_row(reading *r, const json_at *group, const spec_row *row, json *normal);

/* Reads a member's default, a JSON text. */
void group_read_default(reading *r, const spec_row *row, const char *otherwise, json *normal);

#endif
