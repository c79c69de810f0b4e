// SPDX-License-Identifier: Apache-2.0
/* zip_entry: reads a file of a ZIP archive in memory, with minizip, which io/points also uses. Threads:
 * none. */
#ifndef HEXAD_IO_MESHES_ZIP_ENTRY_H
#define HEXAD_IO_MESHES_ZIP_ENTRY_H

#include <stdbool.h>
#include <stddef.h>

typedef enum zip_result {
    ZIP_ENTRY_READ,
    ZIP_ENTRY_MISSING,
    ZIP_ENTRY_TWICE, /* the archive has several entries of the name */
    ZIP_ENTRY_DAMAGED,
    ZIP_ENTRY_NO_MEMORY
} zip_result;

/* How names are compared. The values are those of minizip. */
typedef enum zip_names { ZIP_NAMES_EXACT = 1, ZIP_NAMES_ANY_CASE = 2 } zip_names;

/* Unpacks the entry of this name to *out; a byte 0 follows its *length bytes. The caller frees *out after
 * ZIP_ENTRY_READ. */
zip_result zip_entry_read(const char *archive, size_t size, const char *name, zip_names names, char **out,
                          size_t *length);

#endif
