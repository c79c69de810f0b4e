// SPDX-License-Identifier: Apache-2.0
/* json_copy: copies a JSON text of any length and replaces the value of one member, in constant memory.
 *
 * Only strings and brackets are recognised. The copy of a text that is not JSON is not JSON, either. No
 * state; any thread.
 */
#ifndef HEXAD_BASE_JSON_JSON_COPY_H
#define HEXAD_BASE_JSON_JSON_COPY_H

#include <stdbool.h>
#include <stddef.h>
#include <stdio.h>

/* Copies `from`, from its current position to its end. The values of the members named `key` of the outermost
 * object are replaced by `value`, a JSON text; *replaced is their number. A name with escapes (\u0061) is not
 * recognised. False if a stream fails or the brackets do not match; the output is then incomplete. */
bool json_copy_replacing(FILE *from, const char *key, const char *value, FILE *to, size_t *replaced);

#endif
