/* content_end: where what a mesh file declares ends, for the formats whose readers do not look at what follows. Runs in the
 * process that reads. */
#ifndef HEXAD_MESHFILE_CONTENT_END_H
#define HEXAD_MESHFILE_CONTENT_END_H

#include <stdbool.h>
#include <stddef.h>

/* For a file whose name has this ending, in lower case: bytes up to the end of its solids (STL), elements (PLY) or faces (OFF).
 * `size` where that end is not known. */
size_t content_end(const char *ending, const char *data, size_t size);

/* Whether the bytes from `end` on contain anything but white space and zeros. */
bool content_follows(const char *data, size_t size, size_t end);

#endif
