// SPDX-License-Identifier: Apache-2.0
/* content_end: finds the end of the content that a mesh file declares, for formats whose readers ignore the
 * bytes after it. Runs in the process that reads.
 */
#ifndef HEXAD_IO_MESHES_CONTENT_END_H
#define HEXAD_IO_MESHES_CONTENT_END_H

#include <stdbool.h>
#include <stddef.h>

/* `ending`: that of the file's name. data[size] is 0. Returns the number of bytes up to the end of the solids (STL),
 * elements (PLY) or faces (OFF); `size` if the end is not known, and for other formats. */
size_t content_end(const char *ending, const char *data, size_t size);

/* Whether the triangles of a binary STL file are followed by as many bytes as their counts of attribute bytes say, and
 * these end where the file ends. */
bool content_has_stl_attributes(const char *data, size_t size);

/* Whether the bytes from `end` on contain anything but white space and zeros. */
bool content_follows(const char *data, size_t size, size_t end);

#endif
