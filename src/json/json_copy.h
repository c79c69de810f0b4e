/* json_copy: copies a JSON text of any length and replaces the value of one member, in constant memory.
 *
 * Only strings and brackets are recognised: the copy of a text that is not JSON is not JSON either. No state; any thread.
 */
#ifndef HEXAD_JSON_JSON_COPY_H
#define HEXAD_JSON_JSON_COPY_H

#include <stdbool.h>
#include <stddef.h>
#include <stdio.h>

/* Copies `from`, from its offset to its end. The values of the outermost object's members named `key` become `value`, a JSON
 * text; *replaced is their number. A name with escapes (\u0061) is not recognised. False when a stream fails or the brackets
 * do not match; what was written is then useless. */
bool json_copy_replacing(FILE *from, const char *key, const char *value, FILE *to, size_t *replaced);

#endif
