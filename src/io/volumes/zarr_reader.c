// SPDX-License-Identifier: Apache-2.0
#include "io/volumes/zarr_reader.h"

#include <endian.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <blosc.h>
#include <zlib.h>
#include <zstd.h>

#include "base/core/reader.h"
#include "base/core/transfer.h"

/* Maximum number of open descriptors: three standard ones, one for a chunk's file, and one for temporary use
 * by the libraries. */
enum { DESCRIPTORS = 5 };

/* Maximum number of bytes by which the result of a codec may exceed the unpacked length: data that are
 * packed twice are slightly longer. */
static const size_t more_at_most = 1 << 20;

/* The bytes of a chunk, and the fault. */
typedef struct chunk {
    unsigned char *bytes;
    size_t count, memory; /* memory: maximum number of bytes */
    error fault;
} chunk;

static bool refuse(chunk *c, error_code code, const char *what)
{
    return error_set(&c->fault, code, "%s", what);
}

static bool damaged(chunk *c, const char *what)
{
    return error_set(&c->fault, ERROR_INPUT_DAMAGED, "%s: it is damaged or truncated. Copy or save it again.",
                     what);
}

/* Replaces packed bytes by unpacked ones. */
static void replace(chunk *c, unsigned char *bytes, size_t count)
{
    free(c->bytes);
    c->bytes = bytes;
    c->count = count;
}

/* ---- codecs. Each writes at most `most` bytes to `to`. False: the bytes are not valid, or there are more */

/* Unpacks a zlib stream or consecutive gzip members. */
static bool unpack_zlib(const chunk *c, unsigned char *to, size_t most, size_t *count)
{
    enum { EITHER = MAX_WBITS + 32 };
    z_stream z = {.next_in = c->bytes, .next_out = to};
    size_t left = c->count, room = most;
    int status = Z_OK;
    if (inflateInit2(&z, EITHER) != Z_OK) return false;
    while (status == Z_OK ||
           (status == Z_STREAM_END && (z.avail_in > 0 || left > 0) && inflateReset(&z) == Z_OK)) {
        if (z.avail_in == 0) {
            z.avail_in = left < UINT32_MAX ? (uInt)left : UINT32_MAX;
            left -= z.avail_in;
        }
        if (z.avail_out == 0) {
            z.avail_out = room < UINT32_MAX ? (uInt)room : UINT32_MAX;
            room -= z.avail_out;
        }
        status = inflate(&z, Z_NO_FLUSH);
    }
    *count = most - room - z.avail_out;
    inflateEnd(&z);
    return status == Z_STREAM_END;
}

static bool unpack_zstd(const chunk *c, unsigned char *to, size_t most, size_t *count)
{
    ZSTD_DStream *stream = ZSTD_createDStream();
    ZSTD_inBuffer in = {c->bytes, c->count, 0};
    ZSTD_outBuffer out = {to, most, 0};
    size_t more = 1;
    bool ok = stream != NULL;
    while (ok && in.pos < in.size) {
        const size_t before = in.pos + out.pos;
        more = ZSTD_decompressStream(stream, &out, &in);
        ok = !ZSTD_isError(more) && in.pos + out.pos > before;
    }
    ZSTD_freeDStream(stream);
    *count = out.pos;
    return ok && more == 0;
}

static bool unpack_blosc(const chunk *c, unsigned char *to, size_t most, size_t *count)
{
    size_t bytes = 0;
    if (c->count < BLOSC_MIN_HEADER_LENGTH || c->count > INT32_MAX ||
        blosc_cbuffer_validate(c->bytes, c->count, &bytes) != 0 || bytes > most || bytes > INT32_MAX)
        return false;
    const int got = bytes > 0 ? blosc_decompress_ctx(c->bytes, to, bytes, 1) : 0;
    *count = bytes;
    return got >= 0 && (size_t)got == bytes;
}

/* CRC-32C (Castagnoli's polynomial, reflected). */
static uint32_t crc32c(const unsigned char *bytes, size_t count)
{
    uint32_t table[256], crc = 0xffffffffu;
    for (uint32_t k = 0; k < 256; k++) {
        table[k] = k;
        for (int bit = 0; bit < 8; bit++) table[k] = table[k] >> 1 ^ (table[k] & 1 ? 0x82f63b78u : 0);
    }
    for (size_t k = 0; k < count; k++) crc = table[(crc ^ bytes[k]) & 255] ^ crc >> 8;
    return ~crc;
}

