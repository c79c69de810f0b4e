/* schema: the JSON Schema (2020-12) of a job's spec, made of the table of parameters.
 *
 * It says what a member may be by itself, and which of them go together; what depends on values elsewhere (a torus'
 * minor radius below its major one, members of one method) is left to spec_parse, so that a document that fits
 * may still be refused, and one that does not fit always is. Any thread.
 */
#ifndef HEXAD_SPEC_SCHEMA_H
#define HEXAD_SPEC_SCHEMA_H

#include "json/json.h"

json *schema_new(void);

/* Of one member of it, by its pointer, which must be there. */
json *schema_new_member(const char *pointer);

#endif
