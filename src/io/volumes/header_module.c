/* header.h's process for a program that loads the libraries only there. */
#include "io/volumes/header.h"

#include <stdio.h>
#include <string.h>

#include "base/core/module.h"

int header_reader_main(int argc, char **argv)
{
    error e = {0};
    int (*reader)(int, char **) =
        (int (*)(int, char **))module_symbol(HEADER_MODULE, "header_reader_main", &e);
    if (reader) return reader(argc, argv);
    header h = {.magic = HEADER_MAGIC, .code = ERROR_INTERNAL, .text_length = (uint32_t)strlen(e.message)};
    bool written = fwrite(&h, sizeof h, 1, stdout) == 1 && fwrite(e.message, h.text_length, 1, stdout) == 1;
    return written && fflush(stdout) == 0 ? 0 : 1;
}
