/* tree: files below an open directory, opened without following links, and one hash of those that were opened.
 *
 * The hash is the SHA-256 of a line for each file, sorted by path: its SHA-256, two blanks and its path below the directory, as sha256sum
 * prints them. One caller at a time.
 */
#ifndef HEXAD_STORE_TREE_H
#define HEXAD_STORE_TREE_H

#include <stdbool.h>

#include "store/file.h"

typedef struct store_tree store_tree;

/* Takes over the descriptor of the directory. `hashes`: files are hashed when they are opened for the first time; otherwise the
 * hash of store_tree_facts has no meaning. Never NULL. */
store_tree *store_tree_new(int directory, bool hashes);
void store_tree_free(store_tree *t); /* accepts NULL */

/* Opens a regular file for reading, close-on-exec: its descriptor, or -1. *is_missing: there is none by this path, which is not an error.
 * Otherwise *e: path_forbidden (a link, or a path that leads out), input_missing (it cannot be read), input_unsupported (no regular
 * file); the messages begin with the path. */
int store_tree_open(store_tree *t, const char *path, bool *is_missing, error *e);

/* The hash and the number of bytes of all files that were opened. *has_changed: one of them was another one when it was opened again. */
void store_tree_facts(store_tree *t, store_facts *out, bool *has_changed);

#endif
