#include "formats/ply.h"

#include <endian.h>
#include <errno.h>
#include <inttypes.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"

/* Points per block: 4096 * 13 * 8 bytes is what a second-level cache holds easily. */
enum { BLOCK_POINTS = 4096 };

/* Longest text of a double with %.17g: sign, 17 digits, point, e-308. */
enum { NUMBER_TEXT_MAX = 26 };

/* A header or ASCII line that ply_write makes is shorter. */
enum { LINE_MAX_BYTES = 1024 };

static const char *const property_names[PLY_PROPERTIES_MOST] = {"x",
                                                                "y",
                                                                "z",
                                                                "nx",
                                                                "ny",
                                                                "nz",
                                                                "kappa",
                                                                "kappa1",
                                                                "kappa2",
                                                                "alpha",
                                                                "energy",
                                                                "spacing",
                                                                "spacing_local",
                                                                "kappa_scale",
                                                                "id",
                                                                "velocity_x",
                                                                "velocity_y",
                                                                "velocity_z"};
static const char *const format_names[] = {"binary_little_endian", "ascii"};
static const char *const precision_names[] = {"float", "double"};
/* Properties that not every set has, by their places among all. The id is a whole number of 32 bits, whatever the others
 * are. */
enum { KAPPA_SCALE = PLY_PROPERTIES, ID, VELOCITY };
#define ALWAYS ((1u << PLY_PROPERTIES) - 1)
#define IN_SEQUENCES (1u << ID | 7u << VELOCITY)
static const char face_property[] = "property list uchar int vertex_indices";

/* A triangle in binary: how many corners, and each. */
enum { FACE_BYTES = 1 + 3 * 4, FACE_TEXT_LEAST = 8 };

/* ---- writing ---- */

/* The properties that a set has, a bit each. */
static unsigned properties_of(const points *s)
{
    return ALWAYS | (s->kappa_scale ? 1u << KAPPA_SCALE : 0) | (s->id ? IN_SEQUENCES : 0);
}

/* The next property after c, or PLY_PROPERTIES_MOST; the first is next_property(properties, -1). */
static int next_property(unsigned properties, int c)
{
    do c++;
    while (c < PLY_PROPERTIES_MOST && !(properties >> c & 1));
    return c;
}

static int count_properties(unsigned properties)
{
    return __builtin_popcount(properties);
}

static const char *type_name(int property, ply_precision precision)
{
    return property == ID ? "uint" : precision_names[precision];
}

/* Bytes of a point in binary. */
static size_t row_bytes(unsigned properties, ply_precision precision)
{
    size_t wide = precision == PLY_FLOAT ? 4 : 8, count = (size_t)count_properties(properties);
    return properties >> ID & 1 ? (count - 1) * wide + 4 : count * wide;
}

/* A row has each property at its place among all. */
static void load_row(const points *s, size_t i, double row[PLY_PROPERTIES_MOST])
{
    row[0] = s->position[i].x;
    row[1] = s->position[i].y;
    row[2] = s->position[i].z;
    row[3] = s->normal[i].x;
    row[4] = s->normal[i].y;
    row[5] = s->normal[i].z;
    row[6] = s->kappa[i];
    row[7] = s->kappa1[i];
    row[8] = s->kappa2[i];
    row[9] = s->alpha[i];
    row[10] = s->energy[i];
    row[11] = s->spacing[i];
    row[12] = s->spacing_local[i];
    if (s->kappa_scale) row[KAPPA_SCALE] = s->kappa_scale[i];
    if (!s->id) return;
    row[ID] = s->id[i];
    row[VELOCITY] = s->velocity[i].x;
    row[VELOCITY + 1] = s->velocity[i].y;
    row[VELOCITY + 2] = s->velocity[i].z;
}

static bool check_row(const double *row, unsigned properties, size_t i, ply_precision precision, error *e)
{
    for (int c = next_property(properties, -1); c < PLY_PROPERTIES_MOST; c = next_property(properties, c))
        if (!isfinite(row[c]) || (precision == PLY_FLOAT && !isfinite((float)row[c])))
            return error_set(e, ERROR_INTERNAL, "point %zu has %s = %g, which cannot be written as a %s", i,
                             property_names[c], row[c], precision_names[precision]);
    return true;
}

