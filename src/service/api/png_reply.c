// SPDX-License-Identifier: Apache-2.0
#include "service/api/png_reply.h"

#include <errno.h>
#include <stdio.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include "io/pictures/picture_png.h"

bool png_reply_set(reply *r, const canvas *picture, error *e)
{
    struct stat info;
    int fd = memfd_create("picture", MFD_CLOEXEC), own = fd >= 0 ? dup(fd) : -1;
    FILE *file = own >= 0 ? fdopen(own, "wb") : NULL;
    bool ok = file || error_set(e, ERROR_INTERNAL, "a file in memory cannot be made: %s", strerror(errno));
    ok = ok && picture_png_write(file, picture, e);
    if (ok && fstat(fd, &info) != 0)
        ok = error_set(e, ERROR_INTERNAL, "the file in memory cannot be examined: %s", strerror(errno));
    if (file)
        fclose(file);
    else if (own >= 0)
        close(own);
    if (ok)
        reply_set_file(r, "image/png", fd, info.st_size);
    else if (fd >= 0)
        close(fd);
    return ok;
}
