#include "formats/preview_exr.h"

#include <endian.h>
#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include <openexr.h>

#include "base/memory.h"
#include "formats/deflate.h"

/* In the order of the file, which is that of the names' bytes. */
enum { A, B, G, N_X, N_Y, N_Z, P_X, P_Y, P_Z, R, Z, ID, KAPPA, SPACING, CHANNELS };

typedef struct channel {
    const char *name;
    exr_pixel_type_t type;
    int bytes;
} channel;

static const channel channels[CHANNELS] = {
    [A] = {"A", EXR_PIXEL_HALF, 2},          [B] = {"B", EXR_PIXEL_HALF, 2},
    [G] = {"G", EXR_PIXEL_HALF, 2},          [N_X] = {"N.X", EXR_PIXEL_FLOAT, 4},
    [N_Y] = {"N.Y", EXR_PIXEL_FLOAT, 4},     [N_Z] = {"N.Z", EXR_PIXEL_FLOAT, 4},
    [P_X] = {"P.X", EXR_PIXEL_FLOAT, 4},     [P_Y] = {"P.Y", EXR_PIXEL_FLOAT, 4},
    [P_Z] = {"P.Z", EXR_PIXEL_FLOAT, 4},     [R] = {"R", EXR_PIXEL_HALF, 2},
    [Z] = {"Z", EXR_PIXEL_FLOAT, 4},         [ID] = {"id", EXR_PIXEL_UINT, 4},
    [KAPPA] = {"kappa", EXR_PIXEL_FLOAT, 4}, [SPACING] = {"spacing", EXR_PIXEL_FLOAT, 4},
};

enum { CHUNK_LINES = 16 }; /* of ZIP */

/* The library wants a name even where the callbacks do the work; it goes into messages only. */
static const char library_name[] = "preview.exr";

/* The lines of one chunk as they stand in a file without compression: line after line, and within a line
 * channel after channel. */
typedef struct lines {
    int width;
    size_t line_bytes, offset[CHANNELS]; /* of a channel within its line */
    unsigned char *bytes;
} lines;

static lines lines_make(int width)
{
    lines l = {.width = width};
    for (int c = 0; c < CHANNELS; c++) {
        l.offset[c] = l.line_bytes;
        l.line_bytes += (size_t)width * (size_t)channels[c].bytes;
    }
    l.bytes = mem_alloc(l.line_bytes * CHUNK_LINES);
    return l;
}

static void put_float(unsigned char *line, size_t at, double value)
{
    float single = (float)value;
    memcpy(line + 4 * at, &single, sizeof single);
}

static void fill_constants(const lines *l, unsigned char *line, const preview_span *s, int x)
{
    for (size_t at = (size_t)x; at < (size_t)s->end; at++) {
        put_float(line + l->offset[N_X], at, s->normal.x);
        put_float(line + l->offset[N_Y], at, s->normal.y);
        put_float(line + l->offset[N_Z], at, s->normal.z);
        put_float(line + l->offset[KAPPA], at, s->kappa);
        put_float(line + l->offset[SPACING], at, s->spacing);
        memcpy(line + l->offset[ID] + 4 * at, &s->id, sizeof s->id);
    }
}

static void fill_places(const lines *l, unsigned char *line, const image *m, const preview_span *s, int x,
                        int y)
{
    for (; x < s->end; x++) {
        size_t at = (size_t)x;
        vec3 p = preview_place(m, s, x, y), world = camera_to_world(&m->camera, p);
        put_float(line + l->offset[Z], at, p.z);
        put_float(line + l->offset[P_X], at, world.x);
        put_float(line + l->offset[P_Y], at, world.y);
        put_float(line + l->offset[P_Z], at, world.z);
    }
}

