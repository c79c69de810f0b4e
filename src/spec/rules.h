// SPDX-License-Identifier: Apache-2.0
/* rules: conditions on the members of one group: known names, "exactly one of", and relations between
 * values. spec/relations.h has the conditions between groups. Private to src/spec. */
#ifndef HEXAD_SPEC_RULES_H
#define HEXAD_SPEC_RULES_H

#include "base/json/json.h"
#include "spec/reading.h"
#include "spec/spec_table.h"

enum { RULES_LIST_MAX = 256 }; /* maximum bytes of a list of members in a message */

/* Writes the names of the members of a group, of which `first` is the first one, or where they are listed,
 * if they are too many for a message. */
void rules_list_members(const spec_row *first, char list[RULES_LIST_MAX]);

/* Adds faults for unknown members of the object, and for too many or too few of the members that exclude
 * each other. Returns a bit for each choice of which more than one member is given: these members may be
 * stored in one place, and must not be read. `first` is the first member of the group in the table. */
unsigned rules_check_names(reading *r, const json_at *at, const char *group, const spec_row *first);

/* Adds faults for values of the group that contradict each other. Called only if each value is valid by
 * itself. */
void rules_check_group(reading *r, const json_at *at, const char *group);

/* Adds a fault if a camera's up, given or by default, does not give an upright picture. `at`: the group of
 * the camera. */
void rules_check_up(reading *r, const json_at *at, const spec_camera *c);

/* The requirements of /output/label_meshes. */
#define RULES_LABEL_MESHES "requires mesh: true, and surface.labels"

#endif
