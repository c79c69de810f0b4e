// SPDX-License-Identifier: Apache-2.0
/* config_edit: adds a value to a list setting in the text of a settings file, and removes it. All other bytes
 * are unchanged, and removing undoes adding byte by byte. Pure functions.
 */
#ifndef HEXAD_SERVICE_CONFIG_CONFIG_EDIT_H
#define HEXAD_SERVICE_CONFIG_CONFIG_EDIT_H

/* The text with a new line `key = value`: after the last line with the key or its commented default,
 * otherwise at the end. The caller frees it. */
char *config_edit_add(const char *text, const char *key, const char *value);

/* The text without the value in lines of the key. A line without further values is removed. Values in
 * continuation lines (which start with a blank) and before comments are not found. The caller frees it. */
char *config_edit_remove(const char *text, const char *key, const char *value);

#endif