static size_t pack_row(const double *row, unsigned properties, ply_precision precision, char *out)
{
    char *at = out;
    for (int c = next_property(properties, -1); c < PLY_PROPERTIES_MOST; c = next_property(properties, c)) {
        if (c == ID || precision == PLY_FLOAT) {
            float value = (float)row[c];
            uint32_t bits = (uint32_t)row[ID];
            if (c != ID) memcpy(&bits, &value, sizeof bits);
            bits = htole32(bits);
            memcpy(at, &bits, sizeof bits);
            at += sizeof bits;
        } else {
            uint64_t bits;
            memcpy(&bits, &row[c], sizeof bits);
            bits = htole64(bits);
            memcpy(at, &bits, sizeof bits);
            at += sizeof bits;
        }
    }
    return (size_t)(at - out);
}

/* FLT_DIG and DBL_DIG digits may be enough, three more always are (IEEE 754). */
static size_t print_number(double value, ply_precision precision, char *out)
{
    int digits = precision == PLY_FLOAT ? 6 : 15, n = 0;
    for (int more = 0; more <= 3; more++) {
        n = snprintf(out, NUMBER_TEXT_MAX, "%.*g", digits + more, value);
        if (precision == PLY_FLOAT ? strtof(out, NULL) == (float)value : strtod(out, NULL) == value) break;
    }
    return (size_t)n;
}

static size_t print_row(const double *row, unsigned properties, ply_precision precision, char *out)
{
    size_t n = 0;
    for (int c = next_property(properties, -1); c < PLY_PROPERTIES_MOST; c = next_property(properties, c)) {
        if (c == ID)
            n += (size_t)sprintf(out + n, "%" PRIu32, (uint32_t)row[c]);
        else
            n += print_number(precision == PLY_FLOAT ? (double)(float)row[c] : row[c], precision, out + n);
        out[n++] = ' ';
    }
    out[n - 1] = '\n';
    return n;
}

static bool write_failed(error *e)
{
    return error_set(e, error_code_of_errno(errno), "cannot write the PLY file: %s", strerror(errno));
}

static bool write_header(FILE *file, const points *set, ply_format format, ply_precision precision, error *e)
{
    bool good = fprintf(file, "ply\nformat %s 1.0\ncomment hexad\nelement vertex %zu\n", format_names[format],
                        set->count) > 0;
    const unsigned properties = properties_of(set);
    for (int c = next_property(properties, -1); c < PLY_PROPERTIES_MOST; c = next_property(properties, c))
        good = good && fprintf(file, "property %s %s\n", type_name(c, precision), property_names[c]) > 0;
    if (set->triangle_count > 0)
        good = good && fprintf(file, "element face %zu\n%s\n", set->triangle_count, face_property) > 0;
    good = good && fputs("end_header\n", file) >= 0;
    return good || write_failed(e);
}

/* Blocks that are made at a time, in parallel, and then written in their order. */
enum { BATCH_BLOCKS = 8 };

typedef struct block {
    char *text;
    size_t bytes;
    bool good;
    error e; /* of the first point that cannot be written */
} block;

typedef struct batch {
    const points *set;
    ply_format format;
    ply_precision precision;
    size_t first; /* point of the first block */
    block block[BATCH_BLOCKS];
} batch;

static void fill_blocks(void *context, int worker, size_t begin, size_t end)
{
    batch *job = context;
    (void)worker;
    for (size_t k = begin; k < end; k++) {
        block *b = &job->block[k];
        size_t from = job->first + k * BLOCK_POINTS, to = from + BLOCK_POINTS;
        if (to > job->set->count) to = job->set->count;
        b->bytes = 0;
        b->good = true;
        for (size_t i = from; b->good && i < to; i++) {
            double row[PLY_PROPERTIES_MOST] = {0};
            unsigned properties = properties_of(job->set);
            load_row(job->set, i, row);
            b->good = check_row(row, properties, i, job->precision, &b->e);
            if (!b->good) break;
            b->bytes += job->format == PLY_ASCII
                            ? print_row(row, properties, job->precision, b->text + b->bytes)
                            : pack_row(row, properties, job->precision, b->text + b->bytes);
        }
    }
}

static bool write_blocks(FILE *file, const batch *job, size_t count, error *e)
{
    for (size_t k = 0; k < count; k++) {
        const block *b = &job->block[k];
        if (!b->good) {
            if (e) *e = b->e;
            return false;
        }
        if (fwrite(b->text, 1, b->bytes, file) != b->bytes) return write_failed(e);
    }
    return true;
}