static void fill_line(const lines *l, unsigned char *line, const image *m, int y)
{
    static const int color_channel[4] = {R, G, B, A};
    const uint16_t *rgba = m->rgba + 4 * (size_t)y * (size_t)m->width;
    memset(line, 0, l->line_bytes);
    for (int k = 0; k < 4; k++)
        for (size_t x = 0; x < (size_t)m->width; x++)
            memcpy(line + l->offset[color_channel[k]] + 2 * x, &rgba[4 * x + (size_t)k], 2);
    for (int x = 0; x < m->width;) {
        preview_span s = preview_span_at(m, x, y);
        if (s.id > 0) {
            fill_constants(l, line, &s, x);
            fill_places(l, line, m, &s, x, y);
        } else
            for (size_t at = (size_t)x; at < (size_t)s.end; at++)
                put_float(line + l->offset[Z], at, (double)PREVIEW_FAR);
        x = s.end;
    }
}

/* Returns how many bytes the lines from `top` on take. */
static size_t fill_lines(const lines *l, const image *m, int top)
{
    int count = m->height - top < CHUNK_LINES ? m->height - top : CHUNK_LINES;
    for (int y = 0; y < count; y++) fill_line(l, l->bytes + (size_t)y * l->line_bytes, m, top + y);
    return (size_t)count * l->line_bytes;
}

/* EXR's ZIP: the even bytes before the odd ones, then each less the one before it, with 128 for 0. `count` is
 * even. A block at a time by way of the stack, so that the compiler knows that nothing overlaps. */
static void spread(const unsigned char *in, size_t count, unsigned char *even, unsigned char *odd)
{
    enum { BLOCK = 512 };
    unsigned char last_even = 128, last_odd = in[count - 2]; /* before the odd bytes come the even ones */
    for (size_t at = 0; at < count / 2; at += BLOCK) {
        size_t n = count / 2 - at < BLOCK ? count / 2 - at : BLOCK;
        uint16_t pair[BLOCK + 1];
        unsigned char low[BLOCK], high[BLOCK];
        memcpy(pair + 1, in + 2 * at, 2 * n);
        for (size_t k = 1; k <= n; k++) pair[k] = le16toh(pair[k]);
        pair[0] = (uint16_t)(last_even | last_odd << 8);
        for (size_t k = 0; k < n; k++) low[k] = (unsigned char)(pair[k + 1] - pair[k] + 128);
        for (size_t k = 0; k < n; k++) high[k] = (unsigned char)((pair[k + 1] >> 8) - (pair[k] >> 8) + 128);
        memcpy(even + at, low, n);
        memcpy(odd + at, high, n);
        last_even = (unsigned char)(pair[n] & 255);
        last_odd = (unsigned char)(pair[n] >> 8);
    }
}

/* What the library's callbacks work on. */
typedef struct stream {
    int fd;
    error e; /* the first fault: later ones follow from it */
} stream;

/* Keeps the library from writing to standard error. It may call this with its lock held, so nothing
 * of the library may be called here, not even to find the stream: results carry the code. */
static void on_error(exr_const_context_t context, exr_result_t code, const char *words)
{
    (void)context;
    (void)code;
    (void)words;
}

static int64_t on_write(exr_const_context_t context, void *place, const void *bytes, uint64_t count,
                        uint64_t offset, exr_stream_error_func_ptr_t report)
{
    stream *s = place;
    (void)context;
    (void)report; /* see on_error */
    uint64_t done = 0;
    while (done < count) {
        ssize_t n = pwrite(s->fd, (const char *)bytes + done, count - done, (off_t)(offset + done));
        if (n < 0 && errno == EINTR) continue;
        if (n <= 0) {
            error_set(&s->e, ERROR_INTERNAL, "EXR file: it cannot be written: %s", strerror(errno));
            return -1;
        }
        done += (uint64_t)n;
    }
    return (int64_t)done;
}

