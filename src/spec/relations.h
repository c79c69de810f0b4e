// SPDX-License-Identifier: Apache-2.0
/* relations: the second phase of reading a spec: defaults and rules that depend on several groups.
 *
 * If a group has a fault, the functions do nothing, because its values are unknown. Only this code of
 * src/spec passes the spec to other functions before it is complete.
 *
 * Private to src/spec.
 */
#ifndef HEXAD_SPEC_RELATIONS_H
#define HEXAD_SPEC_RELATIONS_H

#include "base/json/json.h"
#include "spec/reading.h"

/* Sets the absent members of r->absent to their defaults, in the spec and in the normalised document. */
void relations_set_defaults(reading *r);

/* Adds a fault for each contradiction between groups. `root`: the whole document. */
void relations_check(reading *r, const json_at *root);

#endif