static bool write_triangles(FILE *file, const points *set, ply_format format, error *e)
{
    bool good = true;
    for (size_t k = 0; good && k < set->triangle_count; k++) {
        const uint32_t *corner = set->triangle[k];
        unsigned char packed[FACE_BYTES] = {3};
        for (int c = 0; c < 3; c++) {
            uint32_t little = htole32(corner[c]);
            memcpy(packed + 1 + 4 * c, &little, sizeof little);
        }
        good = format == PLY_ASCII ? fprintf(file, "3 %" PRIu32 " %" PRIu32 " %" PRIu32 "\n", corner[0],
                                             corner[1], corner[2]) > 0
                                   : fwrite_unlocked(packed, 1, FACE_BYTES, file) == FACE_BYTES;
    }
    return good || write_failed(e);
}

bool ply_write(FILE *file, const points *set, ply_format format, ply_precision precision, threads *pool,
               error *e)
{
    static const size_t all = (size_t)BATCH_BLOCKS * BLOCK_POINTS;
    batch job = {set, format, precision, 0, {{0}}};
    bool ok = write_header(file, set, format, precision, e);
    for (int k = 0; ok && k < BATCH_BLOCKS; k++) {
        job.block[k].text =
            mem_array(BLOCK_POINTS, PLY_PROPERTIES_MOST * NUMBER_TEXT_MAX, "the PLY file's buffer", e);
        ok = job.block[k].text != NULL;
    }
    for (; ok && job.first < set->count; job.first += all) {
        size_t left = set->count - job.first,
               blocks = left < all ? (left + BLOCK_POINTS - 1) / BLOCK_POINTS : BATCH_BLOCKS;
        threads_run(pool, blocks, 1, fill_blocks, &job);
        if (threads_stopped(pool)) ok = error_set(e, ERROR_CANCELLED, "stopped");
        ok = ok && write_blocks(file, &job, blocks, e);
    }
    for (int k = 0; k < BATCH_BLOCKS; k++) free(job.block[k].text);
    return ok && write_triangles(file, set, format, e) && (fflush(file) == 0 || write_failed(e));
}

/* ---- reading ---- */

static bool damaged(error *e, const char *words)
{
    return error_set(e, ERROR_INPUT_DAMAGED, "PLY file: %s", words);
}

/* One line without its line break; comments are passed over. */
static bool read_line(FILE *file, char line[LINE_MAX_BYTES], error *e)
{
    do {
        if (!fgets(line, LINE_MAX_BYTES, file)) return damaged(e, "it ends too early");
        char *end = strchr(line, '\n');
        if (!end)
            return damaged(e, feof(file) ? "it ends too early" : "a line is too long or holds a zero byte");
        *end = '\0';
    } while (strcmp(line, "comment") == 0 || strncmp(line, "comment ", 8) == 0);
    return true;
}

static bool expect_line(FILE *file, const char *expected, error *e)
{
    char line[LINE_MAX_BYTES];
    if (!read_line(file, line, e)) return false;
    if (strcmp(line, expected) == 0) return true;
    return error_set(e, ERROR_INPUT_DAMAGED, "PLY file: expected the line '%s', found '%.60s'", expected,
                     line);
}

/* Of a line "element NAME COUNT". */
static bool parse_count(const char *line, const char *name, size_t *count, error *e)
{
    char start[32];
    int length = snprintf(start, sizeof start, "element %s ", name);
    const char *digits = line + length;
    if (strncmp(line, start, (size_t)length) != 0 || !*digits ||
        strspn(digits, "0123456789") != strlen(digits) || (digits[0] == '0' && digits[1]))
        return error_set(e, ERROR_INPUT_DAMAGED, "PLY file: expected 'element %s COUNT', found '%.60s'", name,
                         line);
    errno = 0;
    uintmax_t value = strtoumax(digits, NULL, 10);
    if (errno || value > SIZE_MAX) return damaged(e, "a count in its header is too large");
    *count = (size_t)value;
    return true;
}

/* The line of a property. */
static bool is_property(const char *line, int property, ply_precision precision)
{
    char expected[LINE_MAX_BYTES];
    snprintf(expected, sizeof expected, "property %s %s", type_name(property, precision),
             property_names[property]);
    return strcmp(line, expected) == 0;
}

/* The lines of the properties from `first` on to before `end`, of which `line` is the first; it receives the line after
 * them. */
