// SPDX-License-Identifier: Apache-2.0
#include "io/points/ply.h"

#include <endian.h>
#include <errno.h>
#include <float.h>
#include <inttypes.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"
#include "base/core/number.h"
#include "base/core/ply_header.h"
#include "base/core/precision.h"

/* Points per block: with twenty columns a block fits into a second-level cache. */
enum { BLOCK_POINTS = 4096 };

/* Longest text of a double with %.17g: sign, 17 digits, point, e-308. */
enum { NUMBER_TEXT_MAX = 26 };

/* Limit of a line of a triangle. */
enum { LINE_MAX_BYTES = 128 };

/* Limit of the header of a file that is read. */
enum { HEADER_MOST = 1 << 20 };

static const char *const format_names[] = {"binary_little_endian", "ascii"};
static const char *const precision_names[] = {"float", "double"};
/* Types of integers do not depend on the precision of reals. */
static const char *const type_names[COLUMN_TYPES] = {NULL, "uint", "int", "uchar", "double", "double"};
static const number_type stored_as[COLUMN_TYPES] = {NUMBER_FLOAT, NUMBER_UINT32, NUMBER_INT32,
                                                    NUMBER_UINT8, NUMBER_DOUBLE, NUMBER_DOUBLE};
static const double type_least[COLUMN_TYPES] = {0, 0, INT32_MIN, 0, -PRECISION_WHOLE_MOST, -DBL_MAX},
                    type_most[COLUMN_TYPES] = {0,         UINT32_MAX,           INT32_MAX,
                                               UINT8_MAX, PRECISION_WHOLE_MOST, DBL_MAX};

/* Bytes of a binary triangle: its number of corners, and each corner. */
enum { FACE_BYTES = 1 + 3 * 4 };

/* A triangle of a file. */
typedef struct face {
    uint32_t corner[3];
    int64_t label[2];
} face;

static const char *type_name(column_type type, ply_precision precision)
{
    return type == COLUMN_REAL ? precision_names[precision] : type_names[type];
}

static number_type number_of(column_type type, ply_precision precision)
{
    return type == COLUMN_REAL && precision == PLY_DOUBLE ? NUMBER_DOUBLE : stored_as[type];
}

static size_t bytes_of(column_type type, ply_precision precision)
{
    return number_bytes(number_of(type, precision));
}

/* Bytes of a binary point. */
static size_t row_bytes(const columns *what, ply_precision precision)
{
    size_t bytes = 0;
    for (size_t c = 0; c < what->count; c++) bytes += bytes_of(what->list[c].type, precision);
    return bytes;
}

/* ---- writing ---- */

static void load_row(const columns *what, size_t i, double *row)
{
    for (size_t c = 0; c < what->count; c++) row[c] = column_value(&what->list[c], i);
}

/* Whether the type can represent a number. */
static bool is_in_range(double value, column_type type, ply_precision precision)
{
    if (type != COLUMN_REAL) return value >= type_least[type] && value <= type_most[type];
    return isfinite(value) && (precision == PLY_DOUBLE || isfinite((float)value));
}

static bool check_row(const double *row, const columns *what, size_t i, ply_precision precision, error *e)
{
    for (size_t c = 0; c < what->count; c++) {
        const column_type type = what->list[c].type;
        if (!is_in_range(row[c], type, precision))
            return error_set(
                e, ERROR_INTERNAL,
                "point %zu has %s = %g, outside the range of the type %s: set output.ply.precision "
                "to double",
                i, what->list[c].name, row[c], type_name(type, precision));
    }
    return true;
}

/* Packs a number of any type. */
static void pack(double value, column_type type, ply_precision precision, char *out)
{
    const number_type number = number_of(type, precision);
    const float single = (float)value;
    uint64_t bits = 0;
    uint32_t half = 0;
    if (number == NUMBER_DOUBLE)
        memcpy(&bits, &value, sizeof value);
    else if (number == NUMBER_FLOAT)
        memcpy(&half, &single, sizeof single);
    else
        half = (uint32_t)(int64_t)value;
    bits = htole64(bits | half);
    memcpy(out, &bits, number_bytes(number));
}

/* Packs the column of points `from` to `to` - 1; consecutive numbers are `row` bytes apart. False: a number
 * cannot be represented. */