/* Short at the end of the file, as the library expects. */
static int64_t on_read(exr_const_context_t context, void *place, void *bytes, uint64_t count, uint64_t offset,
                       exr_stream_error_func_ptr_t report)
{
    stream *s = place;
    (void)context;
    (void)report; /* see on_error */
    uint64_t done = 0;
    while (done < count) {
        ssize_t n = pread(s->fd, (char *)bytes + done, count - done, (off_t)(offset + done));
        if (n < 0 && errno == EINTR) continue;
        if (n < 0) {
            error_set(&s->e, ERROR_INTERNAL, "EXR file: it cannot be read: %s", strerror(errno));
            return -1;
        }
        if (n == 0) break;
        done += (uint64_t)n;
    }
    return (int64_t)done;
}

static int64_t on_size(exr_const_context_t context, void *place)
{
    struct stat status;
    (void)context;
    return fstat(((stream *)place)->fd, &status) == 0 ? (int64_t)status.st_size : -1;
}

static exr_context_initializer_t initializer(stream *s)
{
    exr_context_initializer_t init = EXR_DEFAULT_CONTEXT_INITIALIZER;
    init.error_handler_fn = on_error;
    init.user_data = s;
    init.read_fn = on_read;
    init.size_fn = on_size;
    init.write_fn = on_write;
    init.max_image_width = PREVIEW_SIZE_MAX;
    init.max_image_height = PREVIEW_SIZE_MAX;
    return init;
}

/* Some faults come without a message. */
static bool finish(bool good, exr_result_t result, stream *s, error *e)
{
    if (good) return true;
    if (s->e.code == ERROR_NONE)
        error_set(&s->e, ERROR_INTERNAL, "EXR file: %s", exr_get_default_error_message(result));
    if (e) *e = s->e;
    return false;
}

/* ---- writing ---- */

static exr_result_t write_head(exr_context_t file, const image *m)
{
    int part = 0;
    const camera *c = &m->camera;
    vec3 shift = camera_point(c, vec3_make(0, 0, 0));
    exr_attr_m44f_t matrix = {{(float)c->right.x, (float)c->up.x, (float)c->forward.x, 0, (float)c->right.y,
                               (float)c->up.y, (float)c->forward.y, 0, (float)c->right.z, (float)c->up.z,
                               (float)c->forward.z, 0, (float)shift.x, (float)shift.y, (float)shift.z, 1}};
    exr_result_t r = exr_add_part(file, "preview", EXR_STORAGE_SCANLINE, &part);
    if (!r) r = exr_initialize_required_attr_simple(file, part, m->width, m->height, EXR_COMPRESSION_ZIP);
    for (int k = 0; !r && k < CHANNELS; k++)
        r = exr_add_channel(file, part, channels[k].name, channels[k].type, EXR_PERCEPTUALLY_LINEAR, 1, 1);
    if (!r) r = exr_attr_set_m44f(file, part, "worldToCamera", &matrix);
    return r ? r : exr_write_header(file);
}

/* What a chunk goes through. */
typedef struct packing {
    lines lines;
    unsigned char *differences, *packed;
} packing;

static packing packing_make(int width)
{
    packing p = {.lines = lines_make(width)};
    size_t most = p.lines.line_bytes * CHUNK_LINES;
    p.differences = mem_alloc(most);
    p.packed = mem_alloc(deflate_bound(most));
    return p;
}

static void packing_free(packing *p)
{
    free(p->lines.bytes);
    free(p->differences);
    free(p->packed);
}

/* A chunk that does not shrink is stored as it is, which its size tells. */
static exr_result_t write_chunks(exr_context_t file, const image *m, packing *p)
{
    exr_result_t r = EXR_ERR_SUCCESS;
    for (int y = 0; !r && y < m->height; y += CHUNK_LINES) {
        size_t count = fill_lines(&p->lines, m, y);
        spread(p->lines.bytes, count, p->differences, p->differences + count / 2);
        size_t packed = deflate_pack(p->differences, count, p->packed);
        bool shrinks = packed < count;
        r = exr_write_scanline_chunk(file, 0, y, shrinks ? p->packed : p->lines.bytes,
                                     shrinks ? packed : count);
    }
    return r;
}

