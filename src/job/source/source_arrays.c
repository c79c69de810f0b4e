// SPDX-License-Identifier: Apache-2.0
#include "job/source/source_arrays.h"

#include <string.h>

const source_array *source_arrays_find(const source_arrays *all, const char *name)
{
    for (size_t k = 0; all && name && k < all->count; k++)
        if (strcmp(all->item[k].name, name) == 0) return &all->item[k];
    return NULL;
}

bool source_array_check(const source_array *a, source_array_kind kind, error *e)
{
    static const char *const names[] = {[SOURCE_ARRAY_MESH] = "mesh",
                                        [SOURCE_ARRAY_GRID] = "dense grid",
                                        [SOURCE_ARRAY_POINTS] = "set of points"};
    return a->kind == kind ||
           error_set(e, ERROR_SPEC_INVALID, "%s: the array is a %s, and the spec requires a %s here", a->name,
                     names[a->kind], names[kind]);
}
