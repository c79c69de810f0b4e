// SPDX-License-Identifier: Apache-2.0
#include "service/api/files.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "service/api/job_json.h"
#include "base/core/compare.h"
#include "base/core/file_format.h"
#include "base/core/frames.h"
#include "base/core/memory.h"
#include "base/core/terminal_text.h"
#include "service/http/parameter.h"
#include "spec/file_names.h"

/* The first `most` names of a directory behind `after`, sorted. */
typedef struct names {
    const char *after;
    size_t most, count;
    bool more;
    char **item;
} names;

static void names_add(names *n, const char *name)
{
    size_t at = n->count;
    if (n->after && strcmp(name, n->after) <= 0) return;
    while (at > 0 && strcmp(name, n->item[at - 1]) < 0) at--;
    if (n->count == n->most) {
        n->more = true;
        if (at == n->most) return;
        free(n->item[--n->count]);
    }
    memmove(n->item + at + 1, n->item + at, (n->count - at) * sizeof *n->item);
    n->item[at] = mem_strdup(name);
    n->count++;
}

static void append(json *list, const char *name, const struct stat *info)
{
    json *o = json_append_object(list);
    json_put_string(o, "name", name);
    json_put_bool(o, "directory", S_ISDIR(info->st_mode));
    if (S_ISDIR(info->st_mode))
        json_put_null(o, "bytes");
    else
        json_put_integer(o, "bytes", info->st_size);
    job_json_put_time(o, "modified", (int64_t)info->st_mtim.tv_sec * 1000);
}

/* Adds an entry to the list. The target of a symbolic link is examined only if jobs may read it. */
static void append_found(const http_context *c, int directory, const char *path, const char *name, json *list)
{
    struct stat info;
    if (fstatat(directory, name, &info, AT_SYMLINK_NOFOLLOW) != 0) return;
    if (S_ISLNK(info.st_mode)) {
        char *full = mem_printf("%s/%s", path, name);
        bool found = store_find_input(c->roots, full, &info);
        free(full);
        if (!found) return;
    }
    if (S_ISREG(info.st_mode) || S_ISDIR(info.st_mode)) append(list, name, &info);
}

static void list_roots(const http_context *c, json *document)
{
    json_put_string(document, "path", "");
    json_put_null(document, "parent");
    json *list = json_put_array(document, "files");
    bool directory;
    const char *name;
    struct stat info;
    for (size_t i = 0; (name = store_roots_name(c->roots, i, &directory)); i++)
        if (stat(name, &info) == 0) append(list, name, &info);
    json_put_null(document, "next");
}

/* Adds `parent`: the parent directory; for an input root the list of roots. */
static void put_parent(const http_context *c, const char *path, json *document)
{
    bool directory;
    const char *name, *slash = strrchr(path, '/');
    bool is_root = !slash || slash == path;
    for (size_t i = 0; (name = store_roots_name(c->roots, i, &directory)); i++)
        is_root = is_root || strcmp(name, path) == 0;
    char *above = is_root ? mem_strdup("") : mem_strndup(path, (size_t)(slash - path));
    json_put_string(document, "parent", above);
    free(above);
}

/* Opens a directory below the input roots. Errors: those of store_open_directory; input_missing. */
static DIR *open_listing(const http_context *c, const char *path, error *e)
{
    int fd = store_open_directory(c->roots, path, e);
    DIR *listing = fd < 0 ? NULL : fdopendir(fd);
    if (fd >= 0 && !listing) {
        error_set(e, ERROR_INPUT_MISSING, "%s cannot be read: %s", path, strerror(errno));
        close(fd);
    }
    return listing;
}

void files_list(const http_context *c, const http_request *request, reply *r)
{
    error e = {0};
    const char *path = parameter_text(request, "path", "");
    json *document = json_new_object();
    if (!*path) {
        list_roots(c, document);
        reply_set_json(r, 200, document);
        return;
    }
    DIR *listing = open_listing(c, path, &e);
    if (!listing) {
        reply_set_error(r, &e, NULL);
        json_free(document);
        return;
    }
    names found = {.after = parameter_text(request, "cursor", NULL),
                   .most = (size_t)parameter_integer(request, "limit", 50)};
    found.item = mem_alloc((found.most + 1) * sizeof *found.item);
    for (struct dirent *entry; (entry = readdir(listing));)
        if (entry->d_name[0] != '.' && json_is_text(entry->d_name)) names_add(&found, entry->d_name);
    json_put_string(document, "path", path);
    put_parent(c, path, document);
    json *list = json_put_array(document, "files");
    for (size_t i = 0; i < found.count; i++) append_found(c, dirfd(listing), path, found.item[i], list);
    json_put_string(document, "next", found.more ? found.item[found.count - 1] : NULL);
    closedir(listing);
    mem_free_texts(found.item, found.count);
    reply_set_json(r, 200, document);
}

/* Looks at an entry of a directory. Returns whether to go on. */
typedef bool look_at_entry(const http_context *c, const struct dirent *entry, void *data);

