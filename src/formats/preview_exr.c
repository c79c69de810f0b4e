#include "formats/preview_exr.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include <openexr.h>

#include "base/memory.h"

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

/* The lines of one chunk, a plane per channel of CHUNK_LINES lines. */
typedef struct planes {
    int width;
    unsigned char *plane[CHANNELS];
} planes;

static void planes_make(planes *p, int width)
{
    *p = (planes){.width = width};
    for (int c = 0; c < CHANNELS; c++)
        p->plane[c] = mem_alloc((size_t)width * CHUNK_LINES * (size_t)channels[c].bytes);
}

static void planes_free(planes *p)
{
    for (int c = 0; c < CHANNELS; c++) free(p->plane[c]);
}

static void put_float(planes *p, int c, size_t at, double value)
{
    float single = (float)value;
    memcpy(p->plane[c] + 4 * at, &single, sizeof single);
}

static void fill_pixel(planes *p, size_t at, const image *m, int x, int y)
{
    static const int color_channel[4] = {R, G, B, A};
    preview_sample s = preview_at(m, x, y);
    const uint16_t *rgba = m->rgba + 4 * ((size_t)y * (size_t)m->width + (size_t)x);
    for (int k = 0; k < 4; k++) memcpy(p->plane[color_channel[k]] + 2 * at, &rgba[k], 2);
    for (int k = 0; k < 3; k++) {
        put_float(p, P_X + k, at, vec3_get(s.position, k));
        put_float(p, N_X + k, at, vec3_get(s.normal, k));
    }
    put_float(p, Z, at, (double)s.depth);
    put_float(p, KAPPA, at, s.kappa);
    put_float(p, SPACING, at, s.spacing);
    memcpy(p->plane[ID] + 4 * at, &s.id, sizeof s.id);
}

