// SPDX-License-Identifier: Apache-2.0
/* ply_header: reads the header of a PLY file. Pure functions; any thread. */
#ifndef HEXAD_BASE_CORE_PLY_HEADER_H
#define HEXAD_BASE_CORE_PLY_HEADER_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/core/number.h"

typedef enum ply_layout { PLY_TEXT, PLY_LITTLE, PLY_BIG } ply_layout;

typedef struct ply_type {
    const char *name;
    number_type number;
} ply_type;

enum { PLY_ELEMENTS_MOST = 16, PLY_PROPERTIES_MOST = 256, PLY_NAME_SIZE = 80 };

typedef struct ply_property {
    char name[PLY_NAME_SIZE];
    const ply_type *type, *length; /* length: of the number that begins a list; NULL: no list */
} ply_property;

typedef struct ply_element {
    char name[PLY_NAME_SIZE];
    uint64_t count;
    size_t line; /* offset of its line in the file */
    const ply_property *property;
    int properties;
    bool has_list;
    size_t row; /* bytes of a binary row without its lists */
} ply_element;

typedef struct ply_header {
    ply_layout layout;
    size_t body; /* offset of the data in the file */
    /* if ply_header_read fails: offset of the first line that is not understood, or of the line at which the
     * file ends within the header */
    size_t fault;
    int elements;
    ply_element element[PLY_ELEMENTS_MOST];
    int properties; /* of all elements, one after the other */
    ply_property property[PLY_PROPERTIES_MOST];
} ply_header;

/* Reads the header at the start of a file. The elements point into *out. False: the header has no end, or is
 * not understood; see `fault`. */
bool ply_header_read(const char *data, size_t size, ply_header *out);

#endif
