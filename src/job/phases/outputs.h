// SPDX-License-Identifier: Apache-2.0
/* outputs: the list of a result's files for the report: {name, bytes, sha256} of each. */
#ifndef HEXAD_JOB_PHASES_OUTPUTS_H
#define HEXAD_JOB_PHASES_OUTPUTS_H

#include "base/core/error.h"
#include "base/json/json.h"
#include "files/file.h"

/* Appends a file; its size and hash are added later (outputs_put_facts). */
json *outputs_add(json *outputs, const char *name);
void outputs_put_facts(json *output, const store_facts *facts);

/* Verifies a written file (store_file_place_verified), appends it to `outputs`, and renames it to its
 * final name. */
bool outputs_commit(store_file *file, const char *name, json *outputs, error *e);

#endif
