// SPDX-License-Identifier: Apache-2.0
/* rules: what holds between the members of one group: known names, "exactly one of", and relations between
 * values. spec/relations.h has what holds between groups. Private to src/spec. */
#ifndef HEXAD_SPEC_RULES_H
#define HEXAD_SPEC_RULES_H

#include "base/json/json.h"
#include "spec/reading.h"

/* Notes unknown members of the object, and too many or too few of those that exclude each other. Returns the
 * choices of which more than one member is given, a bit for each: these members may be stored in one
 * place, and must not be read. */
unsigned rules_check_names(reading *r, const json_at *at, const char *group);

/* Notes values of the group that contradict each other. Called only when each value is good by itself. */
void rules_check_group(reading *r, const json_at *at, const char *group);

/* Notes that a camera's up, given or by default, gives no upright picture. `at` is the group of the
 * camera. */
void rules_check_up(reading *r, const json_at *at, const spec_camera *c);

/* What /output/label_meshes requires, within its group and beyond. */
#define RULES_LABEL_MESHES "requires mesh: true, and surface.labels"

#endif