static bool pack_column(const column *c, ply_precision precision, size_t from, size_t to, size_t row,
                        char *out)
{
    bool good = true;
    if (c->type == COLUMN_REAL && c->values && precision == PLY_FLOAT) { /* the most frequent case */
        for (size_t i = from; i < to; i++, out += row) {
            const float single = (float)(c->scale * c->values[c->stride * i]);
            uint32_t bits;
            memcpy(&bits, &single, sizeof bits);
            bits = htole32(bits);
            memcpy(out, &bits, sizeof bits);
            good &= isfinite(single) != 0;
        }
        return good;
    }
    for (size_t i = from; i < to; i++, out += row) {
        const double value = column_value(c, i);
        if (!is_in_range(value, c->type, precision)) return false;
        pack(value, c->type, precision, out);
    }
    return good;
}

/* Number of points whose rows fit into the first-level cache while their columns are filled. */
enum { PACKED_AT_ONCE = 256 };

/* Packs the rows of points `from` to `to` - 1. False: a number cannot be represented. */
static bool pack_rows(const columns *what, ply_precision precision, size_t from, size_t to, char *out)
{
    const size_t row = row_bytes(what, precision);
    for (size_t first = from; first < to; first += PACKED_AT_ONCE) {
        const size_t end = to - first < PACKED_AT_ONCE ? to : first + PACKED_AT_ONCE;
        char *at = out + (first - from) * row;
        for (size_t c = 0; c < what->count; c++) {
            if (!pack_column(&what->list[c], precision, first, end, row, at)) return false;
            at += bytes_of(what->list[c].type, precision);
        }
    }
    return true;
}

/* FLT_DIG or DBL_DIG digits may suffice; three more always suffice (IEEE 754). */
static size_t print_number(double value, ply_precision precision, char *out)
{
    int digits = precision == PLY_FLOAT ? 6 : 15, n = 0;
    for (int more = 0; more <= 3; more++) {
        n = snprintf(out, NUMBER_TEXT_MAX, "%.*g", digits + more, value);
        if (precision == PLY_FLOAT ? strtof(out, NULL) == (float)value : strtod(out, NULL) == value) break;
    }
    return (size_t)n;
}