static bool search_directory(const http_context *c, const char *path, look_at_entry *look, void *data,
                             error *e)
{
    DIR *listing = open_listing(c, path, e);
    if (!listing) return false;
    for (struct dirent *entry; (entry = readdir(listing)) && look(c, entry, data);)
        ;
    closedir(listing);
    return true;
}

/* Looks at the entries of a directory, with `look`. A relative path is below one or several of the roots: no error if it is
 * missing there. Otherwise errors as of open_listing. */
static bool search_inputs(const http_context *c, const char *path, look_at_entry *look, void *data, error *e)
{
    bool is_directory;
    const char *root;
    if (*path == '/') return search_directory(c, path, look, data, e);
    for (size_t i = 0; (root = store_roots_name(c->roots, i, &is_directory)); i++) {
        char *directory = mem_printf("%s/%s", root, path);
        if (is_directory) search_directory(c, directory, look, data, NULL);
        free(directory);
    }
    return true;
}

/* ---- frames of a sequence */

/* A path with the place of a frame number, cut at the file or directory whose name has it. */
typedef struct frame_pattern {
    const char *whole;
    char *directory; /* "": the path has none */
    char *name;
    bool in_directory; /* the name is that of a directory on the way to the files */
} frame_pattern;

static frame_pattern cut_pattern(const char *pattern)
{
    size_t first = frames_shared(pattern), length = strcspn(pattern + first, "/");
    return (frame_pattern){.whole = pattern,
                           .directory = mem_strndup(pattern, first),
                           .name = mem_strndup(pattern + first, length),
                           .in_directory = pattern[first + length] == '/'};
}

typedef struct numbers {
    int *item;
    size_t count, capacity;
} numbers;

typedef struct frame_search {
    frame_pattern pattern;
    numbers found; /* up to one more than a job may have */
} frame_search;

/* Whether jobs may read the file of the frame. The kind of the directory's entry suffices for most files. */
static bool is_frame_readable(const http_context *c, const frame_pattern *p, const struct dirent *entry,
                              int frame)
{
    struct stat info;
    if (!p->in_directory && (entry->d_type == DT_REG || entry->d_type == DT_DIR)) return true;
    char *path = frames_path(p->whole, frame);
    bool found = store_find_input(c->roots, path, &info);
    free(path);
    return found;
}

static bool add_frame(const http_context *c, const struct dirent *entry, void *data)
{
    frame_search *s = data;
    numbers *out = &s->found;
    int frame = 0;
    if (entry->d_name[0] == '.' || !frames_match(s->pattern.name, entry->d_name, &frame) ||
        !is_frame_readable(c, &s->pattern, entry, frame))
        return true;
    if (out->count == out->capacity)
        out->item = mem_resize(out->item, (out->capacity = out->capacity * 2 + 64) * sizeof *out->item);
    out->item[out->count++] = frame;
    return out->count <= FRAMES_MOST;
}

static void sort_numbers(numbers *n)
{
    size_t kept = 0;
    if (n->count) qsort(n->item, n->count, sizeof *n->item, compare_ints);
    for (size_t i = 0; i < n->count; i++)
        if (!kept || n->item[kept - 1] != n->item[i]) n->item[kept++] = n->item[i];
    n->count = kept;
}

bool files_find_frames(const http_context *c, const char *pattern, int **frames, size_t *count, error *e)
{
    frame_search s = {.pattern = cut_pattern(pattern)};
    numbers *found = &s.found;
    bool ok = search_inputs(c, s.pattern.directory, add_frame, &s, e);
    sort_numbers(found);
    if (ok && !found->count)
        ok = error_set(e, ERROR_INPUT_MISSING,
                       "no file below the input roots matches %s: check the directory and the name", pattern);
    if (ok && found->count > FRAMES_MOST)
        ok = error_set(e, ERROR_SPEC_INVALID,
                       "more than %d files match %s: write the frame numbers, and submit several jobs",
                       FRAMES_MOST, pattern);
    free(s.pattern.directory);
    free(s.pattern.name);
    if (!ok) {
        free(found->item);
        return false;
    }
    *frames = found->item;
    *count = found->count;
    return true;
}

/* ---- files of a data set */

/* A path with a pattern in the place of a name, cut at the part that has the pattern. */
typedef struct name_pattern {
    const char *path;
    char *directory;      /* "": the path has none */
    char *above;          /* directory of the pattern; begins each name */
    char *before, *after; /* of the pattern, in the same part of the path */
    const char *pattern;  /* its last part */
    bool goes_on;         /* further parts follow */
} name_pattern;

