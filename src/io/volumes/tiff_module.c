/* tiff_reader.h for a program that loads the reader only in the process that reads. */
#include "io/volumes/tiff_reader.h"

#include <string.h>

#include "base/core/module.h"
#include "base/core/reader.h"

int tiff_reader_main(int argc, char **argv)
{
    error e = {0};
    int (*program)(int, char **) =
        (int (*)(int, char **))module_symbol(TIFF_READER_MODULE, "tiff_reader_main", &e);
    if (program) return program(argc, argv);
    const size_t length = strnlen(e.message, TIFF_READER_TEXT_MAX);
    const tiff_answer a = {
        .magic = TIFF_READER_MAGIC, .code = ERROR_INTERNAL, .text_length = (uint32_t)length};
    return reader_write(&a, sizeof a) && reader_write(e.message, length) ? 0 : 1;
}
