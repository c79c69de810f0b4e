/* foreign_format: files that are not a readable mesh (volumes, and formats of surfaces that hexad does not read), recognised by their first bytes. Threads: none. */
#ifndef HEXAD_MESHFILE_FOREIGN_FORMAT_H
#define HEXAD_MESHFILE_FOREIGN_FORMAT_H

#include <stddef.h>

/* A sentence that names the format of the file and a program that converts it; NULL: the format is none of these, or the one
 * that `ending`, the extension of the file's name, denotes. data[size] is 0. */
const char *foreign_format(const char *ending, const char *data, size_t size);

#endif