static name_pattern cut_names(const char *path, const char *pattern)
{
    const char *place = strstr(path, FILE_NAMES_PLACE), *rest = place + strlen(FILE_NAMES_PLACE),
               *slash = strrchr(pattern, '/');
    size_t above = slash ? (size_t)(slash + 1 - pattern) : 0, first = (size_t)(place - path),
           after = strcspn(rest, "/");
    if (!above)
        while (first > 0 && path[first - 1] != '/') first--;
    return (name_pattern){.path = path,
                          .directory = above ? mem_printf("%.*s%.*s", (int)first, path, (int)above, pattern)
                                             : mem_strndup(path, first),
                          .above = mem_strndup(pattern, above),
                          .before = mem_strndup(path + first, above ? 0 : (size_t)(place - path) - first),
                          .after = mem_strndup(rest, after),
                          .pattern = pattern + above,
                          .goes_on = rest[after] == '/'};
}

static void name_pattern_clear(name_pattern *p)
{
    free(p->directory);
    free(p->above);
    free(p->before);
    free(p->after);
}

/* The name that the entry of a directory stands for, which the caller frees; NULL: it does not match. */
static char *match_entry(const name_pattern *p, const char *entry)
{
    size_t length = strlen(entry), before = strlen(p->before), after = strlen(p->after);
    if (*entry == '.' || length < before + after || strncmp(entry, p->before, before) != 0 ||
        strcmp(entry + length - after, p->after) != 0 ||
        !file_names_match(p->pattern, entry + before, (int)(length - before - after)))
        return NULL;
    return mem_printf("%s%.*s", p->above, (int)(length - before - after), entry + before);
}

/* Whether jobs may read the file with this name, a regular file or the directory of a volume. The kind of the
 * directory's entry suffices for most files. */
static bool is_file_readable(const http_context *c, const name_pattern *p, const struct dirent *entry,
                             const char *name)
{
    struct stat info;
    if (!p->goes_on && entry->d_type == DT_REG) return true;
    char *path = file_names_path(p->path, name);
    bool good = store_find_input(c->roots, path, &info) &&
                (S_ISREG(info.st_mode) || file_format_of_name(path) == FILE_FORMAT_OME_ZARR);
    free(path);
    return good;
}

typedef struct found_names {
    char **item;
    size_t count, capacity;
} found_names;

typedef struct name_search {
    name_pattern pattern;
    found_names found; /* up to one more than `most` */
    size_t most;
    char *refused; /* the path of a file whose name no spec can have, escaped; NULL: none */
} name_search;

static bool add_name(const http_context *c, const struct dirent *entry, void *data)
{
    name_search *s = data;
    found_names *out = &s->found;
    char *name = match_entry(&s->pattern, entry->d_name);
    if (!name || !is_file_readable(c, &s->pattern, entry, name)) {
        free(name);
        return true;
    }
    if (!json_is_text(name)) {
        char *path = file_names_path(s->pattern.path, name);
        s->refused = terminal_text_new(path);
        free(path);
        free(name);
        return false;
    }
    if (out->count == out->capacity)
        out->item = mem_resize(out->item, (out->capacity = out->capacity * 2 + 64) * sizeof *out->item);
    out->item[out->count++] = name;
    return out->count <= s->most;
}

static int compare_names(const void *a, const void *b)
{
    return strcmp(*(char *const *)a, *(char *const *)b);
}

/* Sorts the names, and removes one that is below several roots. */
static void sort_names(found_names *n)
{
    size_t kept = 0;
    if (n->count) qsort(n->item, n->count, sizeof *n->item, compare_names);
    for (size_t i = 0; i < n->count; i++) {
        if (kept && strcmp(n->item[kept - 1], n->item[i]) == 0)
            free(n->item[i]);
        else
            n->item[kept++] = n->item[i];
    }
    n->count = kept;
}

bool files_find_names(const http_context *c, const char *path, const char *pattern, size_t most, char ***out,
                      size_t *count, error *e)
{
    name_search s = {.pattern = cut_names(path, pattern), .most = most};
    const name_pattern *p = &s.pattern;
    found_names *found = &s.found;
    bool ok = true;
    if (strstr(p->after, FILE_NAMES_PLACE))
        ok = error_set(e, ERROR_SPEC_INVALID,
                       "a pattern and a path with two %s in one part exclude each other (given %s): list the "
                       "files",
                       FILE_NAMES_PLACE, path);
    else
        ok = search_inputs(c, p->directory, add_name, &s, e);
    sort_names(found);
    if (ok && s.refused)
        ok = error_set(e, ERROR_INPUT_UNSUPPORTED,
                       "the name of the file %.700s is not UTF-8: rename the file", s.refused);
    if (ok && !found->count)
        ok = error_set(e, ERROR_INPUT_MISSING,
                       "no file below the input roots matches %s%s%s%s: check the directory and the name",
                       p->directory, p->before, p->pattern, p->after);
    if (ok && found->count > most)
        ok = error_set(e, ERROR_SPEC_INVALID,
                       "more than %zu files match %s, and a job of this service has at most as many (setting "
                       "max_files): submit several jobs",
                       most, pattern);
    name_pattern_clear(&s.pattern);
    free(s.refused);
    if (!ok) {
        mem_free_texts(found->item, found->count);
        return false;
    }
    *out = found->item;
    *count = found->count;
    return true;
}
