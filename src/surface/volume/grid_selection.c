// SPDX-License-Identifier: Apache-2.0
#include "surface/volume/grid_selection.h"

#include <stdio.h>
#include <string.h>

#include "io/vdb/plain_vdb.h"

/* Maximum length of the list in a message. */
#define LIST_SIZE 600

/* Number of grids with the name, and the index of `index` among them. */
static size_t equals(const vdb_listing *l, size_t index, size_t *place)
{
    size_t count = 0;
    for (size_t i = 0; i < l->count; i++) {
        if (strcmp(l->entries[i].name, l->entries[index].name) != 0) continue;
        if (i == index) *place = count;
        count++;
    }
    return count;
}

void grid_selection_name(const vdb_listing *l, size_t index, char out[VDB_NAME_SIZE])
{
    size_t place = 0;
    /* the name is truncated so that the digits fit */
    if (equals(l, index, &place) > 1)
        snprintf(out, VDB_NAME_SIZE, "%.*s[%zu]", VDB_NAME_SIZE - 24, l->entries[index].name, place);
    else
        snprintf(out, VDB_NAME_SIZE, "%s", l->entries[index].name);
}

/* `"density" (float), "vel" (vec3s)`; the number of grids that do not fit follows. */
static void describe(const vdb_listing *l, bool scalars_only, char out[LIST_SIZE])
{
    size_t used = 0, left_out = 0;
    out[0] = '\0';
    for (size_t i = 0; i < l->count; i++) {
        if (scalars_only && !l->entries[i].scalar) continue;
        if (left_out) {
            left_out++;
            continue;
        }
        char name[VDB_NAME_SIZE], item[VDB_NAME_SIZE + VDB_TYPE_SIZE + 16];
        grid_selection_name(l, i, name);
        int n = snprintf(item, sizeof item, "%s\"%s\" (%s)", used ? ", " : "", name, l->entries[i].type);
        if (used + (size_t)n >= LIST_SIZE - 32) {
            left_out = 1;
            continue;
        }
        memcpy(out + used, item, (size_t)n + 1);
        used += (size_t)n;
    }
    if (left_out) snprintf(out + used, LIST_SIZE - used, " and %zu more", left_out);
}

static bool only_scalar(const vdb_listing *l, size_t *index, error *e)
{
    char list[LIST_SIZE];
    size_t scalars = 0;
    for (size_t i = 0; i < l->count; i++)
        if (l->entries[i].scalar) {
            if (scalars++ == 0) *index = i;
        }
    if (scalars == 1) return true;
    describe(l, scalars > 0, list);
    if (l->count == 0) return error_set(e, ERROR_GRID_MISSING, "the file has no grid: give another file");
    if (scalars == 0)
        return error_set(e, ERROR_INPUT_UNSUPPORTED,
                         "the file has no scalar grid (float or double); it has %s: give another file", list);
    return error_set(e, ERROR_GRID_AMBIGUOUS, "the file has %zu scalar grids: choose one of %s", scalars,
                     list);
}

static bool by_name(const vdb_listing *l, const char *request, size_t *index, error *e)
{
    char list[LIST_SIZE], name[VDB_NAME_SIZE];
    size_t place;
    for (size_t i = 0; i < l->count; i++) {
        if (strcmp(l->entries[i].name, request) != 0) continue;
        *index = i;
        size_t count = equals(l, i, &place);
        if (count == 1) return true;
        describe(l, false, list);
        return error_set(
            e, ERROR_GRID_AMBIGUOUS,
            "the file has %zu grids named \"%s\": choose one by \"%s[0]\" to \"%s[%zu]\", in the "
            "order of the file (it has %s)",
            count, request, request, request, count - 1, list);
    }
    for (size_t i = 0; i < l->count; i++) {
        grid_selection_name(l, i, name);
        if (strcmp(name, request) != 0) continue;
        *index = i;
        return true;
    }
    describe(l, false, list);
    if (l->count == 0)
        return error_set(e, ERROR_GRID_MISSING,
                         "the file has no grid \"%s\" and no other grid: give another file", request);
    return error_set(e, ERROR_GRID_MISSING, "the file has no grid \"%s\": choose one of %s", request, list);
}

bool grid_selection_find(const vdb_listing *listing, const char *request, size_t *index,
                         char unique[VDB_NAME_SIZE], error *e)
{
    size_t found = 0;
    if (!(request ? by_name(listing, request, &found, e) : only_scalar(listing, &found, e))) return false;
    const vdb_entry *entry = &listing->entries[found];
    if (!entry->scalar)
        return error_set(e, ERROR_INPUT_UNSUPPORTED,
                         "grid \"%s\" has values of type %s: choose a float or double grid", request,
                         entry->type);
    grid_selection_name(listing, found, unique);
    *index = found;
    return true;
}

bool grid_selection_find_numeric(const vdb_listing *listing, const char *request, size_t *index, error *e)
{
    bool ok = request ? by_name(listing, request, index, e) : only_scalar(listing, index, e);
    if (!ok && e && e->code == ERROR_GRID_MISSING) e->code = ERROR_ATTRIBUTE_MISSING;
    if (!ok || listing->entries[*index].numeric) return ok;
    return error_set(e, ERROR_INPUT_UNSUPPORTED,
                     "grid \"%s\" has values of type %s: choose a grid of numbers or vectors",
                     listing->entries[*index].name, listing->entries[*index].type);
}

bool grid_selection_find_in_file(int fd, const char *request, size_t *index, vdb_class *grid_class,
                                 char unique[VDB_NAME_SIZE], error *e)
{
    vdb_listing listing;
    if (!plain_vdb_list_grids(fd, &listing) && !vdb_list_grids(fd, &listing, e)) return false;
    bool ok = grid_selection_find(&listing, request, index, unique, e);
    if (ok) *grid_class = listing.entries[*index].grid_class;
    vdb_listing_free(&listing);
    return ok;
}
