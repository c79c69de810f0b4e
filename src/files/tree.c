// SPDX-License-Identifier: Apache-2.0
#include "files/tree.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/core/memory.h"
#include "files/root.h"

/* A file that was opened. */
typedef struct entry {
    char *path;
    store_facts facts;
    store_identity identity;
} entry;

struct store_tree {
    int directory;
    bool hashes, has_changed;
    entry *entries; /* sorted by path up to `sorted`; the others in the order of opening */
    size_t count, capacity, sorted;
};

store_tree *store_tree_new(int directory, bool hashes)
{
    store_tree *t = mem_alloc(sizeof *t);
    *t = (store_tree){.directory = directory, .hashes = hashes};
    return t;
}

void store_tree_free(store_tree *t)
{
    if (!t) return;
    for (size_t k = 0; k < t->count; k++) free(t->entries[k].path);
    free(t->entries);
    close(t->directory);
    free(t);
}

static int by_path(const void *a, const void *b)
{
    return strcmp(((const entry *)a)->path, ((const entry *)b)->path);
}

/* Callers usually open all files and then open all of them again; by then most entries are sorted. */
static entry *find_entry(store_tree *t, const char *path)
{
    const entry key = {.path = (char *)path};
    entry *found = t->sorted > 0 ? bsearch(&key, t->entries, t->sorted, sizeof *t->entries, by_path) : NULL;
    for (size_t k = t->count; !found && k > t->sorted; k--)
        if (strcmp(t->entries[k - 1].path, path) == 0) found = &t->entries[k - 1];
    return found;
}

/* Bounds the number of unsorted entries, which are searched linearly. */
static void sort_if_many(store_tree *t)
{
    enum { FEW = 256 };
    if (t->count - t->sorted < FEW) return;
    qsort(t->entries, t->count, sizeof *t->entries, by_path);
    t->sorted = t->count;
}

static bool record_file(store_tree *t, const char *path, int fd, error *e)
{
    store_identity identity = {0};
    const bool is_known = store_identify(fd, &identity);
    entry *known = find_entry(t, path);
    if (known) {
        t->has_changed |= !is_known || !store_identity_equals(&known->identity, &identity);
        return true;
    }
    if (t->count == t->capacity) {
        t->capacity = t->capacity ? 2 * t->capacity : 64;
        t->entries = mem_resize(t->entries, t->capacity * sizeof *t->entries);
    }
    entry *added = &t->entries[t->count];
    *added = (entry){.identity = identity};
    t->has_changed |= !is_known;
    added->facts.bytes = identity.bytes;
    if (t->hashes && !store_file_hash(fd, added->facts.sha256, &added->facts.bytes, e)) return false;
    added->path = mem_strdup(path);
    t->count++;
    sort_if_many(t);
    return true;
}

int store_tree_open(store_tree *t, const char *path, bool *is_missing, error *e)
{
    struct stat info;
    *is_missing = false;
    const int fd = *path && *path != '/' ? store_open_walking(t->directory, path) : (errno = EXDEV, -1);
    if (fd < 0) {
        const int why = errno;
        *is_missing = why == ENOENT || why == ENOTDIR;
        if (*is_missing) return -1;
        error_set(e, why == EXDEV || why == ELOOP ? ERROR_PATH_FORBIDDEN : ERROR_INPUT_MISSING,
                  why == EXDEV || why == ELOOP
                      ? "%s is a symbolic link or leads out of the directory: copy the file to its place"
                      : "%s cannot be read: let the user of the service read it",
                  path);
        return -1;
    }
    if (fstat(fd, &info) != 0 || !S_ISREG(info.st_mode)) {
        error_set(e, ERROR_INPUT_UNSUPPORTED, "%s is not a regular file: copy the directory again", path);
        close(fd);
        return -1;
    }
    if (record_file(t, path, fd, e)) return fd;
    close(fd);
    return -1;
}

void store_tree_facts(store_tree *t, store_facts *out, bool *has_changed)
{
    size_t length = 0, capacity = 1;
    qsort(t->entries, t->count, sizeof *t->entries, by_path);
    t->sorted = t->count;
    for (size_t k = 0; k < t->count; k++) capacity += strlen(t->entries[k].path) + STORE_HASH_SIZE + 3;
    char *lines = mem_alloc(capacity);
    out->bytes = 0;
    for (size_t k = 0; k < t->count; k++) {
        length += (size_t)snprintf(lines + length, capacity - length, "%s  %s\n", t->entries[k].facts.sha256,
                                   t->entries[k].path);
        out->bytes += t->entries[k].facts.bytes;
    }
    store_hash(lines, length, out->sha256);
    *has_changed = t->has_changed;
    free(lines);
}
