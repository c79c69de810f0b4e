/* rules: what holds between the members of a group: known names, "exactly one of", and relations between values.
 * Private to src/spec. */
#ifndef HEXAD_SPEC_RULES_H
#define HEXAD_SPEC_RULES_H

#include "json/json.h"
#include "spec/reading.h"

/* Notes unknown members of the object, and too many or too few of those that exclude each other. Returns the choices of which
 * more than one member is given, a bit for each: these members may be stored in one place, and must not be read. */
unsigned rules_check_names(reading *r, const json_at *at, const char *group);

/* Notes values of the group that contradict each other or those of groups before it. Called only when each value is
 * good by itself. */
void rules_check_values(reading *r, const json_at *at, const char *group);

/* Notes what queue.coherent excludes elsewhere in the spec. `at` is the group queue. */
void rules_check_coherent(reading *r, const json_at *at);

#endif
