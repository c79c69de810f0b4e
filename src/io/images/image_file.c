// SPDX-License-Identifier: Apache-2.0
#include "io/images/image_file.h"

#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"
#include "base/core/reader.h"
#include "io/images/image_reader.h"

/* CPU limit of the process: seconds_at_least plus 1 s for each MiB of the file. A PNG image of 2^28 pixels takes 10 s. */
static const unsigned seconds_at_least = 60;
static const size_t bytes_per_second = 1 << 20;

static bool start(const image_file *file, size_t size, reader *out, error *e)
{
    const char *slash = strrchr(file->name, '/');
    const reader_params params = {file->program,
                                  IMAGE_READER_COMMAND,
                                  slash ? slash + 1 : file->name,
                                  -1,
                                  file->limits.memory,
                                  seconds_at_least + (unsigned)(size / bytes_per_second)};
    return reader_start(&params, out, e);
}

static bool send_image(const image_file *file, bool returns_pixels, reader *r, error *e)
{
    const image_request request = {file->fd < 0 ? file->size : 0, file->limits.pixels, file->limits.scans,
                                   returns_pixels};
    const char *data = file->data;
    bool ok = reader_send(r, &request, sizeof request, file->fd, e);
    for (size_t at = 0, length; ok && at < request.bytes; at += length) {
        length = file->size - at < IMAGE_READER_PIECE ? file->size - at : IMAGE_READER_PIECE;
        ok = reader_send(r, data + at, length, -1, e);
    }
    return ok;
}

static bool check_facts(const image_file *file, image_facts *f, error *e)
{
    const uint64_t pixels = (uint64_t)f->width * f->height;
    if (!memchr(f->unread, 0, sizeof f->unread)) return reader_invalid(e);
    reader_blank(f->unread, "");
    if (*f->unread) return true;
    return (pixels > 0 && (f->bits == 8 || f->bits == 16) && pixels <= file->limits.memory / (f->bits / 2)) ||
           reader_invalid(e);
}

static bool get_pixels(reader *r, const image_facts *f, void **pixels, error *e)
{
    const size_t count = (size_t)f->width * f->height;
    void *got = mem_array(count, f->bits / 2, "the image", e);
    if (got && reader_get(r, got, f->bits / 2, count, e)) {
        *pixels = got;
        return true;
    }
    free(got);
    return false;
}

static bool decode(const image_file *file, image_facts *facts, void **pixels, error *e)
{
    off_t size = (off_t)file->size;
    reader r;
    if ((size_t)size > file->limits.memory)
        return error_set(e, ERROR_LIMIT_MEMORY,
                         "the image is larger than the memory that is left: raise limits.memory_mb");
    if ((file->fd >= 0 && !reader_check_file(file->fd, "image", &size, e)) ||
        !start(file, (size_t)size, &r, e))
        return false;
    const bool ok = send_image(file, pixels != NULL, &r, e) &&
                    reader_get_answer(&r, facts, sizeof *facts, NULL, 0, e) && check_facts(file, facts, e) &&
                    (!pixels || *facts->unread || get_pixels(&r, facts, pixels, e));
    if (!ok && r.refused) {
        reader_close(&r);
        return false;
    }
    return reader_end(&r, ok, e);
}

bool image_file_check(const image_file *file, image_facts *facts, error *e)
{
    return decode(file, facts, NULL, e);
}

bool image_file_read(const image_file *file, image_facts *facts, void **pixels, error *e)
{
    void *got = NULL;
    if (!decode(file, facts, &got, e)) {
        free(got);
        return false;
    }
    *pixels = got;
    return true;
}