static bool check_sum(chunk *c)
{
    uint32_t said;
    if (c->count < sizeof said) return damaged(c, "the chunk is shorter than its checksum");
    c->count -= sizeof said;
    memcpy(&said, c->bytes + c->count, sizeof said);
    return le32toh(said) == crc32c(c->bytes, c->count) ||
           damaged(c, "the checksum (crc32c) of the chunk is wrong");
}

static bool unpack(chunk *c, zarr_codec codec, size_t most)
{
    static const struct {
        bool (*unpack)(const chunk *c, unsigned char *to, size_t most, size_t *count);
        const char *what;
    } codecs[ZARR_CODECS] = {
        [ZARR_ZLIB] = {unpack_zlib, "the chunk cannot be unpacked by zlib, or has more numbers than a chunk"},
        [ZARR_BLOSC] = {unpack_blosc,
                        "the chunk cannot be unpacked by blosc, or has more numbers than a chunk"},
        [ZARR_ZSTD] = {unpack_zstd,
                       "the chunk cannot be unpacked by zstd, or has more numbers than a chunk"}};
    size_t count = 0;
    if (codec == ZARR_CRC32C) return check_sum(c);
    unsigned char *to = malloc(most > 0 ? most : 1);
    if (!to) return refuse(c, ERROR_LIMIT_MEMORY, "a chunk exceeds the memory limit: raise limits.memory_mb");
    if (!codecs[codec].unpack(c, to, most, &count)) {
        free(to);
        return damaged(c, codecs[codec].what);
    }
    replace(c, to, count);
    return true;
}

/* ---- chunks */

static bool read_packed(chunk *c, int file, const zarr_request *r)
{
    if (r->length > c->memory || !(c->bytes = malloc(r->length > 0 ? r->length : 1)))
        return refuse(c, ERROR_LIMIT_MEMORY, "a chunk exceeds the memory limit: raise limits.memory_mb");
    if (transfer_read_at(file, c->bytes, r->length, r->offset) != (int64_t)r->length)
        return damaged(c, "the file of the chunk ends early");
    c->count = r->length;
    return true;
}

/* Undoes the codecs, from the last one applied to the first. */
static bool read_chunk(chunk *c, int file, const zarr_request *r)
{
    char text[160];
    if (r->packing.count > ZARR_CODECS_MOST || r->unpacked > c->memory)
        return refuse(c, ERROR_LIMIT_MEMORY, "a chunk exceeds the memory limit: raise limits.memory_mb");
    if (!read_packed(c, file, r)) return false;
    for (uint32_t k = r->packing.count; k > 0; k--) {
        const uint32_t codec = r->packing.codec[k - 1];
        if (codec >= ZARR_CODECS) return damaged(c, "the chunk has an unknown codec");
        bool is_last = true; /* only checksums remain */
        for (uint32_t n = 0; n + 1 < k; n++) is_last = is_last && r->packing.codec[n] == ZARR_CRC32C;
        if (!unpack(c, (zarr_codec)codec,
                    r->unpacked + (is_last ? 4 * ZARR_CODECS_MOST : r->unpacked / 8 + more_at_most)))
            return false;
    }
    if (c->count == r->unpacked) return true;
    snprintf(text, sizeof text, "the chunk has %zu bytes, and %llu are expected", c->count,
             (unsigned long long)r->unpacked);
    return damaged(c, text);
}

/* ---- the program */

static bool answer(size_t memory, int file, const zarr_request *request)
{
    chunk c = {.memory = memory};
    const bool ok = read_chunk(&c, file, request);
    const bool written = ok ? reader_answer(NULL, 0, NULL, 0) && reader_write(c.bytes, c.count)
                            : reader_refuse(c.fault.code, c.fault.message);
    free(c.bytes);
    return written;
}

__attribute__((visibility("default"))) int zarr_reader_main(int argc, char **argv)
{
    const size_t memory = reader_limit(argc, argv, DESCRIPTORS);
    zarr_request request;
    int file;
    if (!memory) return 2;
    while (reader_receive(&request, sizeof request, &file) && file >= 0) {
        const bool ok = answer(memory, file, &request);
        close(file);
        if (!ok) _exit(1);
    }
    _exit(0); /* _exit: freeing the libraries' memory takes time */
}
