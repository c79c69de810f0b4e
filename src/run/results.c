#include "run/results.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "formats/ply.h"
#include "formats/preview_exr.h"
#include "formats/preview_png.h"
#include "store/file.h"

/* Hashes the verified file, names it in the list, and puts it in place. */
static bool commit_output(store_file *file, const char *name, json *outputs, error *e)
{
    char sha256[STORE_HASH_SIZE];
    uint64_t bytes;
    if (!store_file_hash(fileno(file->stream), sha256, &bytes, e)) {
        store_file_abort(file);
        return false;
    }
    if (!store_file_commit(file, e)) return false;
    json *output = json_append_object(outputs);
    json_put_string(output, "name", name);
    json_put_integer(output, "bytes", (int64_t)bytes);
    json_put_string(output, "sha256", sha256);
    return true;
}

static bool same_column(const double *written, const double *meant, size_t count, bool as_float)
{
    for (size_t i = 0; i < count; i++)
        if (written[i] != (as_float ? (double)(float)meant[i] : meant[i])) return false;
    return true;
}

static bool same_points(const points *written, const points *meant, bool as_float)
{
    size_t n = meant->count;
    if (written->count != n) return false;
    /* a vec3 is three doubles */
    return same_column(&written->position->x, &meant->position->x, 3 * n, as_float) &&
           same_column(&written->normal->x, &meant->normal->x, 3 * n, as_float) &&
           same_column(written->kappa, meant->kappa, n, as_float) &&
           same_column(written->kappa1, meant->kappa1, n, as_float) &&
           same_column(written->kappa2, meant->kappa2, n, as_float) &&
           same_column(written->alpha, meant->alpha, n, as_float) &&
           same_column(written->energy, meant->energy, n, as_float) &&
           same_column(written->spacing, meant->spacing, n, as_float) &&
           same_column(written->spacing_local, meant->spacing_local, n, as_float);
}

/* Through memory: gcc 12 at -O3 drops the two conversions when it puts x and y into one vector. */
static double rounded(double value)
{
    volatile float single = (float)value;
    return single;
}

/* Of the positions, rounded to floats or not. */
static double largest_residual(const field *f, const points *set, bool as_float, double h)
{
    double worst = 0;
    for (size_t i = 0; i < set->count; i++) {
        vec3 x = set->position[i];
        if (as_float) x = (vec3){rounded(x.x), rounded(x.y), rounded(x.z)};
        field_sample s;
        if (!field_sample_at(f, x, FIELD_GRADIENT, &s)) return INFINITY;
        double length = vec3_norm(s.gradient);
        worst = fmax(worst, length > 0 ? fabs(s.value) / length / h : INFINITY);
    }
    return worst;
}

static bool write_ply(const char *directory, const spec *s, const points *set, bool as_float, json *outputs,
                      error *e)
{
    char *path = mem_printf("%s/points.ply", directory);
    store_file file = {0};
    ply_file read = {0};
    bool ok =
        store_file_begin(path, &file, e) &&
        ply_write(file.stream, set, s->ply_format == SPEC_PLY_ASCII ? PLY_ASCII : PLY_BINARY_LITTLE_ENDIAN,
                  as_float ? PLY_FLOAT : PLY_DOUBLE, e) &&
        ply_read(file.stream, &read, e);
    if (ok && !same_points(&read.points, set, as_float))
        ok = error_set(e, ERROR_INTERNAL, "points.ply does not read back as it was written");
    if (ok) ok = commit_output(&file, "points.ply", outputs, e);
    store_file_abort(&file);
    ply_file_free(&read);
    free(path);
    return ok;
}

static bool write_png(const char *directory, const image *picture, json *outputs, error *e)
{
    char *path = mem_printf("%s/preview.png", directory);
    store_file file = {0};
    bool ok = store_file_begin(path, &file, e) && preview_png_write(file.stream, picture, e) &&
              preview_png_verify(file.stream, picture, e) && commit_output(&file, "preview.png", outputs, e);
    store_file_abort(&file);
    free(path);
    return ok;
}

static bool write_exr(const char *directory, const image *picture, json *outputs, error *e)
{
    char *path = mem_printf("%s/preview.exr", directory);
    store_file file = {0};
    bool ok = store_file_begin(path, &file, e) && preview_exr_write(file.stream, picture, e) &&
              preview_exr_verify(file.stream, picture, e) && commit_output(&file, "preview.exr", outputs, e);
    store_file_abort(&file);
    free(path);
    return ok;
}

static bool write_preview(const char *directory, const spec *s, const points *set, threads *pool, json *outputs,
                          error *e)
{
    const preview_options options = {s->preview_width, s->preview_height,
                                     s->preview_color == SPEC_COLOR_ALPHA ? PREVIEW_ALPHA
                                                                          : PREVIEW_CURVATURE};
    image *picture;
    if (!preview_render(set, &options, pool, &picture, e)) return false;
    bool ok = write_png(directory, picture, outputs, e) && write_exr(directory, picture, outputs, e);
    preview_free(picture);
    return ok;
}

bool results_write(const char *directory, const spec *s, const field *f, const points *set, double h,
                   threads *pool, json *outputs, results_facts *out, error *e)
{
    bool as_float = s->ply_precision == SPEC_PRECISION_FLOAT;
    results_facts facts = {largest_residual(f, set, as_float, h), false};
    if (as_float && !(facts.max_residual <= RESULTS_RESIDUAL)) {
        as_float = false;
        facts = (results_facts){largest_residual(f, set, false, h), true};
    }
    if (!write_ply(directory, s, set, as_float, outputs, e)) return false;
    if (s->has_preview && !write_preview(directory, s, set, pool, outputs, e)) return false;
    *out = facts;
    return true;
}

bool results_write_report(const char *directory, const json *report, error *e)
{
    char *path = mem_printf("%s/report.json", directory), *text = json_print_pretty(report);
    size_t length = strlen(text);
    store_file file = {0};
    bool ok = store_file_begin(path, &file, e);
    if (ok && (fwrite(text, 1, length, file.stream) != length || fflush(file.stream) != 0))
        ok = error_set(e, ERROR_INTERNAL, "cannot write %s: %m", path);
    if (ok) {
        char *back = mem_alloc(length + 1);
        rewind(file.stream);
        if (fread(back, 1, length + 1, file.stream) != length || memcmp(back, text, length) != 0)
            ok = error_set(e, ERROR_INTERNAL, "report.json does not read back as it was written");
        free(back);
    }
    if (ok) ok = store_file_commit(&file, e);
    store_file_abort(&file);
    free(text);
    free(path);
    return ok;
}
