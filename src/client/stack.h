// SPDX-License-Identifier: Apache-2.0
/* stack: the points of many results in one NumPy archive, one row of each array for each result.
 *
 * Each result has a file points.ply with the same number of points and the same properties. The archive has
 * `positions` and `normals` of shape (results, points, 3), each other property under its own name with
 * shape (results, points), `frames`, and `names` and `missing` as texts. The points lie in a temporary file
 * beside the archive until they are written, so the memory does not grow with their number. One thread.
 */
#ifndef HEXAD_CLIENT_STACK_H
#define HEXAD_CLIENT_STACK_H

#include <stdbool.h>
#include <stdio.h>

#include "base/core/error.h"

typedef struct stack stack;

/* `path`: of the archive. NULL and an error: its directory cannot be written. */
stack *stack_begin(const char *path, error *e);
void stack_free(stack *s); /* accepts NULL */

/* Adds the points of a PLY file. `name`: the name of the frame's file, or its number. Error: the file is not a binary
 * PLY file of hexad, or has another number of points or other properties than the first one. */
bool stack_add(stack *s, FILE *ply, const char *name, int frame, error *e);

/* Notes a result that is missing. */
void stack_add_missing(stack *s, const char *name);

/* Whether the rows of two results have different values of the property `id`, so that row k is not the same point
 * in each. */
bool stack_ids_differ(stack *s);

/* Writes the archive, unless nothing was added. */
bool stack_write(stack *s, error *e);

#endif
