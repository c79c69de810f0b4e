// SPDX-License-Identifier: Apache-2.0
#include "io/meshes/zip_entry.h"

#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <minizip/unzip.h>
#include <zlib.h>

#include "base/core/number.h"

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

/* Zeros follow the archive: the library reads whole buffers of an entry whose packed size it does not know (size_of). */
static uLong read_memory(voidpf opaque, voidpf stream, void *to, uLong size)
{
    memory *m = stream;
    const size_t left = m->size - m->at, count = size < left ? size : left;
    (void)opaque;
    memcpy(to, m->data + m->at, count);
    memset((char *)to + count, 0, size - count);
    m->at += count;
    return size;
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
    /* the library passes negative offsets as large ones: sums wrap around */
    const size_t base = origin == ZLIB_FILEFUNC_SEEK_END   ? m->size
                        : origin == ZLIB_FILEFUNC_SEEK_CUR ? m->at
                                                           : 0;
    (void)opaque;
    if (base + (size_t)offset > m->size) return -1;
    m->at = base + (size_t)offset;
    return 0;
}

static int close_memory(voidpf opaque, voidpf stream)
{
    (void)opaque, (void)stream;
    return 0;
}

/* The size of an entry from its ZIP64 field, which minizip 1.1 does not compare with 32 bits of ones. */
static uint64_t size_of(const unz_file_info64 *info, const unsigned char *extra, size_t length)
{
    enum { HEAD = 4, ZIP64 = 1 };
    const size_t known = info->size_file_extra < length ? info->size_file_extra : length;
    if (info->uncompressed_size != UINT32_MAX) return info->uncompressed_size;
    for (size_t at = 0; at + HEAD + sizeof(uint64_t) <= known;) {
        if (number_whole(extra + at, NUMBER_UINT16, NUMBER_LITTLE_SWAPPED) == ZIP64)
            return (uint64_t)number_whole(extra + at + HEAD, NUMBER_INT64, NUMBER_LITTLE_SWAPPED);
        at += HEAD + (size_t)number_whole(extra + at + 2, NUMBER_UINT16, NUMBER_LITTLE_SWAPPED);
    }
    return info->uncompressed_size;
}

/* Unpacks the open entry. */
static zip_result unpack(unzFile archive, char **out, size_t *length)
{
    enum { EXTRA = 256 };
    unz_file_info64 info;
    unsigned char extra[EXTRA];
    if (unzGetCurrentFileInfo64(archive, &info, NULL, 0, extra, sizeof extra, NULL, 0) != UNZ_OK)
        return ZIP_ENTRY_DAMAGED;
    info.uncompressed_size = size_of(&info, extra, sizeof extra);
    if (info.uncompressed_size > SIZE_MAX / 2) return ZIP_ENTRY_DAMAGED;
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
    const bool is_whole = unzCloseCurrentFile(archive) == UNZ_OK && done == info.uncompressed_size &&
                          crc32_z(0, (const unsigned char *)text, done) == info.crc;
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
