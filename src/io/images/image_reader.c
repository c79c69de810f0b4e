// SPDX-License-Identifier: Apache-2.0
#include "io/images/image_reader.h"

#include <stdbool.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/core/error.h"
#include "base/core/reader.h"
#include "base/core/transfer.h"
#include "io/images/image_decode.h"

/* Maximum number of open descriptors: standard ones and the file. */
enum { DESCRIPTORS = STDERR_FILENO + 2 };

/* Receives the bytes of an image. NULL: memory is exhausted, or the socket was closed. */
static unsigned char *receive(size_t size)
{
    unsigned char *data = malloc(size + 1);
    int none;
    for (size_t at = 0, length; data && at < size; at += length) {
        length = size - at < IMAGE_READER_PIECE ? size - at : IMAGE_READER_PIECE;
        if (!reader_receive(data + at, length, &none)) {
            free(data);
            return NULL;
        }
    }
    return data;
}

static unsigned char *read_file(int fd, size_t *size)
{
    struct stat st;
    unsigned char *data = fstat(fd, &st) == 0 ? malloc((size_t)st.st_size + 1) : NULL;
    const int64_t count = data ? transfer_read_at(fd, data, (size_t)st.st_size, 0) : -1;
    *size = count < 0 ? 0 : (size_t)count;
    return data;
}

static bool answer(const char *name, const image_request *request, int file, size_t memory)
{
    error e = {0};
    image_facts facts;
    size_t size = (size_t)request->bytes;
    unsigned char *data = file >= 0 ? read_file(file, &size) : size <= memory ? receive(size) : NULL;
    if (!data)
        return reader_refuse(ERROR_LIMIT_MEMORY,
                             "the image is larger than the memory that is left: raise limits.memory_mb");
    const image_limits limits = {request->pixels, request->scans, memory};
    void *pixels = image_decode(data, size, name, &limits, &facts, &e);
    bool written = pixels || *facts.unread ? reader_answer(&facts, sizeof facts, NULL, 0)
                                           : reader_refuse(e.code, e.message);
    if (written && pixels && request->returns_pixels)
        written = reader_write(pixels, (size_t)4 * (facts.bits / 8) * facts.width * facts.height);
    free(pixels);
    free(data);
    return written;
}

__attribute__((visibility("default"))) int image_reader_main(int argc, char **argv)
{
    const size_t memory = reader_limit(argc, argv, DESCRIPTORS);
    image_request request;
    int file;
    if (!memory) return 2;
    while (reader_receive(&request, sizeof request, &file)) {
        if (!answer(argv[1], &request, file, memory)) _exit(1);
        if (file >= 0) close(file);
    }
    _exit(0); /* _exit: freeing the libraries' memory takes time */
}