bool preview_exr_write(FILE *file, const image *m, error *e)
{
    stream s = {.fd = fileno(file)};
    exr_context_t context = NULL;
    exr_context_initializer_t init = initializer(&s);
    packing p = packing_make(m->width);
    exr_result_t r = exr_start_write(&context, library_name, EXR_WRITE_FILE_DIRECTLY, &init);
    if (!r) r = write_head(context, m);
    if (!r) r = write_chunks(context, m, &p);
    if (context) {
        exr_result_t closed = exr_finish(&context);
        if (!r) r = closed;
    }
    packing_free(&p);
    return finish(r == EXR_ERR_SUCCESS && s.e.code == ERROR_NONE, r, &s, e);
}

/* ---- reading back ---- */

static bool check_head(exr_context_t file, const image *m, error *e)
{
    int parts = 0;
    int32_t per_chunk = 0;
    exr_attr_box2i_t window;
    exr_compression_t compression;
    if (exr_get_count(file, &parts) || parts != 1 || exr_get_data_window(file, 0, &window) ||
        exr_get_compression(file, 0, &compression) || exr_get_scanlines_per_chunk(file, 0, &per_chunk))
        return error_set(e, ERROR_INTERNAL, "EXR file: its header cannot be read");
    if (window.min.x != 0 || window.min.y != 0 || window.max.x != m->width - 1 ||
        window.max.y != m->height - 1 || compression != EXR_COMPRESSION_ZIP || per_chunk != CHUNK_LINES)
        return error_set(e, ERROR_INTERNAL, "EXR file: it does not have the picture's size and compression");
    return true;
}

static bool check_channels(exr_context_t file, error *e)
{
    const exr_attr_chlist_t *list = NULL;
    bool same = exr_get_channels(file, 0, &list) == EXR_ERR_SUCCESS && list->num_channels == CHANNELS;
    for (int c = 0; same && c < CHANNELS; c++)
        same = strcmp(list->entries[c].name.str, channels[c].name) == 0 &&
               list->entries[c].pixel_type == channels[c].type;
    return same || error_set(e, ERROR_INTERNAL, "EXR file: its channels are not those that were written");
}

/* Against what the picture's lines come to. */
static exr_result_t check_chunk(exr_context_t file, const image *m, int y, packing *p, bool *same)
{
    exr_chunk_info_t chunk;
    size_t count = fill_lines(&p->lines, m, y);
    exr_result_t r = exr_read_scanline_chunk_info(file, 0, y, &chunk);
    if (r) return r;
    *same = chunk.unpacked_size == count && chunk.packed_size <= deflate_bound(count);
    if (!*same) return r;
    r = exr_read_chunk(file, 0, &chunk, p->packed);
    if (r) return r;
    if (chunk.packed_size == count) {
        *same = memcmp(p->packed, p->lines.bytes, count) == 0;
    } else {
        spread(p->lines.bytes, count, p->differences, p->differences + count / 2);
        *same = deflate_holds(p->packed, chunk.packed_size, p->differences, count);
    }
    return r;
}

static exr_result_t check_chunks(exr_context_t file, const image *m, packing *p, bool *same, error *e)
{
    exr_result_t r = EXR_ERR_SUCCESS;
    *same = true;
    for (int y = 0; !r && *same && y < m->height; y += CHUNK_LINES) {
        r = check_chunk(file, m, y, p, same);
        if (!r && !*same)
            error_set(e, ERROR_INTERNAL, "EXR file: what it holds from line %d on is not what was written",
                      y);
    }
    return r;
}

bool preview_exr_verify(FILE *file, const image *m, error *e)
{
    stream s = {.fd = fileno(file)};
    packing p = packing_make(m->width);
    bool same = false;
    exr_context_t context = NULL;
    exr_context_initializer_t init = initializer(&s);
    exr_result_t r = exr_start_read(&context, library_name, &init);
    if (!r && check_head(context, m, &s.e) && check_channels(context, &s.e))
        r = check_chunks(context, m, &p, &same, &s.e);
    if (context) exr_finish(&context);
    packing_free(&p);
    return finish(!r && same, r, &s, e);
}
