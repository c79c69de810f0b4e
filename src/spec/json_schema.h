// SPDX-License-Identifier: Apache-2.0
/* json_schema: the JSON Schema (2020-12) of a job's spec, derived from the table of parameters.
 *
 * The schema checks each member alone, and which members exclude each other. Conditions between values (the
 * minor radius of a torus is less than the major one, members of one method) are checked by spec_parse only:
 * a document that violates the schema is always refused, and one that satisfies it may be refused. Any
 * thread may call this.
 */
#ifndef HEXAD_SPEC_JSON_SCHEMA_H
#define HEXAD_SPEC_JSON_SCHEMA_H

#include "base/json/json.h"

typedef enum json_schema_use {
    JSON_SCHEMA_ALONE,   /* a separate document */
    JSON_SCHEMA_SENT,    /* in the OpenAPI document, for requests: defaults are stated in the prose, since
                          * generated clients require members that have a default; surfaces are
                          * #/components/schemas/Surface */
    JSON_SCHEMA_ANSWERED /* in the OpenAPI document, for answers: further members are permitted, since later
                          * versions have more; surfaces are #/components/schemas/AnsweredSurface */
} json_schema_use;

json *json_schema_new(json_schema_use use);

/* The schema of one member of a spec, by its pointer, which must exist. */
json *json_schema_new_member(const char *pointer, json_schema_use use);

#endif
