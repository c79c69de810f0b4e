/* schema: the JSON Schema (2020-12) of a job's spec, made of the table of parameters.
 *
 * The schema checks each member alone and which members exclude each other. Conditions between values (the minor
 * radius of a torus is less than the major one, members of one method) are checked by spec_parse only: a document
 * that violates the schema is always refused, and one that satisfies it may be refused. Any thread may call this.
 */
#ifndef HEXAD_SPEC_SCHEMA_H
#define HEXAD_SPEC_SCHEMA_H

#include "json/json.h"

json *schema_new(void);

/* Of one member of it, by its pointer, which must be there. */
json *schema_new_member(const char *pointer);

#endif
