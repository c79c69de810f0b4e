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

/* Through memory: gcc 12 at -O3 drops the two conversions when it puts x and y into one vector. */
static double rounded(double value)
{
    volatile float single = (float)value;
    return single;
}

/* Points in a chunk of work. */
enum { GRAIN = 4096 };

typedef struct residual_job {
    const field *field;
    const points *set;
    bool as_float;
    double *worst; /* of each chunk, |F| / |grad F| */
} residual_job;

static void residual_chunk(void *context, int worker, size_t begin, size_t end)
{
    const residual_job *job = context;
    double worst = 0;
    (void)worker;
    for (size_t i = begin; i < end; i++) {
        vec3 x = job->set->position[i];
        if (job->as_float) x = (vec3){rounded(x.x), rounded(x.y), rounded(x.z)};
        field_sample s = {0};
        double length = field_sample_at(job->field, x, FIELD_GRADIENT, &s) ? vec3_norm(s.gradient) : 0;
        worst = fmax(worst, length > 0 ? fabs(s.value) / length : INFINITY);
    }
    job->worst[begin / GRAIN] = worst;
}

/* Of the positions, rounded to floats or not, over h. */
static double largest_residual(const field *f, const points *set, bool as_float, double h, threads *pool)
{
    size_t chunks = set->count / GRAIN + 1;
    residual_job job = {f, set, as_float, mem_alloc(chunks * sizeof *job.worst)};
    double worst = 0;
    threads_run(pool, set->count, GRAIN, residual_chunk, &job);
    for (size_t k = 0; k < chunks; k++) worst = fmax(worst, job.worst[k] / h);
    free(job.worst);
    return worst;
}

static bool write_ply(const char *directory, const char *name, const spec *s, const points *set, bool as_float,
                      threads *pool, json *outputs, error *e)
{
    ply_format format = s->ply_format == SPEC_PLY_ASCII ? PLY_ASCII : PLY_BINARY_LITTLE_ENDIAN;
    ply_precision precision = as_float ? PLY_FLOAT : PLY_DOUBLE;
    char *path = mem_printf("%s/%s", directory, name);
    store_file file = {0};
    bool ok = store_file_begin(path, &file, e) && ply_write(file.stream, set, format, precision, pool, e);
    if (ok && !ply_verify(file.stream, set, format, precision, pool, e))
        ok = error_prefix(e, "%s does not read back as it was written", name);
    if (ok) ok = commit_output(&file, name, outputs, e);
    store_file_abort(&file);
    free(path);
    return ok;
}

static bool write_mesh(const char *directory, const spec *s, const field *f, const points *set, bool as_float,
                       threads *pool, json *outputs, triangulation_facts *out, error *e)
{
    const triangulation_input in = {set->count, set->position, set->normal, set->spacing, f->open, f->rims};
    triangulation made;
    points vertices = *set;
    bool ok = triangulation_make(&in, pool, &made, e);
    vertices.triangle_count = made.facts.triangles;
    vertices.triangle = (const uint32_t(*)[3])made.corner;
    ok = ok && write_ply(directory, "mesh.ply", s, &vertices, as_float, pool, outputs, e);
    if (ok) *out = made.facts;
    triangulation_free(&made);
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

static bool write_preview(const char *directory, const spec *s, const points *set, threads *pool,
                          json *outputs, error *e)
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
    results_facts facts = {.max_residual = largest_residual(f, set, as_float, h, pool), .has_mesh = s->has_mesh};
    if (as_float && !(facts.max_residual <= RESULTS_RESIDUAL)) {
        as_float = false;
        facts.max_residual = largest_residual(f, set, false, h, pool);
        facts.widened = true;
    }
    if (!write_ply(directory, "points.ply", s, set, as_float, pool, outputs, e)) return false;
    if (s->has_mesh && !write_mesh(directory, s, f, set, as_float, pool, outputs, &facts.mesh, e)) return false;
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
