// SPDX-License-Identifier: Apache-2.0
/* json_internal: functions shared by the files of src/base/json; private to them. */
#ifndef HEXAD_BASE_JSON_JSON_INTERNAL_H
#define HEXAD_BASE_JSON_JSON_INTERNAL_H

#include <stddef.h>

#include <cjson/cJSON.h>

/* Returns the node. If it is NULL, memory is exhausted and the program ends (see base/core/memory.h). */
cJSON *json_must(cJSON *node);

/* Length of the well-formed UTF-8 sequence at s (Unicode 15, table 3-7); 0 if there is none. */
size_t json_utf8_length(const unsigned char *s, size_t left);

#endif