static size_t print_row(const double *row, const columns *what, ply_precision precision, char *out)
{
    size_t n = 0;
    for (size_t c = 0; c < what->count; c++) {
        if (what->list[c].type == COLUMN_LONG_REAL)
            n += print_number(row[c], PLY_DOUBLE, out + n);
        else if (what->list[c].type != COLUMN_REAL)
            n += (size_t)sprintf(out + n, "%.0f", row[c]);
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

/* The type for the labels of a set's triangles. */
static column_type label_type_of(const points *set)
{
    int64_t least = 0, most = 0;
    for (size_t k = 0; set->triangle_labels && k < set->triangle_count; k++)
        for (int side = 0; side < 2; side++) {
            const int64_t label = set->triangle_labels[k][side];
            least = label < least ? label : least;
            most = label > most ? label : most;
        }
    return column_type_of_range((double)least, (double)most);
}

static bool write_header(FILE *file, const points *set, const columns *what, ply_format format,
                         ply_precision precision, const char *comments, error *e)
{
    bool good = fprintf(file, "ply\nformat %s 1.0\n%selement vertex %zu\n", format_names[format],
                        comments ? comments : "comment hexad\n", set->count) > 0;
    for (size_t c = 0; c < what->count; c++)
        good = good && fprintf(file, "property %s %s\n", type_name(what->list[c].type, precision),
                               what->list[c].name) > 0;
    if (set->triangle_count > 0)
        good = good && fprintf(file, "element face %zu\nproperty list uchar int vertex_indices\n",
                               set->triangle_count) > 0;
    const char *label = type_names[label_type_of(set)];
    if (set->triangle_count > 0 && set->triangle_labels)
        good = good && fprintf(file, "property %s label_a\nproperty %s label_b\n", label, label) > 0;
    good = good && fputs("end_header\n", file) >= 0;
    return good || write_failed(e);
}

/* Number of blocks that are filled in parallel and then written in order. */
enum { BATCH_BLOCKS = 8 };

typedef struct block {
    char *text; /* bytes to write */
    size_t bytes;
    bool good;
    error e; /* for the first point that cannot be written */
} block;

typedef struct batch {
    const points *set;
    const columns *what;
    ply_format format;
    ply_precision precision;
    size_t first; /* first point of the first block */
    block block[BATCH_BLOCKS];
} batch;

/* The range of points of a block; returns its end. */
static size_t points_of_block(const batch *job, size_t k, size_t *from)
{
    *from = job->first + k * BLOCK_POINTS;
    return job->set->count - *from < BLOCK_POINTS ? job->set->count : *from + BLOCK_POINTS;
}

static void fill_blocks(void *context, int worker, size_t begin, size_t end)
{
    batch *job = context;
    const columns *what = job->what;
    (void)worker;
    for (size_t k = begin; k < end; k++) {
        block *b = &job->block[k];
        size_t from, to = points_of_block(job, k, &from);
        const bool text = job->format == PLY_ASCII;
        b->bytes = text ? 0 : (to - from) * row_bytes(what, job->precision);
        b->good = !text && pack_rows(what, job->precision, from, to, b->text);
        if (b->good) continue;
        b->good = true;
        for (size_t i = from; b->good && i < to; i++) {
            double row[COLUMNS_MAX];
            load_row(what, i, row);
            b->good = check_row(row, what, i, job->precision, &b->e);
            if (b->good && text) b->bytes += print_row(row, what, job->precision, b->text + b->bytes);
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

static size_t print_face(const face *f, bool has_labels, char out[LINE_MAX_BYTES])
{
    int n = sprintf(out, "3 %" PRIu32 " %" PRIu32 " %" PRIu32, f->corner[0], f->corner[1], f->corner[2]);
    if (has_labels) n += sprintf(out + n, " %" PRId64 " %" PRId64, f->label[0], f->label[1]);
    out[n++] = '\n';
    out[n] = '\0';
    return (size_t)n;
}

static size_t pack_face(const face *f, bool has_labels, column_type label, char out[LINE_MAX_BYTES])
{
    out[0] = 3;
    for (int c = 0; c < 3; c++) pack(f->corner[c], COLUMN_UINT, PLY_FLOAT, out + 1 + 4 * c);
    for (int c = 0; has_labels && c < 2; c++)
        pack((double)f->label[c], label, PLY_FLOAT,
             out + FACE_BYTES + number_bytes(stored_as[label]) * (size_t)c);
    return has_labels ? FACE_BYTES + 2 * number_bytes(stored_as[label]) : FACE_BYTES;
}

static face face_of(const points *set, size_t k)
{
    face f = {0};
    memcpy(f.corner, set->triangle[k], sizeof f.corner);
    if (set->triangle_labels) memcpy(f.label, set->triangle_labels[k], sizeof f.label);
    return f;
}

static bool write_triangles(FILE *file, const points *set, ply_format format, error *e)
{
    bool good = true;
    const column_type label = label_type_of(set);
    for (size_t k = 0; good && k < set->triangle_count; k++) {
        char text[LINE_MAX_BYTES];
        const face f = face_of(set, k);
        const size_t bytes = format == PLY_ASCII ? print_face(&f, set->triangle_labels, text)
                                                 : pack_face(&f, set->triangle_labels, label, text);
        good = fwrite_unlocked(text, 1, bytes, file) == bytes;
    }
    return good || write_failed(e);
}

/* The number of blocks of a batch that have points. */
static size_t blocks_of(const batch *job)
{
    const size_t left = (job->set->count - job->first + BLOCK_POINTS - 1) / BLOCK_POINTS;
    return left < BATCH_BLOCKS ? left : BATCH_BLOCKS;
}

static void free_blocks(batch *job)
{
    for (int k = 0; k < BATCH_BLOCKS; k++) free(job->block[k].text);
}

/* Allocates the blocks for the first batch, which is the largest. */
static bool reserve_blocks(batch *job, error *e)
{
    const char *what = "the PLY file's buffer";
    const size_t rows = job->set->count < BLOCK_POINTS ? job->set->count : BLOCK_POINTS,
                 bytes = job->format == PLY_ASCII ? job->what->count * NUMBER_TEXT_MAX
                                                  : row_bytes(job->what, job->precision);
    bool ok = true;
    for (size_t k = 0; ok && k < blocks_of(job); k++)
        ok = (job->block[k].text = mem_array(rows, bytes, what, e)) != NULL;
    return ok;
}

bool ply_write(FILE *file, const points *set, const columns *what, ply_format format, ply_precision precision,
               const char *comments, threads *pool, error *e)
{
    batch job = {set, what, format, precision, 0, {{0}}};
    bool ok = write_header(file, set, what, format, precision, comments, e) && reserve_blocks(&job, e);
    for (; ok && job.first < set->count; job.first += (size_t)BATCH_BLOCKS * BLOCK_POINTS) {
        const size_t blocks = blocks_of(&job);
        threads_run(pool, blocks, 1, fill_blocks, &job);
        if (threads_stopped(pool)) ok = error_set(e, ERROR_CANCELLED, "stopped");
        ok = ok && write_blocks(file, &job, blocks, e);
    }
    free_blocks(&job);
    return ok && write_triangles(file, set, format, e) && (fflush(file) == 0 || write_failed(e));
}

/* ---- reading ---- */

static bool damaged(error *e, const char *words)
{
    return error_set(e, ERROR_INPUT_DAMAGED, "PLY file: %s", words);
}

/* Adds the column of a property. False: ply_write does not write such a property. */
static bool add_column(const ply_property *p, ply_precision precision, columns *what)
{
    column_type type = COLUMN_REAL;
    while (type < COLUMN_TYPES && number_of(type, precision) != p->type->number) type++;
    if (p->length || type == COLUMN_TYPES || what->count == COLUMNS_MAX || !columns_suits(p->name, type))
        return false;
    column *c = &what->list[what->count++];
    *c = (column){.type = type};
    snprintf(c->name, sizeof c->name, "%s", p->name);
    return true;
}

static bool take_header(const ply_header *h, ply_file *f, error *e)
{
    static const char *const axis[] = {"x", "y", "z"};
    const ply_element *vertex = h->element;
    if (h->layout == PLY_BIG) return damaged(e, "its format is binary_big_endian");
    if (h->elements != 1 || strcmp(vertex->name, "vertex") != 0)
        return damaged(e, "it has more than points, or none");
    f->format = h->layout == PLY_TEXT ? PLY_ASCII : PLY_BINARY_LITTLE_ENDIAN;
    f->precision =
        vertex->properties > 0 && vertex->property->type->number == NUMBER_DOUBLE ? PLY_DOUBLE : PLY_FLOAT;
    f->points.count = vertex->count;
    for (int k = 0; k < vertex->properties; k++) {
        const ply_property *p = &vertex->property[k];
        if (!add_column(p, f->precision, &f->columns))
            return error_set(e, ERROR_INPUT_DAMAGED, "PLY file: points have no property '%s %s'",
                             p->type->name, p->name);
    }
    for (size_t k = 0; k < 3; k++)
        if (f->columns.count < 3 || f->columns.list[k].type != COLUMN_REAL ||
            strcmp(f->columns.list[k].name, axis[k]) != 0)
            return error_set(e, ERROR_INPUT_DAMAGED, "PLY file: expected 'property %s %s'",
                             precision_names[f->precision], axis[k]);
    return true;
}

/* Reads the header. The position is then that of the first point. */
static bool read_header(FILE *file, ply_file *f, error *e)
{
    ply_header h;
    char *text = mem_array(HEADER_MOST + 1, 1, "the header of the PLY file", e);
    if (!text) return false;
    const size_t size = fread(text, 1, HEADER_MOST, file);
    text[size] = '\0';
    bool ok = ply_header_read(text, size, &h) ||
              error_set(e, ERROR_INPUT_DAMAGED, "PLY file: its header ends early, or has the line '%.*s'",
                        (int)strcspn(text + h.fault, "\r\n"), text + h.fault);
    ok = ok && take_header(&h, f, e);
    free(text);
    if (ok && fseek(file, (long)h.body, SEEK_SET) != 0)
        return error_set(e, ERROR_INTERNAL, "PLY file: it does not allow seeking");
    return ok;
}

/* Checks that the remaining bytes can hold the points, before the count is used. */
static bool check_size(FILE *file, const ply_file *f, error *e)
{
    long at = ftell(file);
    if (at < 0 || fseek(file, 0, SEEK_END) != 0)
        return error_set(e, ERROR_INTERNAL, "PLY file: it does not allow seeking");
    long end = ftell(file);
    if (end < at || fseek(file, at, SEEK_SET) != 0)
        return error_set(e, ERROR_INTERNAL, "PLY file: it does not allow seeking");
    const size_t left = (size_t)(end - at), count = f->points.count;
    const bool text = f->format == PLY_ASCII; /* a number then needs at least a digit and a space */
    const size_t point = text ? 2 * f->columns.count : row_bytes(&f->columns, f->precision);
    if (count > left / point || (!text && count * point != left))
        return error_set(e, ERROR_INPUT_DAMAGED,
                         "PLY file: %zu bytes of data do not match the %zu points of its header", left,
                         count);
    return true;
}

static void unpack_row(const char *in, const columns *what, ply_precision precision, double *row)
{
    for (size_t c = 0; c < what->count; c++) {
        const number_type number = number_of(what->list[c].type, precision);
        row[c] = number_value(in, number, NUMBER_LITTLE_SWAPPED);
        in += number_bytes(number);
    }
}

/* Whether the text is a number of the type: an integer as print_row writes it. A file does not say whether
 * the numbers of a property of doubles are whole. */
static bool is_of_type(const char *text, size_t length, double value, column_type type)
{
    char again[NUMBER_TEXT_MAX];
    if (type == COLUMN_REAL || type == COLUMN_DOUBLE || type == COLUMN_LONG_REAL) return true;
    if (!(value >= type_least[type] && value <= type_most[type])) return false;
    int n = snprintf(again, sizeof again, "%.0f", value);
    return (size_t)n == length && memcmp(again, text, length) == 0;
}

static bool wrong_line(const columns *what, error *e)
{
    return error_set(e, ERROR_INPUT_DAMAGED, "PLY file: a line is not %zu numbers", what->count);
}

static bool parse_row(FILE *file, const columns *what, ply_precision precision, double *row, error *e)
{
    char line[COLUMNS_MAX * NUMBER_TEXT_MAX], *at = line;
    if (!fgets(line, sizeof line, file)) return damaged(e, "it is truncated");
    for (size_t c = 0; c < what->count; c++) {
        const column_type type = what->list[c].type;
        size_t n = strspn(at, "0123456789+-.eE");
        char *end = at, stop = c + 1 < what->count ? ' ' : '\n';
        if (n > 0)
            row[c] =
                type == COLUMN_REAL && precision == PLY_FLOAT ? (double)strtof(at, &end) : strtod(at, &end);
        if (end != at + n || *end != stop || n == 0 || !is_of_type(at, n, row[c], type))
            return wrong_line(what, e);
        at = end + 1;
    }
    return !*at || wrong_line(what, e);
}

static bool check_finite(const double *row, const columns *what, size_t i, error *e)
{
    for (size_t c = 0; c < what->count; c++)
        if (!isfinite(row[c]))
            return error_set(e, ERROR_INPUT_DAMAGED, "PLY file: point %zu has %s = %g", i, what->list[c].name,
                             row[c]);
    return true;
}

static bool read_row(FILE *file, const ply_file *f, size_t i, double *row, error *e)
{
    char packed[COLUMNS_MAX * 8];
    size_t bytes = row_bytes(&f->columns, f->precision);
    if (f->format == PLY_ASCII) {
        if (!parse_row(file, &f->columns, f->precision, row, e)) return error_prefix(e, "point %zu", i);
    } else {
        if (fread_unlocked(packed, 1, bytes, file) != bytes) return damaged(e, "it is truncated");
        unpack_row(packed, &f->columns, f->precision, row);
    }
    return check_finite(row, &f->columns, i, e);
}

static bool read_end(FILE *file, error *e)
{
    return fgetc(file) == EOF || damaged(e, "it has data after its last point");
}

static bool read_start(FILE *file, ply_file *f, error *e)
{
    if (fseek(file, 0, SEEK_SET) != 0)
        return error_set(e, ERROR_INTERNAL, "PLY file: it does not allow seeking");
    return read_header(file, f, e) && check_size(file, f, e);
}

bool ply_read(FILE *file, ply_file *out, error *e)
{
    ply_file f = {0};
    double row[COLUMNS_MAX];
    if (!read_start(file, &f, e)) return false;
    bool ok = columns_lay_out(&f.columns, &f.points, &f.storage, e);
    for (size_t i = 0; ok && i < f.points.count; i++) {
        ok = read_row(file, &f, i, row, e);
        for (size_t c = 0; ok && c < f.columns.count; c++) column_store(&f.columns.list[c], i, row[c]);
    }
    if (ok && read_end(file, e)) {
        *out = f;
        return true;
    }
    ply_file_free(&f);
    return false;
}

bool ply_write_job(FILE *file, void *job, error *e)
{
    const ply_job *j = job;
    return ply_write(file, j->set, &j->what, j->format, j->precision, j->comments, j->pool, e);
}

void ply_file_free(ply_file *file)
{
    if (!file) return;
    free(file->storage);
    *file = (ply_file){0};
}
