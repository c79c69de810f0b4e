// SPDX-License-Identifier: Apache-2.0
/* tree: opens files below a directory without following links, and computes one hash of the opened files.
 *
 * The hash is the SHA-256 of a list with a line for each file, sorted by path. A line is the SHA-256 of the
 * file, two blanks and the path below the directory, as sha256sum prints it. One thread at a time may call.
 */
#ifndef HEXAD_FILES_TREE_H
#define HEXAD_FILES_TREE_H

#include <stdbool.h>

#include "files/file.h"

typedef struct store_tree store_tree;

/* Takes over the descriptor of the directory. If `hashes` is true, each file is hashed when it is first
 * opened. Otherwise the hash of store_tree_facts is undefined. Never returns NULL. */
store_tree *store_tree_new(int directory, bool hashes);
void store_tree_free(store_tree *t); /* accepts NULL */

/* Opens a regular file for reading (close-on-exec). Returns its descriptor, or -1. *is_missing is true if the
 * path does not exist; then *e is not set. Otherwise *e is path_forbidden (a link, or a path that leads out),
 * input_missing (the file cannot be read) or input_unsupported (not a regular file). The messages begin with
 * the path. */
int store_tree_open(store_tree *t, const char *path, bool *is_missing, error *e);

/* The hash of all opened files and their total length in bytes. *has_changed: a file had changed or was
 * replaced when it was opened again. */
void store_tree_facts(store_tree *t, store_facts *out, bool *has_changed);

#endif