static int fill_lines(planes *p, const image *m, int top)
{
    int lines = m->height - top < CHUNK_LINES ? m->height - top : CHUNK_LINES;
    for (int y = 0; y < lines; y++)
        for (int x = 0; x < m->width; x++)
            fill_pixel(p, (size_t)y * (size_t)m->width + (size_t)x, m, x, top + y);
    return lines;
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
static int64_t on_read(exr_const_context_t context, void *place, void *bytes, uint64_t count,
                       uint64_t offset, exr_stream_error_func_ptr_t report)
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

/* Positions and normals hardly shrink: the quickest level gives files 5 % larger in half the time. */
enum { ZIP_LEVEL = 1 };

static exr_context_initializer_t initializer(stream *s)
{
    exr_context_initializer_t init = EXR_DEFAULT_CONTEXT_INITIALIZER;
    init.error_handler_fn = on_error;
    init.user_data = s;
    init.read_fn = on_read;
    init.size_fn = on_size;
    init.write_fn = on_write;
    init.zip_level = ZIP_LEVEL;
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

static bool attach(exr_coding_channel_info_t *info, int count, planes *p)
{
    if (count != CHANNELS) return false;
    for (int c = 0; c < CHANNELS; c++) {
        if (strcmp(info[c].channel_name, channels[c].name) != 0 ||
            info[c].data_type != channels[c].type)
            return false;
        info[c].user_bytes_per_element = (int16_t)channels[c].bytes;
        info[c].user_data_type = (uint16_t)channels[c].type;
        info[c].user_pixel_stride = channels[c].bytes;
        info[c].user_line_stride = channels[c].bytes * p->width;
        info[c].decode_to_ptr = p->plane[c]; /* a union with encode_from_ptr */
    }
    return true;
}

/* ---- writing ---- */

static exr_result_t write_head(exr_context_t file, const image *m)
{
    int part = 0;
    const camera *c = &m->camera;
    vec3 shift = camera_point(c, vec3_make(0, 0, 0));
    exr_attr_m44f_t matrix = {{(float)c->right.x, (float)c->up.x, (float)c->forward.x, 0,
                               (float)c->right.y, (float)c->up.y, (float)c->forward.y, 0,
                               (float)c->right.z, (float)c->up.z, (float)c->forward.z, 0,
                               (float)shift.x, (float)shift.y, (float)shift.z, 1}};
    exr_result_t r = exr_add_part(file, "preview", EXR_STORAGE_SCANLINE, &part);
    if (!r)
        r = exr_initialize_required_attr_simple(file, part, m->width, m->height,
                                                EXR_COMPRESSION_ZIP);
    for (int k = 0; !r && k < CHANNELS; k++)
        r = exr_add_channel(file, part, channels[k].name, channels[k].type, EXR_PERCEPTUALLY_LINEAR,
                            1, 1);
    if (!r) r = exr_attr_set_m44f(file, part, "worldToCamera", &matrix);
    return r ? r : exr_write_header(file);
}

static exr_result_t write_chunks(exr_context_t file, const image *m, planes *p)
{
    exr_encode_pipeline_t pipe = EXR_ENCODE_PIPELINE_INITIALIZER;
    exr_result_t r = EXR_ERR_SUCCESS;
    for (int y = 0; !r && y < m->height; y += CHUNK_LINES) {
        exr_chunk_info_t chunk;
        fill_lines(p, m, y);
        r = exr_write_scanline_chunk_info(file, 0, y, &chunk);
        if (!r)
            r = y == 0 ? exr_encoding_initialize(file, 0, &chunk, &pipe)
                       : exr_encoding_update(file, 0, &chunk, &pipe);
        if (!r && !attach(pipe.channels, pipe.channel_count, p)) r = EXR_ERR_INVALID_ARGUMENT;
        if (!r && y == 0) r = exr_encoding_choose_default_routines(file, 0, &pipe);
        if (!r) r = exr_encoding_run(file, 0, &pipe);
    }
    exr_encoding_destroy(file, &pipe);
    return r;
}

bool preview_exr_write(FILE *file, const image *m, error *e)
{
    stream s = {.fd = fileno(file)};
    planes p;
    exr_context_t context = NULL;
    exr_context_initializer_t init = initializer(&s);
    planes_make(&p, m->width);
    exr_result_t r = exr_start_write(&context, library_name, EXR_WRITE_FILE_DIRECTLY, &init);
    if (!r) r = write_head(context, m);
    if (!r) r = write_chunks(context, m, &p);
    if (context) {
        exr_result_t closed = exr_finish(&context);
        if (!r) r = closed;
    }
    planes_free(&p);
    return finish(r == EXR_ERR_SUCCESS && s.e.code == ERROR_NONE, r, &s, e);
}

/* ---- reading back ---- */

static bool check_head(exr_context_t file, const image *m, error *e)
{
    int parts = 0;
    int32_t lines = 0;
    exr_attr_box2i_t window;
    exr_compression_t compression;
    if (exr_get_count(file, &parts) || parts != 1 || exr_get_data_window(file, 0, &window) ||
        exr_get_compression(file, 0, &compression) || exr_get_scanlines_per_chunk(file, 0, &lines))
        return error_set(e, ERROR_INTERNAL, "EXR file: its header cannot be read");
    if (window.min.x != 0 || window.min.y != 0 || window.max.x != m->width - 1 ||
        window.max.y != m->height - 1 || compression != EXR_COMPRESSION_ZIP || lines != CHUNK_LINES)
        return error_set(e, ERROR_INTERNAL,
                         "EXR file: it does not have the picture's size and compression");
    return true;
}

static bool same_lines(const planes *a, const planes *b, int lines, error *e)
{
    for (int c = 0; c < CHANNELS; c++)
        if (memcmp(a->plane[c], b->plane[c],
                   (size_t)lines * (size_t)a->width * (size_t)channels[c].bytes) != 0)
            return error_set(e, ERROR_INTERNAL, "EXR file: the channel %s is not what was written",
                             channels[c].name);
    return true;
}

static exr_result_t check_chunks(exr_context_t file, const image *m, planes *wanted, planes *found,
                                 bool *same, error *e)
{
    exr_decode_pipeline_t pipe = EXR_DECODE_PIPELINE_INITIALIZER;
    exr_result_t r = EXR_ERR_SUCCESS;
    *same = true;
    for (int y = 0; !r && *same && y < m->height; y += CHUNK_LINES) {
        exr_chunk_info_t chunk;
        int lines = fill_lines(wanted, m, y);
        r = exr_read_scanline_chunk_info(file, 0, y, &chunk);
        if (!r)
            r = y == 0 ? exr_decoding_initialize(file, 0, &chunk, &pipe)
                       : exr_decoding_update(file, 0, &chunk, &pipe);
        if (!r && !attach(pipe.channels, pipe.channel_count, found)) {
            *same = error_set(e, ERROR_INTERNAL,
                              "EXR file: its channels are not those that were written");
            break;
        }
        if (!r && y == 0) r = exr_decoding_choose_default_routines(file, 0, &pipe);
        if (!r) r = exr_decoding_run(file, 0, &pipe);
        if (!r) *same = same_lines(wanted, found, lines, e);
    }
    exr_decoding_destroy(file, &pipe);
    return r;
}

bool preview_exr_verify(FILE *file, const image *m, error *e)
{
    stream s = {.fd = fileno(file)};
    planes wanted, found;
    bool same = false;
    exr_context_t context = NULL;
    exr_context_initializer_t init = initializer(&s);
    planes_make(&wanted, m->width);
    planes_make(&found, m->width);
    exr_result_t r = exr_start_read(&context, library_name, &init);
    if (!r && check_head(context, m, &s.e))
        r = check_chunks(context, m, &wanted, &found, &same, &s.e);
    if (context) exr_finish(&context);
    planes_free(&wanted);
    planes_free(&found);
    return finish(!r && same, r, &s, e);
}
