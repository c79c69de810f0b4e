#include "run/source.h"

#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/memory.h"
#include "volume/coefficients.h"
#include "volume/exr_stack.h"
#include "volume/stored.h"

/* Opens an input; the first time it is hashed and noted. Returns a descriptor, or -1. */
static int open_input(void *context, const char *path, error *e)
{
    source *s = context;
    source_input input = {0};
    int fd = store_open_input(s->roots, path, e);
    for (size_t k = s->input_count; fd >= 0 && k > 0; k--) /* a file beside others is asked for in their order */
        if (strcmp(s->inputs[k - 1].path, path) == 0) return fd;
    if (fd < 0) return -1;
    if (!store_file_hash(fd, input.sha256, &input.bytes, e)) {
        close(fd);
        return -1;
    }
    input.path = mem_strdup(path);
    s->inputs = mem_resize(s->inputs, (s->input_count + 1) * sizeof *s->inputs);
    s->inputs[s->input_count++] = input;
    return fd;
}

static analytic_shape shape_of(spec_shape shape)
{
    static const analytic_shape shapes[] = {
        [SPEC_SHAPE_SPHERE] = ANALYTIC_SPHERE,   [SPEC_SHAPE_TORUS] = ANALYTIC_TORUS,
        [SPEC_SHAPE_BOX] = ANALYTIC_BOX,         [SPEC_SHAPE_ELLIPSOID] = ANALYTIC_ELLIPSOID,
        [SPEC_SHAPE_QUARTIC] = ANALYTIC_QUARTIC, [SPEC_SHAPE_GYROID] = ANALYTIC_GYROID,
    };
    return shapes[shape];
}

static bool open_analytic(const spec_analytic *a, threads *pool, source *out, error *e)
{
    const analytic_params params = {
        .shape = shape_of(a->shape),
        .center = a->center,
        .radius = a->radius,
        .axis = a->axis,
        .major_radius = a->major_radius,
        .minor_radius = a->minor_radius,
        .half_size = a->half_size,
        .rounding = a->rounding,
        .radii = a->radii,
        .r = a->r,
        .size = a->size,
        .period = a->period,
    };
    out->analytic = analytic_new(&params, pool, e);
    if (!out->analytic) return false;
    out->field = &out->analytic->base;
    return true;
}

static volume_reconstruction reconstruction_of(spec_reconstruction how)
{
    return how == SPEC_RECONSTRUCTION_SMOOTHING ? VOLUME_SMOOTHING : VOLUME_INTERPOLATING;
}

static volume *open_grid(const spec_vdb *v, int fd, size_t memory, isa kernels, error *e)
{
    const volume_request request = {
        .fd = fd,
        .path = v->path,
        .grid = v->grid,
        .has_isovalue = v->has_isovalue,
        .isovalue = v->isovalue,
        .reconstruction = reconstruction_of(v->reconstruction),
        .memory_limit = memory,
        .isa = kernels,
    };
    return volume_open(&request, e);
}

static volume *open_mesh(const spec_mesh *m, int fd, size_t memory, isa kernels, threads *pool, error *e)
{
    const volume_mesh_request request = {
        .fd = fd,
        .path = m->path,
        .voxel_size = m->voxel_size,
        .resolution = m->resolution,
        .band_vox = m->band_vox,
        .memory_limit = memory,
        .pool = pool,
        .isa = kernels,
    };
    return volume_open_mesh(&request, e);
}

/* Takes over the slices, which may be NULL. */
static volume *open_dense(slices *from, const char *path, double isovalue, spec_reconstruction how, size_t memory,
                          isa kernels, error *e)
{
    if (!from) {
        error_prefix(e, "%s", path);
        return NULL;
    }
    const volume_dense_request request = {from, path, isovalue, reconstruction_of(how), memory, kernels};
    volume *v = volume_open_dense(&request, e);
    from->ops->close(from);
    return v;
}

static bool open_stored(const spec_volume *v, size_t memory, isa kernels, source *out, error *e)
{
    const slices_files files = {open_input, out};
    int fd = open_input(out, v->path, e);
    if (fd < 0) return false;
    out->volume = open_dense(stored_open(fd, v->path, NULL, &files, e), v->path, v->isovalue, v->reconstruction, memory,
                             kernels, e);
    close(fd);
    return out->volume != NULL;
}

static bool open_exr(const spec_exr *x, size_t memory, isa kernels, source *out, error *e)
{
    const slices_files files = {open_input, out};
    const exr_stack_params params = {x->count,      (const char *const *)x->files, x->numbers, x->part, x->channel,
                                     x->voxel_size, x->origin,                     NULL,       memory,  &files};
    out->volume =
        open_dense(exr_stack_open(&params, e), x->path, x->isovalue, x->reconstruction, memory, kernels, e);
    return out->volume != NULL;
}

static bool open_volume(const spec *s, size_t memory, isa kernels, threads *pool, source *out, error *e)
{
    spec_input input;
    if (!spec_input_at(s, 0, &input)) return error_set(e, ERROR_INTERNAL, "a volume without a file");
    int fd = open_input(out, input.path, e);
    if (fd < 0) return false;
    out->volume = s->surface_kind == SPEC_SURFACE_MESH ? open_mesh(&s->mesh, fd, memory, kernels, pool, e)
                                                       : open_grid(&s->vdb, fd, memory, kernels, e);
    bool ok = out->volume != NULL;
    if (ok && s->has_grid)
        ok = (out->map = map_open(fd, input.path, s->grid.name, memory - source_memory(out), e)) != NULL;
    close(fd);
    return ok;
}

