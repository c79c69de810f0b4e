// SPDX-License-Identifier: Apache-2.0
#include "io/points/npz.h"

#include <endian.h>
#include <errno.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <minizip/zip.h>

#include "base/core/memory.h"
#include "io/points/property.h"

/* Numbers converted at a time; bytes of the header of an array; bytes of it before the text. */
enum { BLOCK = 4096, HEADER = 128, PREAMBLE = 10 };

/* ---- the file, which the caller has opened and closes */

static voidpf open_file(voidpf opaque, const void *name, int mode)
{
    (void)name, (void)mode;
    return opaque;
}

static int close_file(voidpf opaque, voidpf stream)
{
    (void)opaque, (void)stream;
    return 0;
}

static zlib_filefunc64_def functions_of(FILE *file)
{
    zlib_filefunc64_def functions; /* the library's own, but for these two */
    fill_fopen64_filefunc(&functions);
    functions.zopen64_file = open_file;
    functions.zclose_file = close_file;
    functions.opaque = file;
    return functions;
}

/* ---- arrays */

/* The header of a .npy file, version 1.0. */
static void describe(const property *p, size_t rows, char header[HEADER])
{
    char shape[48];
    if (p->components > 1)
        snprintf(shape, sizeof shape, "%zu, %d", rows, p->components);
    else
        snprintf(shape, sizeof shape, "%zu,", rows);
    memset(header, ' ', HEADER);
    memcpy(header, "\x93NUMPY\x01\x00", 8);
    header[8] = HEADER - PREAMBLE;
    header[9] = 0;
    int n =
        snprintf(header + PREAMBLE, HEADER - PREAMBLE,
                 "{'descr': '%s', 'fortran_order': False, 'shape': (%s), }", p->whole ? "<i8" : "<f8", shape);
    header[PREAMBLE + n] = ' ';
    header[HEADER - 1] = '\n';
}

/* Packs `count` numbers from index `first`, in order of points. */
static void pack(const property *p, size_t first, size_t count, uint64_t *out)
{
    const size_t n = (size_t)p->components;
    for (size_t k = 0; k < count; k++) {
        double value = property_value(p, (first + k) / n, (int)((first + k) % n));
        int64_t whole = (int64_t)value;
        if (p->whole)
            memcpy(&out[k], &whole, sizeof whole);
        else
            memcpy(&out[k], &value, sizeof value);
        out[k] = htole64(out[k]);
    }
}

/* Calls `act` for each block of the numbers of an array, until one call fails. */
static bool for_each_block(const property *p, size_t rows, void *archive,
                           bool (*act)(void *archive, const void *bytes, size_t size))
{
    uint64_t block[BLOCK];
    bool good = true;
    size_t all = rows * (size_t)p->components;
    for (size_t first = 0; good && first < all; first += BLOCK) {
        size_t count = all - first < BLOCK ? all - first : BLOCK;
        pack(p, first, count, block);
        good = act(archive, block, count * sizeof *block);
    }
    return good;
}

static bool write_block(void *archive, const void *bytes, size_t size)
{
    return zipWriteInFileInZip(archive, bytes, (unsigned)size) == ZIP_OK;
}

static bool write_array(zipFile archive, const property *p, size_t rows)
{
    static const zip_fileinfo no_date = {.tmz_date = {.tm_mday = 1, .tm_year = 1980}};
    char name[80], header[HEADER];
    size_t bytes = rows * (size_t)p->components * sizeof(uint64_t) + HEADER;
    snprintf(name, sizeof name, "%s.npy", p->name);
    describe(p, rows, header);
    return zipOpenNewFileInZip64(archive, name, &no_date, NULL, 0, NULL, 0, NULL, 0, 0,
                                 bytes >= UINT32_MAX) == ZIP_OK &&
           write_block(archive, header, HEADER) && for_each_block(p, rows, archive, write_block) &&
           zipCloseFileInZip(archive) == ZIP_OK;
}

bool npz_write(FILE *file, const points *set, const scene *place, error *e)
{
    zlib_filefunc64_def functions = functions_of(file);
    property *list = mem_alloc((PROPERTIES_OWN + set->attribute_count) * sizeof *list);
    size_t count = property_list(set, list);
    (void)place;
    zipFile archive = zipOpen2_64("points.npz", APPEND_STATUS_CREATE, NULL, &functions);
    bool good = archive != NULL;
    for (size_t k = 0; good && k < count; k++) good = write_array(archive, &list[k], set->count);
    if (archive && zipClose(archive, NULL) != ZIP_OK) good = false;
    good = good && fflush(file) == 0;
    free(list);
    return good || error_set(e, error_code_of_errno(errno), "cannot write the NPZ file: %s", strerror(errno));
}
