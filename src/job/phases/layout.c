// SPDX-License-Identifier: Apache-2.0
#include "job/phases/layout.h"

#include <stdlib.h>
#include <string.h>

#include "base/core/compare.h"
#include "base/core/frames.h"
#include "base/core/memory.h"

/* The relative path from a folder up to its root, "../../". */
static char *way_up(const char *path)
{
    size_t folders = 0;
    for (const char *at = path; *at;) {
        size_t length = strcspn(at, "/");
        folders += length > 0;
        at += length + (at[length] == '/');
    }
    char *up = mem_alloc(3 * folders + 1);
    for (size_t k = 0; k < folders; k++) memcpy(up + 3 * k, "../", 3);
    up[3 * folders] = '\0';
    return up;
}

static bool can_be_quoted(const char *folder)
{
    if (strstr(folder, "@@@")) return false;
    for (const char *c = folder; *c; c++)
        if ((unsigned char)*c < ' ') return false;
    return true;
}

bool layout_make(const char *pattern, const int *frames, size_t count, int frame, layout *out, error *e)
{
    const char *part = pattern ? pattern + frames_shared(pattern) : "%d";
    char *up = way_up(part);
    layout l = {count, mem_alloc(count * sizeof *l.frames), mem_alloc(count * sizeof *l.folders),
                mem_alloc(count * sizeof *l.below)};
    memcpy(l.frames, frames, count * sizeof *frames);
    qsort(l.frames, count, sizeof *l.frames, compare_ints);
    for (size_t k = 0; k < count; k++) {
        char *folder = frames_path(part, l.frames[k]);
        l.folders[k] = l.frames[k] == frame ? mem_strdup(".") : mem_printf("%s%s", up, folder);
        l.below[k] = mem_printf("./%s", folder);
        free(folder);
    }
    free(up);
    *out = l;
    return !pattern || can_be_quoted(part) ||
           error_set(e, ERROR_SPEC_INVALID,
                     "/output/directory: a USD stage cannot contain the folder names \"%s\" of the "
                     "frames: rename them",
                     part);
}

void layout_free(layout *l)
{
    for (size_t k = 0; k < l->count; k++) {
        free(l->folders[k]);
        free(l->below[k]);
    }
    free(l->folders);
    free(l->below);
    free(l->frames);
    *l = (layout){0};
}
