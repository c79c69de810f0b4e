#include "run/source.h"

#include <stdlib.h>
#include <unistd.h>

#include "volume/coefficients.h"

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

static volume *open_grid(const spec_vdb *v, int fd, size_t memory, isa kernels, error *e)
{
    const volume_request request = {
        .fd = fd,
        .path = v->path,
        .grid = v->grid,
        .has_isovalue = v->has_isovalue,
        .isovalue = v->isovalue,
        .reconstruction =
            v->reconstruction == SPEC_RECONSTRUCTION_SMOOTHING ? VOLUME_SMOOTHING : VOLUME_INTERPOLATING,
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

static bool open_volume(const spec *s, const store_roots *roots, size_t memory, isa kernels, threads *pool,
                        source *out, error *e)
{
    spec_input input;
    if (!spec_input_at(s, 0, &input)) return error_set(e, ERROR_INTERNAL, "a volume without a file");
    int fd = store_open_input(roots, input.path, e);
    if (fd < 0) return false;
    bool ok = store_file_hash(fd, out->input_sha256, &out->input_bytes, e);
    if (ok)
        out->volume = s->surface_kind == SPEC_SURFACE_MESH ? open_mesh(&s->mesh, fd, memory, kernels, pool, e)
                                                           : open_grid(&s->vdb, fd, memory, kernels, e);
    ok = out->volume != NULL;
    if (ok && s->has_grid)
        ok = (out->map = map_open(fd, input.path, s->grid.name, memory - source_memory(out), e)) != NULL;
    close(fd);
    if (!ok) return false;
    out->input_path = input.path;
    out->field = volume_field(out->volume);
    return true;
}

static bool read_coefficients(const spec_bspline *b, const store_roots *roots, size_t memory, source *out,
                              error *e)
{
    int fd = store_open_input(roots, b->path, e);
    if (fd < 0) return false;
    bool ok = store_file_hash(fd, out->input_sha256, &out->input_bytes, e) &&
              (out->coefficients = coefficients_read(fd, b->path, b->dims, memory, e)) != NULL;
    close(fd);
    out->input_path = b->path;
    return ok;
}

static bool open_bspline(const spec_bspline *b, const store_roots *roots, size_t memory, isa kernels,
                         threads *pool, source *out, error *e)
{
    if (b->path && !read_coefficients(b, roots, memory, out, e)) return false;
    const bspline_params params = {{b->dims[0], b->dims[1], b->dims[2]},
                                   {b->domain.min, b->domain.max},
                                   b->path ? out->coefficients : b->coefficients,
                                   kernels};
    out->bspline = bspline_new(&params, pool, e);
    if (!out->bspline) return b->path ? error_prefix(e, "%s", b->path) : false;
    out->field = &out->bspline->base;
    return true;
}

static bool open_whole(const spec *s, const store_roots *roots, size_t memory, isa kernels, threads *pool,
                       source *out, error *e)
{
    switch (s->surface_kind) {
    case SPEC_SURFACE_VDB:
    case SPEC_SURFACE_MESH:
        return open_volume(s, roots, memory, kernels, pool, out, e);
    case SPEC_SURFACE_BSPLINE:
        return open_bspline(&s->bspline, roots, memory, kernels, pool, out, e);
    case SPEC_SURFACE_ANALYTIC:
        return open_analytic(&s->analytic, pool, out, e);
    }
    return false;
}

bool source_open(const spec *s, const store_roots *roots, size_t memory, isa kernels, threads *pool,
                 source *out, error *e)
{
    *out = (source){0};
    if (!open_whole(s, roots, memory, kernels, pool, out, e)) return false;
    if (!s->has_region) return true;
    out->region = region_new(out->field, (bbox){s->region.min, s->region.max}, e);
    if (!out->region) return out->input_path ? error_prefix(e, "%s", out->input_path) : false;
    out->field = region_field(out->region);
    return true;
}

void source_close(source *s)
{
    region_free(s->region);
    analytic_free(s->analytic);
    bspline_free(s->bspline);
    volume_close(s->volume);
    map_close(s->map);
    free(s->coefficients);
    *s = (source){0};
}

static void describe_volume(const volume_info *info, json *surface, json *warnings)
{
    json_put_integer(surface, "voxels", (int64_t)info->active_voxels);
    if (info->triangles == 0) {
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
    if (!s->input_path) return;
    json *input = json_append_object(inputs);
    json_put_string(input, "path", s->input_path);
    json_put_integer(input, "bytes", (int64_t)s->input_bytes);
    json_put_string(input, "sha256", s->input_sha256);
}

size_t source_memory(const source *s)
{
    size_t bytes = s->region ? region_bytes(s->region) : 0;
    if (s->volume) bytes += volume_describe(s->volume)->memory_bytes + map_memory(s->map);
    if (s->analytic) bytes += cell_grid_bytes(&s->analytic->grid);
    if (s->bspline) bytes += bspline_bytes(s->bspline);
    return bytes;
}
