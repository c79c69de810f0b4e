// SPDX-License-Identifier: Apache-2.0
/* relations: the second phase of reading a spec: defaults and rules that depend on several groups.
 *
 * Neither function does anything if a group has a fault: the values of a group that was not read are not
 * known. They are the only code of src/spec that gives a spec to other functions before it is complete.
 *
 * Private to src/spec.
 */
#ifndef HEXAD_SPEC_RELATIONS_H
#define HEXAD_SPEC_RELATIONS_H

#include "base/json/json.h"
#include "spec/reading.h"

/* Sets the absent members of r->absent to their defaults, in the spec and in the normalised document. */
void relations_set_defaults(reading *r);

/* Notes what contradicts between groups. `root` is the whole document. */
void relations_check(reading *r, const json_at *root);

#endif
