/* zarr_reader.h for a program that loads the reader only in the process that reads. */
#include "io/volumes/zarr_reader.h"

#include <string.h>

#include "base/core/module.h"
#include "base/core/reader.h"

int zarr_reader_main(int argc, char **argv)
{
    error e = {0};
    int (*program)(int, char **) =
        (int (*)(int, char **))module_symbol(ZARR_READER_MODULE, "zarr_reader_main", &e);
    if (program) return program(argc, argv);
    const size_t length = strnlen(e.message, ZARR_READER_TEXT_MAX);
    const zarr_answer a = {
        .magic = ZARR_READER_MAGIC, .code = ERROR_INTERNAL, .text_length = (uint32_t)length};
    return reader_write(&a, sizeof a) && reader_write(e.message, length) ? 0 : 1;
}