static bool expect_properties(FILE *file, ply_precision precision, int first, int end, char *line, error *e)
{
    for (int c = first; c < end; c++) {
        if (!is_property(line, c, precision))
            return error_set(e, ERROR_INPUT_DAMAGED, "PLY file: expected 'property %s %s', found '%.60s'",
                             type_name(c, precision), property_names[c], line);
        if (!read_line(file, line, e)) return false;
    }
    return true;
}

static bool read_header(FILE *file, ply_file *f, error *e)
{
    char line[LINE_MAX_BYTES];
    if (!expect_line(file, "ply", e) || !read_line(file, line, e)) return false;
    if (strcmp(line, "format ascii 1.0") == 0)
        f->format = PLY_ASCII;
    else if (strcmp(line, "format binary_little_endian 1.0") == 0)
        f->format = PLY_BINARY_LITTLE_ENDIAN;
    else
        return error_set(e, ERROR_INPUT_DAMAGED, "PLY file: expected its format, found '%.60s'", line);
    if (!read_line(file, line, e) || !parse_count(line, "vertex", &f->points.count, e) ||
        !read_line(file, line, e))
        return false;
    f->precision = strcmp(line, "property double x") == 0 ? PLY_DOUBLE : PLY_FLOAT;
    if (!expect_properties(file, f->precision, 0, PLY_PROPERTIES, line, e)) return false;
    f->properties = ALWAYS;
    if (is_property(line, KAPPA_SCALE, f->precision)) {
        f->properties |= 1u << KAPPA_SCALE;
        if (!read_line(file, line, e)) return false;
    }
    if (is_property(line, ID, f->precision)) {
        f->properties |= IN_SEQUENCES;
        if (!expect_properties(file, f->precision, ID, PLY_PROPERTIES_MOST, line, e)) return false;
    }
    if (strcmp(line, "end_header") == 0) return true;
    return parse_count(line, "face", &f->points.triangle_count, e) && expect_line(file, face_property, e) &&
           expect_line(file, "end_header", e);
}

/* The bytes from here to the end must be able to hold the points: a count is never trusted alone.
 */
static bool check_size(FILE *file, const ply_file *f, error *e)
{
    long at = ftell(file);
    if (at < 0 || fseek(file, 0, SEEK_END) != 0)
        return error_set(e, ERROR_INTERNAL, "PLY file: it cannot be sought in");
    long end = ftell(file);
    if (end < at || fseek(file, at, SEEK_SET) != 0)
        return error_set(e, ERROR_INTERNAL, "PLY file: it cannot be sought in");
    size_t left = (size_t)(end - at), vertices = f->points.count, faces = f->points.triangle_count;
    bool text = f->format == PLY_ASCII; /* of a number then a digit and a space at least */
    size_t point =
        text ? 2 * (size_t)count_properties(f->properties) : row_bytes(f->properties, f->precision);
    size_t face = text ? FACE_TEXT_LEAST : FACE_BYTES;
    if (vertices > left / point || faces > left / face || vertices * point + faces * face > left ||
        (!text && vertices * point + faces * face != left))
        return error_set(e, ERROR_INPUT_DAMAGED,
                         "PLY file: %zu bytes of data cannot be the %zu points%s of its header", left,
                         vertices, faces > 0 ? " and faces" : "");
    return true;
}

static void unpack_row(const char *in, unsigned properties, ply_precision precision, double *row)
{
    for (int c = next_property(properties, -1); c < PLY_PROPERTIES_MOST; c = next_property(properties, c)) {
        if (c == ID || precision == PLY_FLOAT) {
            uint32_t bits;
            float value;
            memcpy(&bits, in, sizeof bits);
            in += sizeof bits;
            bits = le32toh(bits);
            memcpy(&value, &bits, sizeof value);
            row[c] = c == ID ? (double)bits : (double)value;
        } else {
            uint64_t bits;
            memcpy(&bits, in, sizeof bits);
            in += sizeof bits;
            bits = le64toh(bits);
            memcpy(&row[c], &bits, sizeof bits);
        }
    }
}

/* A whole number of 32 bits, as it is printed. */
static bool is_id(const char *text, size_t length)
{
    char *end;
    bool digits = length > 0 && length <= 10 && strspn(text, "0123456789") >= length;
    return digits && !(length > 1 && text[0] == '0') && strtoumax(text, &end, 10) <= UINT32_MAX;
}

static bool wrong_line(unsigned properties, error *e)
{
    return error_set(e, ERROR_INPUT_DAMAGED, "PLY file: a line is not %d numbers",
                     count_properties(properties));
}

