// SPDX-License-Identifier: Apache-2.0
/* library_text: checks of COLLADA and FBX files that the library assimp does not make: XML that is not
 * valid, counts that the data contradict, text that is not a number, a property that is there twice.
 *
 * Runs in the process that reads. Threads: none.
 */
#ifndef HEXAD_IO_MESHES_LIBRARY_TEXT_H
#define HEXAD_IO_MESHES_LIBRARY_TEXT_H

#include "io/meshes/plain_mesh.h"

/* Moves blanks before numbers in attributes of XML behind the closing quotes: XML Schema ignores them, and the library does
 * not. The size does not change. */
void library_text_move_blanks(char *data);

/* Refuses a file that the library would read in part, or differently from what it states; adds warnings
 * about elements that the library ignores. data[size] is 0. Returns false if *m is refused. */
bool library_text_check(file_format format, const char *data, size_t size, plain_mesh *m);

#endif
