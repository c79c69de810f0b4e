// SPDX-License-Identifier: Apache-2.0
/* A Zarr array with one chunk: the first bytes of the input are the metadata of version 2 or 3, and what is
 * behind the first byte 0 is every other file. The metadata are read, and chunks are unpacked as in the
 * process that unpacks them.
 *
 * That process is one source file (zarr_reader.c). The target includes it and calls the functions below
 * its socket. */
#include <math.h>
#include <string.h>
#include <sys/mman.h>

#include "io/volumes/zarr_reader.c"
#include "io/volumes/zarr_volume.h"
#include "fuzz/target.h"

/* A slice of more is not read: only memory would be tried. */
static const int64_t most_samples = 1 << 18;
static const size_t memory = (size_t)16 << 20;

typedef struct files {
    const char *name; /* of the metadata */
    const uint8_t *metadata, *rest;
    size_t metadata_size, rest_size;
} files;

static int open_file(void *context, const char *path, bool *is_missing, error *e)
{
    const files *f = context;
    const size_t length = strlen(path), own = strlen(f->name);
    const bool is_metadata = length >= own && strcmp(path + length - own, f->name) == 0;
    (void)e;
    *is_missing = !is_metadata && (strstr(path, "zarr.json") || strstr(path, ".z"));
    if (*is_missing) return -1;
    const int fd = memfd_create("zarr", MFD_CLOEXEC);
    const void *from = is_metadata ? f->metadata : f->rest;
    const size_t size = is_metadata ? f->metadata_size : f->rest_size;
    expect(fd >= 0 && (size == 0 || write(fd, from, size) == (ssize_t)size));
    return fd;
}

/* In the place of the process: its answers are in the pipe of a file in memory. */
static FILE *answers;
static char *answered;

bool reader_start(const reader_params *p, reader *out, error *e)
{
    (void)p, (void)e;
    *out = (reader){0};
    return true;
}

bool reader_send(reader *r, const void *request, size_t size, int file, error *e)
{
    chunk c = {.memory = memory};
    (void)e;
    expect(size == sizeof(zarr_request));
    const bool ok = read_chunk(&c, file, request);
    const reader_head a = {READER_MAGIC, (uint32_t)c.fault.code, ok ? 0 : (uint32_t)strlen(c.fault.message),
                           0};
    const size_t bytes = sizeof a + (ok ? c.count : a.text_length);
    expect(ok ? c.count == ((const zarr_request *)request)->unpacked
              : c.fault.code != ERROR_NONE && *c.fault.message);
    if (answers) fclose(answers);
    free(answered);
    answered = malloc(bytes);
    expect(answered);
    memcpy(answered, &a, sizeof a);
    memcpy(answered + sizeof a, ok ? (void *)c.bytes : c.fault.message, bytes - sizeof a);
    answers = r->stream = fmemopen(answered, bytes, "rb");
    expect(answers);
    free(c.bytes);
    return true;
}

bool reader_end(reader *r, bool ok, error *e)
{
    (void)r, (void)e;
    return ok;
}

static void read_slices(slices *s)
{
    error e = {0};
    double *values = calloc((size_t)(s->size[0] * s->size[1]), sizeof *values);
    expect(values);
    bool ok = true;
    for (int64_t k = 0; ok && k < s->size[2] && k < 8; k++) ok = s->ops->read(s, k, values, &e);
    expect(ok || (e.code != ERROR_NONE && *e.message));
    free(values);
}

static void read_as(files *f, const char *name)
{
    error e = {0};
    f->name = name;
    const slices_directory directory = {open_file, f};
    const zarr_request_volume request = {.directory = &directory, .most_chunks = 64, .memory_limit = memory};
    slices *s = zarr_volume_open(&request, &e);
    expect(s || (e.code != ERROR_NONE && *e.message));
    if (!s) return;
    for (int k = 0; k < 3; k++) expect(s->size[k] >= 2);
    for (int k = 0; k < 16; k++) expect(isfinite(s->index_to_world[k]));
    if (s->size[0] * s->size[1] <= most_samples) read_slices(s);
    s->ops->close(s);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    const uint8_t *end = memchr(data, 0, size);
    files f = {.metadata = data, .metadata_size = end ? (size_t)(end - data) : size};
    f.rest = end ? end + 1 : data;
    f.rest_size = end ? size - f.metadata_size - 1 : 0;
    read_as(&f, ".zarray");
    read_as(&f, "zarr.json");
    read_as(&f, ".zattrs");
    return 0;
}
