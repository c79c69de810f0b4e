// SPDX-License-Identifier: Apache-2.0
/* An NRRD, NIfTI or MetaImage file: its header as the process that reads headers does, and its values, slice
 * by slice.
 *
 * That process is one program in one file (header_reader.c), which is run here without a process:
 * reader_start and what belongs to it are in the place of reader.c. What the libraries keep of a file is
 * lost, as there. */
#include <sys/mman.h>
#include <sys/stat.h>

#include "io/volumes/header_reader.c"
#include "io/volumes/raw_volume.h"
#include "fuzz/target.h"

/* A slice of more is not read: only memory would be tried. */
static const int64_t most_samples = 1 << 20;

bool reader_check_file(int fd, const char *what, off_t *size, error *e)
{
    struct stat st;
    (void)what;
    if (fstat(fd, &st) != 0 || st.st_size == 0)
        return error_set(e, ERROR_INPUT_DAMAGED, "is empty (0 bytes)");
    *size = st.st_size;
    return true;
}

static char *answered; /* what the stream reads */

bool reader_start(const reader_params *p, reader *out, error *e)
{
    static char text[VOLUME_HEADER_TEXT_MAX];
    answer a = {.head = {.slope = 1}, .text = text};
    (void)e;
    expect(dup2(p->fd, STDIN_FILENO) == STDIN_FILENO);
    read_file(&a, p->argument);
    const size_t size = a.code == ERROR_NONE ? sizeof a.head : 0;
    const reader_head head = {READER_MAGIC, (uint32_t)a.code, (uint32_t)a.text_length, size};
    answered = realloc(answered, sizeof head + a.text_length + size);
    expect(answered);
    memcpy(answered, &head, sizeof head);
    memcpy(answered + sizeof head, a.text, a.text_length);
    memcpy(answered + sizeof head + a.text_length, &a.head, size);
    out->stream = fmemopen(answered, sizeof head + a.text_length + size, "rb");
    expect(out->stream);
    return true;
}

bool reader_end(reader *r, bool ok, error *e)
{
    (void)e;
    fclose(r->stream);
    return ok;
}

/* Another file is this one again: what it holds is of no matter. */
static int open_again(void *context, const char *path, error *e)
{
    (void)path, (void)e;
    return dup(*(int *)context);
}

static void read_slices(slices *s)
{
    error e = {0};
    double *values = calloc((size_t)(s->size[0] * s->size[1] * s->components), sizeof *values);
    expect(values);
    bool ok = true;
    for (int64_t k = 0; ok && k < s->size[2] && k < 64; k++) ok = s->ops->read(s, k, values, &e);
    expect(ok || (e.code != ERROR_NONE && *e.message));
    free(values);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    error e = {0};
    int fd = memfd_create("dense", MFD_CLOEXEC);
    expect(fd >= 0 && write(fd, data, size) == (ssize_t)size);
    const slices_files files = {open_again, &fd};
    slices *s = raw_vectors_open(fd, "a.nii.gz", NULL, 0, &files, &e);
    expect(s || (e.code != ERROR_NONE && *e.message));
    if (s) {
        for (int k = 0; k < 3; k++) expect(s->size[k] >= 2);
        for (int k = 0; k < 16; k++) expect(isfinite(s->index_to_world[k]));
        if (s->size[0] * s->size[1] <= most_samples) read_slices(s);
        s->ops->close(s);
    }
    close(fd);
    return 0;
}
