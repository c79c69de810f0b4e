// SPDX-License-Identifier: Apache-2.0
#include "io/pictures/thumbnail.h"

#include <errno.h>
#include <png.h>
#include <poll.h>
#include <setjmp.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/pidfd.h>
#include <unistd.h>

#include "base/core/clock.h"
#include "base/core/memory.h"
#include "base/core/reader.h"
#include "base/core/worker_contract.h"
#include "io/pictures/preview.h"

/* Limits of the process: a row of the largest picture and the buffers of libpng need 1 MiB; decoding that
 * picture takes 2 s. */
enum { READER_BYTES = 64 << 20, READER_SECONDS = 20 };

/* Interval between calls of `is_over`. */
enum { POLL_MS = 100 };

/* ---- in the process */

typedef struct sums {
    uint32_t value[3 * THUMBNAIL_SIDE * THUMBNAIL_SIDE], count[THUMBNAIL_SIDE * THUMBNAIL_SIDE];
} sums;

static int scaled(int side, int longer)
{
    int made = longer <= THUMBNAIL_SIDE ? side : (int)((int64_t)side * THUMBNAIL_SIDE / longer);
    return made > 0 ? made : 1;
}

static void add_row(const unsigned char *row, int width, thumbnail *to, int at, sums *s)
{
    for (int x = 0; x < width; x++) {
        size_t cell = (size_t)at * (size_t)to->width + (size_t)((int64_t)x * to->width / width);
        for (size_t k = 0; k < 3; k++) s->value[3 * cell + k] += row[3 * (size_t)x + k];
        s->count[cell]++;
    }
}

static void read_rows(png_structp png, png_infop info, unsigned char *row, thumbnail *to, sums *s)
{
    png_init_io(png, stdin);
    png_read_info(png, info);
    const png_uint_32 wide = png_get_image_width(png, info), high = png_get_image_height(png, info);
    if (wide > PREVIEW_SIZE_MAX || high > PREVIEW_SIZE_MAX || png_get_bit_depth(png, info) != 8 ||
        png_get_color_type(png, info) != PNG_COLOR_TYPE_RGB ||
        png_get_interlace_type(png, info) != PNG_INTERLACE_NONE)
        png_error(png, "it is not a preview");
    const int width = (int)wide, height = (int)high, longer = width > height ? width : height;
    to->width = scaled(width, longer);
    to->height = scaled(height, longer);
    for (int y = 0; y < height; y++) {
        png_read_row(png, row, NULL);
        add_row(row, width, to, (int)((int64_t)y * to->height / height), s);
    }
    for (size_t i = 0; i < (size_t)to->width * (size_t)to->height; i++)
        for (size_t k = 0; k < 3; k++)
            to->rgb[3 * i + k] = (unsigned char)((s->value[3 * i + k] + s->count[i] / 2) / s->count[i]);
}

int thumbnail_main(int argc, char **argv)
{
    if (!reader_limit(argc, argv, STDERR_FILENO + 1)) return 2;
    unsigned char *row = malloc(3 * PREVIEW_SIZE_MAX);
    thumbnail *made = calloc(1, sizeof *made);
    sums *s = calloc(1, sizeof *s);
    png_structp png = png_create_read_struct(PNG_LIBPNG_VER_STRING, NULL, NULL, NULL);
    png_infop info = png ? png_create_info_struct(png) : NULL;
    if (!row || !made || !s || !info || setjmp(png_jmpbuf(png)) != 0) _exit(2);
    read_rows(png, info, row, made, s);
    bool written = reader_answer(made, sizeof *made, NULL, 0);
    _exit(written ? 0 : 1); /* skips freeing the library's memory */
}

/* ---- in the calling program */

/* Milliseconds until the deadline, at least 0. */
static int64_t time_left(const thumbnail_patience *patience)
{
    const int64_t left_ms = patience->until_ms - clock_monotonic_ms();
    bool over = left_ms < 0 || (patience->is_over && patience->is_over(patience->context));
    return over ? 0 : left_ms;
}

static bool await_readable(int fd, const thumbnail_patience *patience)
{
    struct pollfd from = {.fd = fd, .events = POLLIN};
    int64_t left_ms = time_left(patience);
    bool fails = false;
    while (!fails && !from.revents && left_ms) {
        fails = poll(&from, 1, left_ms < POLL_MS ? (int)left_ms : POLL_MS) < 0 && errno != EINTR;
        left_ms = time_left(patience);
    }
    return from.revents != 0;
}

static bool await_end(pid_t pid, const thumbnail_patience *patience)
{
    int fd = pidfd_open(pid, 0);
    bool ended = fd >= 0 && await_readable(fd, patience);
    if (fd >= 0) close(fd);
    return ended;
}

/* Receives the bytes that the process writes until its end, at most `size`. False: deadline. */
static bool receive(const reader *r, void *to, size_t size, size_t *received,
                    const thumbnail_patience *patience)
{
    const int fd = fileno(r->stream);
    *received = 0;
    while (await_readable(fd, patience)) {
        const ssize_t count = read(fd, (char *)to + *received, size - *received);
        if (count < 0 && errno == EINTR) continue;
        if (count <= 0) return await_end(r->pid, patience);
        *received += (size_t)count;
    }
    return false;
}

static bool fail_late(error *e)
{
    return error_set(e, ERROR_LIMIT_TIME, WORKER_PREVIEW_NAME " could not be read in time");
}

static bool is_thumbnail(const thumbnail *t)
{
    return t->width > 0 && t->width <= THUMBNAIL_SIDE && t->height > 0 && t->height <= THUMBNAIL_SIDE;
}

bool thumbnail_read(const char *program, int fd, const thumbnail_patience *patience, thumbnail *out, error *e)
{
    const reader_params params = {program, THUMBNAIL_COMMAND, WORKER_PREVIEW_NAME,
                                  fd,      READER_BYTES,      READER_SECONDS};
    reader r;
    struct {
        reader_head head;
        thumbnail made;
        char more; /* detects a process that writes too much */
    } from;
    size_t received;
    if (lseek(fd, 0, SEEK_SET) != 0)
        return error_set(e, ERROR_INTERNAL, WORKER_PREVIEW_NAME " cannot be read");
    if (!time_left(patience)) return fail_late(e);
    if (!reader_start(&params, &r, e)) return false;
    if (!receive(&r, &from, sizeof from, &received, patience)) {
        r.begun = true; /* the process is killed */
        fail_late(e);
        return reader_end(&r, false, e);
    }
    const bool ok = received == sizeof from.head + sizeof from.made && from.head.magic == READER_MAGIC &&
                    from.head.code == ERROR_NONE && from.head.size == sizeof from.made &&
                    is_thumbnail(&from.made);
    if (ok)
        *out = from.made;
    else
        error_set(e, ERROR_INPUT_DAMAGED, WORKER_PREVIEW_NAME " is not a picture written by hexad");
    return reader_end(&r, ok, e);
}
