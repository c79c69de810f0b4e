// SPDX-License-Identifier: Apache-2.0
#include "io/meshes/zip_entry.h"

#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <minizip/unzip.h>

/* The archive in memory, for the library's I/O callbacks. */
typedef struct memory {
    const char *data;
    size_t size, at;
} memory;

static voidpf open_memory(voidpf opaque, const void *name, int mode)
{
    (void)name, (void)mode;
    return opaque;
}

static uLong read_memory(voidpf opaque, voidpf stream, void *to, uLong size)
{
    memory *m = stream;
    const size_t left = m->size - m->at, count = size < left ? size : left;
    (void)opaque;
    memcpy(to, m->data + m->at, count);
    m->at += count;
    return count;
}

static uLong write_nothing(voidpf opaque, voidpf stream, const void *from, uLong size)
{
    (void)opaque, (void)stream, (void)from, (void)size;
    return 0;
}

static ZPOS64_T tell_memory(voidpf opaque, voidpf stream)
{
    (void)opaque;
    return ((memory *)stream)->at;
}

static long seek_memory(voidpf opaque, voidpf stream, ZPOS64_T offset, int origin)
{
    memory *m = stream;
    const size_t base = origin == ZLIB_FILEFUNC_SEEK_END   ? m->size
                        : origin == ZLIB_FILEFUNC_SEEK_CUR ? m->at
                                                           : 0;
    (void)opaque;
    if (offset > m->size - base) return -1;
    m->at = base + (size_t)offset;
    return 0;
}

static int close_memory(voidpf opaque, voidpf stream)
{
    (void)opaque, (void)stream;
    return 0;
}

/* Unpacks the open entry. */
static zip_result unpack(unzFile archive, char **out, size_t *length)
{
    unz_file_info64 info;
    if (unzGetCurrentFileInfo64(archive, &info, NULL, 0, NULL, 0, NULL, 0) != UNZ_OK ||
        info.uncompressed_size > SIZE_MAX / 2)
        return ZIP_ENTRY_DAMAGED;
    char *text = malloc((size_t)info.uncompressed_size + 1);
    size_t done = 0;
    if (!text) return ZIP_ENTRY_NO_MEMORY;
    while (done < info.uncompressed_size) {
        const size_t left = (size_t)info.uncompressed_size - done;
        const int got = unzReadCurrentFile(archive, text + done, left < 1 << 20 ? (unsigned)left : 1u << 20);
        if (got <= 0) break;
        done += (size_t)got;
    }
    text[done] = 0;
    const bool is_whole = unzCloseCurrentFile(archive) == UNZ_OK && done == info.uncompressed_size;
    if (!is_whole) {
        free(text);
        return ZIP_ENTRY_DAMAGED;
    }
    *out = text;
    *length = done;
    return ZIP_ENTRY_READ;
}

/* Whether an entry behind the current one has the name. */
static bool is_there_again(unzFile archive, const char *name, zip_names names)
{
    enum { NAME_SIZE = 4096 };
    char other[NAME_SIZE] = ""; /* the library does not end a name that is cut */
    while (unzGoToNextFile(archive) == UNZ_OK)
        if (unzGetCurrentFileInfo64(archive, NULL, other, sizeof other - 1, NULL, 0, NULL, 0) == UNZ_OK &&
            unzStringFileNameCompare(name, other, names) == 0)
            return true;
    return false;
}

zip_result zip_entry_read(const char *archive, size_t size, const char *name, zip_names names, char **out,
                          size_t *length)
{
    memory m = {archive, size, 0};
    zlib_filefunc64_def functions = {open_memory, read_memory,  write_nothing, tell_memory,
                                     seek_memory, close_memory, close_memory,  &m};
    unzFile opened = unzOpen2_64("archive", &functions);
    zip_result result = ZIP_ENTRY_DAMAGED;
    if (!opened) return result;
    if (unzLocateFile(opened, name, names) != UNZ_OK)
        result = ZIP_ENTRY_MISSING;
    else if (unzOpenCurrentFile(opened) == UNZ_OK)
        result = unpack(opened, out, length);
    if (result == ZIP_ENTRY_READ && is_there_again(opened, name, names)) {
        free(*out);
        result = ZIP_ENTRY_TWICE;
    }
    unzClose(opened);
    return result;
}