static bool parse_row(FILE *file, unsigned properties, ply_precision precision, double *row, error *e)
{
    char line[LINE_MAX_BYTES], *at = line;
    if (!fgets(line, sizeof line, file)) return damaged(e, "it ends too early");
    for (int c = next_property(properties, -1); c < PLY_PROPERTIES_MOST; c = next_property(properties, c)) {
        size_t n = strspn(at, "0123456789+-.eE");
        char *end = at, stop = next_property(properties, c) < PLY_PROPERTIES_MOST ? ' ' : '\n';
        if (n > 0) row[c] = c != ID && precision == PLY_FLOAT ? (double)strtof(at, &end) : strtod(at, &end);
        if (end != at + n || *end != stop || n == 0 || (c == ID && !is_id(at, n)))
            return wrong_line(properties, e);
        at = end + 1;
    }
    return !*at || wrong_line(properties, e);
}

/* The arrays of a point set inside one allocation of `count` rows. */
static void store_row(const points *set, size_t i, const double *row)
{
    ((vec3 *)set->position)[i] = vec3_make(row[0], row[1], row[2]);
    ((vec3 *)set->normal)[i] = vec3_make(row[3], row[4], row[5]);
    ((double *)set->kappa)[i] = row[6];
    ((double *)set->kappa1)[i] = row[7];
    ((double *)set->kappa2)[i] = row[8];
    ((double *)set->alpha)[i] = row[9];
    ((double *)set->energy)[i] = row[10];
    ((double *)set->spacing)[i] = row[11];
    ((double *)set->spacing_local)[i] = row[12];
    if (set->kappa_scale) ((double *)set->kappa_scale)[i] = row[KAPPA_SCALE];
    if (!set->id) return;
    ((uint32_t *)set->id)[i] = (uint32_t)row[ID];
    ((vec3 *)set->velocity)[i] = vec3_make(row[VELOCITY], row[VELOCITY + 1], row[VELOCITY + 2]);
}

static void lay_out(ply_file *f)
{
    size_t n = f->points.count;
    double *d = f->storage;
    f->points.position = (const vec3 *)d;
    f->points.normal = (const vec3 *)(d + 3 * n);
    f->points.kappa = d + 6 * n;
    f->points.kappa1 = d + 7 * n;
    f->points.kappa2 = d + 8 * n;
    f->points.alpha = d + 9 * n;
    f->points.energy = d + 10 * n;
    f->points.spacing = d + 11 * n;
    f->points.spacing_local = d + 12 * n;
    d += 13 * n;
    if (f->properties >> KAPPA_SCALE & 1) {
        f->points.kappa_scale = d;
        d += n;
    }
    if (!(f->properties >> ID & 1)) return;
    f->points.velocity = (const vec3 *)d;
    f->points.id = (const uint32_t *)(d + 3 * n);
}

static bool read_row(FILE *file, const ply_file *f, size_t i, double *row, error *e)
{
    char packed[PLY_PROPERTIES_MOST * 8];
    size_t bytes = row_bytes(f->properties, f->precision);
    if (f->format == PLY_ASCII) {
        if (!parse_row(file, f->properties, f->precision, row, e)) return error_prefix(e, "point %zu", i);
    } else {
        if (fread_unlocked(packed, 1, bytes, file) != bytes) return damaged(e, "it ends too early");
        unpack_row(packed, f->properties, f->precision, row);
    }
    const unsigned properties = f->properties;
    for (int c = next_property(properties, -1); c < PLY_PROPERTIES_MOST; c = next_property(properties, c))
        if (!isfinite(row[c]))
            return error_set(e, ERROR_INPUT_DAMAGED, "PLY file: point %zu has %s = %g", i, property_names[c],
                             row[c]);
    return true;
}

static bool unpack_face(FILE *file, uint32_t corner[3], error *e)
{
    unsigned char packed[FACE_BYTES];
    if (fread_unlocked(packed, 1, FACE_BYTES, file) != FACE_BYTES) return damaged(e, "it ends too early");
    if (packed[0] != 3) return damaged(e, "a face is not a triangle");
    for (int c = 0; c < 3; c++) {
        memcpy(&corner[c], packed + 1 + 4 * c, sizeof corner[c]);
        corner[c] = le32toh(corner[c]);
    }
    return true;
}

