// SPDX-License-Identifier: Apache-2.0
/* points.ply: ply_read. What is accepted, and has no column beside those of a set's arrays, is written, and
 * must be read as the same again. */
#include <string.h>

#include "io/points/ply.h"
#include "fuzz/target.h"

static bool is_whole(const ply_file *f)
{
    bool whole = true;
    for (size_t c = 0; c < f->columns.count; c++)
        whole &= f->columns.list[c].values != NULL || f->columns.list[c].whole != NULL;
    return whole;
}

static void write_again(const ply_file *f)
{
    error e = {0};
    char *text = NULL;
    size_t length = 0;
    ply_file again;
    threads *alone = threads_new(1, NULL, &e);
    FILE *stream = open_memstream(&text, &length);
    expect(alone && stream);
    expect(ply_write(stream, &f->points, &f->columns, f->format, f->precision, NULL, alone, &e));
    fclose(stream);
    stream = fmemopen(text, length, "rb");
    expect(stream);
    expect(ply_read(stream, &again, &e));
    expect(again.points.count == f->points.count && again.format == f->format &&
           again.precision == f->precision);
    ply_file_free(&again);
    fclose(stream);
    free(text);
    threads_free(alone);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    error e = {0};
    ply_file f;
    if (size == 0) return 0; /* not for fmemopen */
    FILE *stream = fmemopen((void *)data, size, "rb");
    expect(stream);
    if (ply_read(stream, &f, &e)) {
        if (is_whole(&f)) write_again(&f);
        ply_file_free(&f);
    } else {
        expect(e.code == ERROR_INPUT_DAMAGED && *e.message);
    }
    fclose(stream);
    return 0;
}
