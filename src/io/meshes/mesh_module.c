/* mesh_reader.h for a program that loads the reader only in the process that reads. */
#include "io/meshes/mesh_reader.h"

#include <stdio.h>
#include <string.h>

#include "base/core/module.h"

int mesh_reader_main(int argc, char **argv)
{
    error e = {0};
    int (*reader)(int, char **) =
        (int (*)(int, char **))module_symbol(MESH_READER_MODULE, "mesh_reader_main", &e);
    if (reader) return reader(argc, argv);
    size_t length = strlen(e.message);
    mesh_reader_header h = {.magic = MESH_READER_MAGIC, .code = ERROR_INTERNAL};
    h.text_length = (uint32_t)(length < MESH_READER_TEXT_MAX ? length : MESH_READER_TEXT_MAX);
    bool written = fwrite(&h, sizeof h, 1, stdout) == 1 && fwrite(e.message, h.text_length, 1, stdout) == 1;
    return written && fflush(stdout) == 0 ? 0 : 1;
}