static bool read_coefficients(const spec_bspline *b, size_t memory, source *out, error *e)
{
    int fd = open_input(out, b->path, e);
    if (fd < 0) return false;
    bool ok = (out->coefficients = coefficients_read(fd, b->path, b->dims, memory, e)) != NULL;
    close(fd);
    return ok;
}

static bool open_bspline(const spec_bspline *b, size_t memory, isa kernels, threads *pool, source *out, error *e)
{
    if (b->path && !read_coefficients(b, memory, out, e)) return false;
    const bspline_params params = {{b->dims[0], b->dims[1], b->dims[2]},
                                   {b->domain.min, b->domain.max},
                                   b->path ? out->coefficients : b->coefficients,
                                   kernels};
    out->bspline = bspline_new(&params, pool, e);
    if (!out->bspline) return b->path ? error_prefix(e, "%s", b->path) : false;
    out->field = &out->bspline->base;
    return true;
}

static bool open_whole(const spec *s, size_t memory, isa kernels, threads *pool, source *out, error *e)
{
    bool ok = false;
    switch (s->surface_kind) {
    case SPEC_SURFACE_VDB:
    case SPEC_SURFACE_MESH:
        ok = open_volume(s, memory, kernels, pool, out, e);
        break;
    case SPEC_SURFACE_VOLUME:
        ok = open_stored(&s->volume, memory, kernels, out, e);
        break;
    case SPEC_SURFACE_EXR:
        ok = open_exr(&s->exr, memory, kernels, out, e);
        break;
    case SPEC_SURFACE_BSPLINE:
        return open_bspline(&s->bspline, memory, kernels, pool, out, e);
    case SPEC_SURFACE_ANALYTIC:
        return open_analytic(&s->analytic, pool, out, e);
    }
    if (ok) out->field = volume_field(out->volume);
    return ok;
}

/* Rims lie on faces of boxes that are aligned with the world's axes; oblique data must not end within them. */
static bool check_ends(const source *s, error *e)
{
    size_t loose = s->volume ? volume_loose_ends(s->volume, s->field->domain) : 0;
    if (loose == 0) return true;
    return error_set(e, ERROR_INPUT_UNSUPPORTED,
                     "%s: its surface meets the end of the data in %zu cells, and the data lie obliquely in world "
                     "space: give a region (a box along the world's axes) that keeps clear of the end of the data, or "
                     "another isovalue",
                     s->inputs[0].path, loose);
}

bool source_open(const spec *s, const store_roots *roots, size_t memory, isa kernels, threads *pool,
                 source *out, error *e)
{
    *out = (source){.roots = roots};
    if (!open_whole(s, memory, kernels, pool, out, e)) return false;
    if (s->has_region) {
        out->region = region_new(out->field, (bbox){s->region.min, s->region.max}, e);
        if (!out->region) return out->input_count ? error_prefix(e, "%s", out->inputs[0].path) : false;
        out->field = region_field(out->region);
    }
    return check_ends(out, e);
}

void source_close(source *s)
{
    region_free(s->region);
    analytic_free(s->analytic);
    bspline_free(s->bspline);
    volume_close(s->volume);
    map_close(s->map);
    free(s->coefficients);
    for (size_t k = 0; k < s->input_count; k++) free(s->inputs[k].path);
    free(s->inputs);
    *s = (source){0};
}

static void describe_volume(const volume_info *info, json *surface, json *warnings)
{
    json_put_integer(surface, "voxels", (int64_t)info->active_voxels);
    if (*info->format) {
        json *dense = json_put_object(surface, "volume");
        json *size = json_put_array(dense, "size");
        json_put_string(dense, "format", info->format);
        for (int k = 0; k < 3; k++) json_append_number(size, (double)info->size[k]);
        if (*info->space) json_put_string(dense, "space", info->space);
        json_put_number(surface, "isovalue", info->isovalue);
    } else if (info->triangles == 0) {
        json_put_string(surface, "grid", info->grid);
        json_put_number(surface, "isovalue", info->isovalue);
    } else {
        json *of_mesh = json_put_object(surface, "mesh");
        json_put_integer(of_mesh, "triangles", (int64_t)info->triangles);
        json_put_number(of_mesh, "area", info->fidelity.area);
        json_put_number(of_mesh, "rms_distance_vox", info->fidelity.rms_vox);
        json_put_number(of_mesh, "close_fraction", info->fidelity.close);
        json_put_number(of_mesh, "unresolved_fraction", info->fidelity.unresolved);
    }
    json_put_number(surface, "voxel_size", info->voxel_size);
    json_put_integer(surface, "crossing_cells", (int64_t)info->crossing_cells);
    json_put_integer(surface, "bricks", (int64_t)info->bricks);
    for (size_t k = 0; k < info->warning_count; k++) json_append_string(warnings, info->warning[k]);
}

void source_describe(const source *s, json *report, json *surface, json *warnings)
{
    json *inputs = json_put_array(report, "inputs");
    if (s->volume) describe_volume(volume_describe(s->volume), surface, warnings);
    for (size_t k = 0; k < s->input_count; k++) {
        json *input = json_append_object(inputs);
        json_put_string(input, "path", s->inputs[k].path);
        json_put_integer(input, "bytes", (int64_t)s->inputs[k].bytes);
        json_put_string(input, "sha256", s->inputs[k].sha256);
    }
}

size_t source_memory(const source *s)
{
    size_t bytes = s->region ? region_bytes(s->region) : 0;
    if (s->volume) bytes += volume_describe(s->volume)->memory_bytes + map_memory(s->map);
    if (s->analytic) bytes += cell_grid_bytes(&s->analytic->grid);
    if (s->bspline) bytes += bspline_bytes(s->bspline);
    return bytes;
}