static bool parse_face(FILE *file, uint32_t corner[3], error *e)
{
    char line[LINE_MAX_BYTES], again[LINE_MAX_BYTES];
    if (!fgets(line, sizeof line, file)) return damaged(e, "it ends too early");
    int read = sscanf(line, "3 %" SCNu32 " %" SCNu32 " %" SCNu32, &corner[0], &corner[1], &corner[2]);
    if (read == 3)
        snprintf(again, sizeof again, "3 %" PRIu32 " %" PRIu32 " %" PRIu32 "\n", corner[0], corner[1],
                 corner[2]);
    return (read == 3 && strcmp(line, again) == 0) || damaged(e, "a face is not a triangle");
}

static bool read_face(FILE *file, const ply_file *f, size_t k, uint32_t corner[3], error *e)
{
    if (!(f->format == PLY_ASCII ? parse_face(file, corner, e) : unpack_face(file, corner, e))) return false;
    for (int c = 0; c < 3; c++)
        if (corner[c] >= f->points.count)
            return error_set(e, ERROR_INPUT_DAMAGED,
                             "PLY file: face %zu has the corner %" PRIu32 " of %zu points", k, corner[c],
                             f->points.count);
    return true;
}

static bool read_end(FILE *file, error *e)
{
    return fgetc(file) == EOF || damaged(e, "there are bytes after its last point or face");
}

static bool read_start(FILE *file, ply_file *f, error *e)
{
    if (fseek(file, 0, SEEK_SET) != 0)
        return error_set(e, ERROR_INTERNAL, "PLY file: it cannot be sought in");
    return read_header(file, f, e) && check_size(file, f, e);
}

bool ply_read(FILE *file, ply_file *out, error *e)
{
    ply_file f = {0};
    double row[PLY_PROPERTIES_MOST];
    if (!read_start(file, &f, e)) return false;
    f.storage = mem_array(f.points.count, (size_t)count_properties(f.properties) * sizeof(double),
                          "the points of a PLY file", e);
    f.triangles = mem_array(f.points.triangle_count, sizeof *f.triangles, "the faces of a PLY file", e);
    f.points.triangle = (const uint32_t(*)[3])f.triangles;
    bool ok = f.storage && f.triangles;
    if (ok) lay_out(&f);
    for (size_t i = 0; ok && i < f.points.count; i++) {
        ok = read_row(file, &f, i, row, e);
        if (ok) store_row(&f.points, i, row);
    }
    for (size_t k = 0; ok && k < f.points.triangle_count; k++) ok = read_face(file, &f, k, f.triangles[k], e);
    if (ok && read_end(file, e)) {
        *out = f;
        return true;
    }
    ply_file_free(&f);
    return false;
}

/* Through memory: gcc 12 at -O3 drops the two conversions when it puts values into one vector. */
static double as_written(double value, ply_precision precision)
{
    volatile float single = (float)value;
    return precision == PLY_FLOAT ? (double)single : value;
}

bool ply_verify(FILE *file, const points *set, ply_format format, ply_precision precision, threads *pool,
                error *e)
{
    ply_file f = {0};
    double row[PLY_PROPERTIES_MOST], meant[PLY_PROPERTIES_MOST];
    if (!read_start(file, &f, e)) return false;
    if (f.points.count != set->count || f.points.triangle_count != set->triangle_count ||
        f.format != format || f.precision != precision || f.properties != properties_of(set))
        return damaged(e, "it is not of the count and type that were written");
    for (size_t i = 0; i < set->count; i++) {
        if (i % BLOCK_POINTS == 0 && threads_stopped(pool)) return error_set(e, ERROR_CANCELLED, "stopped");
        if (!read_row(file, &f, i, row, e)) return false;
        load_row(set, i, meant);
        const unsigned properties = f.properties;
        for (int c = next_property(properties, -1); c < PLY_PROPERTIES_MOST; c = next_property(properties, c))
            if (row[c] != (c == ID ? meant[c] : as_written(meant[c], precision)))
                return error_set(e, ERROR_INPUT_DAMAGED,
                                 "PLY file: the %s of point %zu is not what was written", property_names[c],
                                 i);
    }
    for (size_t k = 0; k < set->triangle_count; k++) {
        uint32_t corner[3];
        if (!read_face(file, &f, k, corner, e)) return false;
        if (memcmp(corner, set->triangle[k], sizeof corner) != 0)
            return error_set(e, ERROR_INPUT_DAMAGED, "PLY file: face %zu is not what was written", k);
    }
    return read_end(file, e);
}

void ply_file_free(ply_file *file)
{
    if (!file) return;
    free(file->storage);
    free(file->triangles);
    *file = (ply_file){0};
}
