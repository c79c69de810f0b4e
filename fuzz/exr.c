// SPDX-License-Identifier: Apache-2.0
/* An EXR image, as the process that reads them does: the channel's window and pixels, by OpenEXR's C core.
 *
 * That is one program in one file (exr_reader.c), of which the part behind its socket is taken here as it
 * is. */
#include <sys/mman.h>

#include "io/volumes/exr_reader.c"
#include "fuzz/target.h"

/* Far below a job's, so that what a file makes up is seen. */
static const size_t memory = (size_t)16 << 20;

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static const char *const channels[] = {NULL, "R", "Z"};
    int fd = memfd_create("exr", MFD_CLOEXEC);
    expect(fd >= 0 && write(fd, data, size) == (ssize_t)size);
    for (size_t n = 0; n < sizeof channels / sizeof *channels; n++) {
        image m = {.fd = fd, .memory = memory, .channel = channels[n]};
        bool ok = open_image(&m) && read_pixels(&m);
        expect(ok || (m.fault.code != ERROR_NONE && *m.fault.message));
        expect(!ok || (width_of(&m) > 0 && height_of(&m) > 0));
        uint32_t sum = 0; /* every value is there */
        for (int64_t k = 0; ok && k < width_of(&m) * height_of(&m); k++) sum += m.values[k];
        (void)sum;
        free(m.values);
        if (m.file) exr_finish(&m.file);
    }
    close(fd);
    return 0;
}
