// SPDX-License-Identifier: Apache-2.0
/* A TIFF file, as the process that reads them does: its directories and description, and its pages, by
 * libtiff.
 *
 * That process is one source file (tiff_reader.c). The target includes it and calls the functions below
 * its socket. */
#include <math.h>
#include <sys/mman.h>

#include "io/volumes/tiff_reader.c"
#include "fuzz/target.h"

/* Far below a job's, so that what a file makes up is seen. */
static const size_t memory = (size_t)16 << 20;

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    tiff_file f = {.fd = memfd_create("tiff", MFD_CLOEXEC), .memory = memory};
    expect(f.fd >= 0 && write(f.fd, data, size) == (ssize_t)size);
    const bool ok = open_file(&f);
    expect(ok || (f.fault.code != ERROR_NONE && *f.fault.message));
    tiff_answer a = {0};
    if (ok) {
        describe(&f, &a);
        expect(a.pages >= 1 && a.slices >= 1 && a.slices * a.channels * a.frames == a.pages);
        for (int k = 0; k < 3; k++) expect(a.size[k] >= 0 && isfinite(a.size[k]));
    }
    for (int64_t page = 0; ok && page < a.pages && page < 4; page++) {
        unsigned char *numbers = read_page(&f, (uint32_t)page);
        expect(numbers || (f.fault.code != ERROR_NONE && *f.fault.message));
        unsigned sum = 0; /* every number is there */
        const size_t bytes = (size_t)a.width * (size_t)a.height * number_bytes(f.type);
        for (size_t k = 0; numbers && k < bytes; k++) sum += numbers[k];
        (void)sum;
        free(numbers);
        f.fault = (error){0};
    }
    close_file(&f);
    return 0;
}
