// SPDX-License-Identifier: Apache-2.0
/* foreign_format: files that are not a readable mesh (volumes, and formats of surfaces that hexad does not
 * read), recognised by their first bytes or by the ending of their names. Threads: none.
 */
#ifndef HEXAD_IO_MESHES_FOREIGN_FORMAT_H
#define HEXAD_IO_MESHES_FOREIGN_FORMAT_H

#include <stddef.h>

/* A sentence for the message to the user: it names the format of the file, and a program that converts it or
 * the name that it should have. `ending`: the extension of the file's name. NULL: the format is none of
 * these, or it is a format that hexad reads (VTK, GIfTI) under its proper ending; then the message of its
 * reader applies. data[size] is 0. Static storage. */
const char *foreign_format(const char *ending, const char *data, size_t size);

#endif
