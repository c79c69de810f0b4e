// SPDX-License-Identifier: Apache-2.0
#include "service/api/data_set.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"
#include "files/path_map.h"
#include "files/sent_file.h"
#include "service/api/files.h"
#include "service/api/uploads.h"
#include "spec/file_names.h"

/* The input path with the place of a name. The parser requires one. */
static const char *find_place(const spec *s)
{
    spec_input input = {0};
    for (size_t k = 0; spec_input_at(s, k, &input) && !file_names_has_place(input.path);) k++;
    return input.path;
}

/* The name for this machine. Only a name at the beginning of a path can have a prefix that is mapped. */
static char *map_name(const http_context *c, const char *path, const char *name)
{
    bool leads = strncmp(path, FILE_NAMES_PLACE, strlen(FILE_NAMES_PLACE)) == 0;
    char *mapped = leads ? path_map_apply(c->mappings, name) : NULL;
    return mapped ? mapped : mem_strdup(name);
}

/* Checks that the caller may use an uploaded file, and adds it to the list. */
static bool add_sent(const http_context *c, const access_caller *caller, const char *path, const char *name,
                     data_set *set, error *e)
{
    char sent[STORE_INPUT_NAME_SIZE];
    if (!sent_file_match(name, sent)) return true;
    if (strcmp(path, FILE_NAMES_PLACE) != 0)
        return error_set(e, ERROR_SPEC_INVALID,
                         "an uploaded file has no path: write " FILE_NAMES_PLACE
                         " alone as the path of the surface (given %.100s)",
                         path);
    if (!uploads_check(c, caller, name, e)) return false;
    set->sent[set->sent_count++] = mem_strdup(sent);
    return true;
}

static bool take_list(const http_context *c, const access_caller *caller, const spec *s, data_set *set,
                      char pointer[64], error *e)
{
    const char *path = find_place(s);
    set->name = mem_alloc(s->files.count * sizeof *set->name);
    set->sent = mem_alloc(s->files.count * sizeof *set->sent);
    for (size_t i = 0; i < s->files.count; i++) {
        snprintf(pointer, 64, "/queue/files/%zu", i);
        set->name[set->count++] = map_name(c, path, s->files.name[i]);
        if (!add_sent(c, caller, path, set->name[i], set, e)) return false;
    }
    return true;
}

static bool take_pattern(const http_context *c, const spec *s, data_set *set, error *e)
{
    const char *path = find_place(s);
    char *pattern = map_name(c, path, s->files.name[0]);
    bool ok = files_find_names(c, path, pattern, c->max_files, &set->name, &set->count, e);
    free(pattern);
    return ok;
}

bool data_set_find(const http_context *c, const access_caller *caller, const spec *s, data_set *set,
                   char pointer[64], error *e)
{
    *set = (data_set){0};
    snprintf(pointer, 64, "/queue/files");
    if (!s->files.count) return true;
    if (s->files.count > c->max_files)
        return error_set(
            e, ERROR_SPEC_INVALID,
            "there are %zu files, and a job of this service has at most %zu (setting max_files): "
            "submit several jobs",
            s->files.count, c->max_files);
    if (!(s->files.is_pattern ? take_pattern(c, s, set, e) : take_list(c, caller, s, set, pointer, e)))
        return false;
    set->frame = mem_alloc(set->count * sizeof *set->frame);
    for (size_t i = 0; i < set->count; i++) set->frame[i] = (int)i;
    return true;
}

void data_set_clear(data_set *set)
{
    mem_free_texts(set->name, set->count);
    mem_free_texts(set->sent, set->sent_count);
    free(set->frame);
    *set = (data_set){0};
}
