/* config_edit: adds a value to a list setting in the text of a settings file, and removes it again. All other bytes
 * stay, and remove undoes add byte for byte.
 */
#ifndef HEXAD_CONFIG_CONFIG_EDIT_H
#define HEXAD_CONFIG_CONFIG_EDIT_H

/* The text with a new line `key = value`: behind the last line that has the key or its commented default, otherwise at
 * the end. To be freed. */
char *config_edit_add(const char *text, const char *key, const char *value);

/* The text without the value in lines of the key. A line without a further value is removed. Values in continuation
 * lines (which begin with a blank) and in front of comments are not found. To be freed. */
char *config_edit_remove(const char *text, const char *key, const char *value);

#endif
