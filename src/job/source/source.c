// SPDX-License-Identifier: Apache-2.0
#include "job/source/source.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/core/memory.h"
#include "io/volumes/coefficients.h"
#include "io/volumes/exr_stack.h"
#include "io/volumes/volume_file.h"
#include "geometry/space/affine.h"
#include "job/source/creased_source.h"
#include "job/source/label_source.h"
#include "job/source/mesh_source.h"
#include "job/source/plan.h"
#include "files/sent_file.h"

/* Tolerance, as a share of the squared scale, for columns of a rotation that are orthonormal up to decimal
 * rounding.
 */
static const double ANGLE_ROUNDING = 1e-6;

/* Margins, as fractions of the longest side, by which an unbounded surface extends beyond a region, so that
 * the region cuts it. They differ at the two ends, so that planes through the middle of a region contain no
 * corners of cells: the areas at edges in such planes would be 3e-3 too small. */
static const double BEYOND_LOW = 0.0317, BEYOND_HIGH = 0.0456;

/* Maximum number of times that the cells of a combination are halved in thin walls; for a combination within
 * another one, whose cells become as small. */
enum { WALL_LEVELS = 12, WALL_LEVELS_WITHIN = 1 };

/* Voxels of a level set along the spacing of the points, if it is a part of a combination, whose cells are as small as the
 * smallest voxel of a part: 60 points on two octahedra took 14 s of CPU time with 256 voxels along the longest sides. */
static const double VOXELS_PER_SPACING = 16;

/* Checks that an uploaded file has the hash that is its name. */
static bool check_upload(const source_input *input, error *e)
{
    char name[STORE_INPUT_NAME_SIZE];
    return !sent_file_match(input->path, name) ||
           strcmp(name + strlen(STORE_INPUT_PREFIX), input->facts.sha256) == 0 ||
           error_set(
               e, ERROR_INPUT_DAMAGED,
               "%s: the uploaded file is damaged: its bytes no longer have the SHA-256 that is its name. "
               "Send the file again (hexadctl upload FILE), then retry the job.",
               input->path);
}

/* Waits for the hash of the last opened input; no other hash is in progress. */
static bool settle_hash(source *s, error *e)
{
    late_hash *h = s->hash;
    source_input *last = h ? &s->inputs[s->input_count - 1] : NULL;
    s->hash = NULL;
    return !h || (late_hash_end(h, &last->facts, e) && check_upload(last, e));
}

/* The input with this path if it was opened before. Inputs that are hashed while they are read are opened
 * one after the other. */
static source_input *find_input(source *s, const char *path)
{
    size_t k = s->input_count;
    while (k > 0 && strcmp(s->inputs[k - 1].path, path) != 0) k--;
    return k ? &s->inputs[k - 1] : NULL;
}

/* Opens an input. The first time it is added to the list, and its hash is started. Returns a descriptor, or
 * -1. */
static int open_input(void *context, const char *path, error *e)
{
    source *s = context;
    store_identity identity = {0};
    int fd = store_open_input(s->roots, path, e);
    if (fd < 0) return -1;
    bool known = store_identify(fd, &identity);
    source_input *before = find_input(s, path);
    if (before) {
        before->changed |= !known || !store_identity_equals(&before->identity, &identity);
        return fd;
    }
    if (!settle_hash(s, e)) {
        close(fd);
        return -1;
    }
    s->inputs = mem_resize(s->inputs, (s->input_count + 1) * sizeof *s->inputs);
    s->inputs[s->input_count++] =
        (source_input){.path = mem_strdup(path), .identity = identity, .changed = !known};
    s->hash = late_hash_begin(fd, s->hashes_beside);
    if (s->hashes_beside || settle_hash(s, e)) return fd;
    close(fd);
    return -1;
}

/* As open_input, for a path that may be a directory, whose files are then opened below *tree. -1: an error,
 * or a directory. */
static int open_file_or_tree(source *s, const char *path, store_tree **tree, error *e)
{
    bool is_directory = false;
    *tree = NULL;
    const int fd = store_open_place(s->roots, path, &is_directory, e);
    if (fd < 0) return -1;
    if (!is_directory) {
        close(fd);
        return open_input(s, path, e);
    }
    source_input *before = find_input(s, path);
    if (before && before->tree) {
        *tree = before->tree;
        close(fd);
        return -1;
    }
    if (!settle_hash(s, e)) {
        close(fd);
        return -1;
    }
    *tree = store_tree_new(fd, true);
    s->inputs = mem_resize(s->inputs, (s->input_count + 1) * sizeof *s->inputs);
    s->inputs[s->input_count++] = (source_input){.path = mem_strdup(path), .tree = *tree, .changed = true};
    return -1;
}

static int open_in_tree(void *context, const char *path, bool *is_missing, error *e)
{
    return store_tree_open(context, path, is_missing, e);
}

/* Finishes the hashes and identities of directories after their files were read. */
static void settle_trees(source *s)
{
    for (size_t k = 0; k < s->input_count; k++) {
        source_input *input = &s->inputs[k];
        bool has_changed;
        if (!input->tree) continue;
        store_tree_facts(input->tree, &input->facts, &has_changed);
        store_tree_free(input->tree);
        input->tree = NULL;
    }
}

int source_open_file(source *s, const char *path, error *e)
{
    return open_input(s, path, e);
}

static analytic_shape shape_of(spec_shape shape)
{
    static const analytic_shape shapes[SPEC_SHAPE_COUNT] = {
        [SPEC_SHAPE_SPHERE] = ANALYTIC_SPHERE,    [SPEC_SHAPE_TORUS] = ANALYTIC_TORUS,
        [SPEC_SHAPE_BOX] = ANALYTIC_BOX,          [SPEC_SHAPE_ELLIPSOID] = ANALYTIC_ELLIPSOID,
        [SPEC_SHAPE_QUARTIC] = ANALYTIC_QUARTIC,  [SPEC_SHAPE_GYROID] = ANALYTIC_GYROID,
        [SPEC_SHAPE_CYLINDER] = ANALYTIC_FRUSTUM, [SPEC_SHAPE_CONE] = ANALYTIC_FRUSTUM,
        [SPEC_SHAPE_CAPSULE] = ANALYTIC_FRUSTUM,  [SPEC_SHAPE_HALFSPACE] = ANALYTIC_HALFSPACE};
    return shapes[shape];
}

/* The core that is grown by the rounding; zero for other shapes. */
static analytic_frustum core_of(const spec_analytic *a)
{
    double r = a->rounding, half = 0.5 * a->height;
    switch (a->shape) {
    case SPEC_SHAPE_CYLINDER:
        return (analytic_frustum){r - half, half - r, a->radius - r, a->radius - r};
    case SPEC_SHAPE_CONE:
        return (analytic_frustum){-half, half, a->radius, a->top_radius};
    case SPEC_SHAPE_CAPSULE:
        return (analytic_frustum){-half, half, 0, 0};
    default:
        return (analytic_frustum){0, 0, 0, 0};
    }
}

/* Parameters for opening a surface, in addition to its spec. */
typedef struct opening {
    size_t memory, most_memory; /* see source_memory_limits */
    isa kernels;
    threads *pool;
    source *source; /* receives the inputs; memory that it uses already is subtracted from the limit */
    const spec *spec;
    size_t leaves; /* number of leaves (formulas, volumes and meshes), among which the points are
                    * distributed */
    bbox bounds;   /* bounds of half-spaces, in the space of the current part */
    bool direct;   /* the current part is the whole surface, or the only part of transforms of the whole */
    bool placed;   /* the current part is transformed */
    double to_world[3][4]; /* the identity if not placed */
    const char *where;     /* JSON Pointer of the current part */
} opening;

/* Longer pointers are truncated in messages. */
enum { POINTER_SIZE = 256 };

static size_t memory_left(const opening *o)
{
    return mem_left(o->memory, source_memory(o->source));
}

static void close_part(source_part *p)
{
    combination_free(p->combination);
    placement_free(p->placement);
    analytic_free(p->analytic);
    bspline_free(p->bspline);
    volume_close(p->volume);
    mesh_surface_free(p->mesh);
    label_surface_close(p->labels);
    free(p->coefficients);
    for (size_t k = 0; k < p->part_count; k++) close_part(&p->parts[k]);
    free(p->parts);
    free(p->nothing);
}

/* Sets out->nothing from the error: the solid of the part is empty. */
static bool nothing_left(const opening *o, source_part *out, error *e)
{
    error_prefix(e, "%s", o->where);
    out->nothing = mem_strdup(e->message);
    return false;
}

/* Offsets a shape whose formula is a distance. */
static bool offset_shape(analytic_params *p, double by, error *e)
{
    double least = fmin(p->half_size.x, fmin(p->half_size.y, p->half_size.z)), size;
    switch (p->shape) {
    case ANALYTIC_SPHERE:
        size = p->radius += by;
        break;
    case ANALYTIC_TORUS:
        size = p->minor_radius += by;
        if (p->minor_radius < p->major_radius) break;
        return error_set(e, ERROR_NOT_SUPPORTED, "an offset of %g closes the hole of the torus: reduce it",
                         by);
    case ANALYTIC_BOX:
        size = least + by;
        p->half_size = vec3_add(p->half_size, vec3_make(by, by, by));
        p->rounding = fmax(p->rounding + by, 0);
        break;
    case ANALYTIC_FRUSTUM: /* inwards: reduces the rounding first, then the core */
        p->rounding += by;
        size = p->rounding >= 0 || analytic_shrink(&p->core, -p->rounding);
        p->rounding = fmax(p->rounding, 0);
        break;
    case ANALYTIC_HALFSPACE:
        p->center = vec3_axpy(by, vec3_unit(p->axis), p->center);
        return true;
    default:
        return error_set(e, ERROR_NOT_SUPPORTED,
                         "an offset requires distances, which the formula of this shape does not give: use a "
                         "shape other than ellipsoid, quartic and gyroid, or a level set");
    }
    return size > 0 ||
           error_set(e, ERROR_NO_SURFACE, "an offset of %g removes the whole shape: reduce it", by);
}

static bool open_analytic(const spec_analytic *a, double offset, const opening *o, source_part *out, error *e)
{
    analytic_params params = {
        .shape = shape_of(a->shape),
        .center = a->center,
        .radius = a->radius,
        .axis = a->axis,
        .major_radius = a->major_radius,
        .minor_radius = a->minor_radius,
        .half_size = a->half_size,
        .rounding = a->shape == SPEC_SHAPE_CAPSULE ? a->radius : a->rounding,
        .core = core_of(a),
        .bounds = o->bounds,
        .radii = a->radii,
        .r = a->r,
        .size = a->size,
        .period = a->period,
    };
    if (offset != 0 && !offset_shape(&params, offset, e))
        return e->code == ERROR_NO_SURFACE ? nothing_left(o, out, e) : false;
    out->analytic = analytic_new(&params, o->pool, e);
    if (!out->analytic) return false;
    out->field = &out->analytic->base;
    return true;
}

static volume_reconstruction reconstruction_of(spec_reconstruction how)
{
    return how == SPEC_RECONSTRUCTION_SMOOTHING ? VOLUME_SMOOTHING : VOLUME_INTERPOLATING;
}

/* Adds to an error of a file with several grids which member chooses one. */
static void name_member(const spec_surface *s, error *e)
{
    if (s->vdb.grid || !e || e->code != ERROR_GRID_AMBIGUOUS) return;
    const size_t length = strlen(e->message), parent = strlen(s->input_pointer) - strlen("path");
    snprintf(e->message + length, sizeof e->message - length, ". For a command, add --set %.*sgrid=NAME",
             (int)parent, s->input_pointer);
}

static volume *open_grid(const spec_surface *s, double offset, int fd, const opening *o, error *e)
{
    const spec_vdb *v = &s->vdb;
    const volume_request request = {
        .fd = fd,
        .path = v->path,
        .grid = v->grid,
        .has_isovalue = v->has_isovalue,
        .isovalue = v->isovalue,
        .offset = offset,
        .reconstruction = reconstruction_of(v->reconstruction),
        .memory_limit = memory_left(o),
        .points = o->spec->count,
        .pool = o->pool,
        .isa = o->kernels,
    };
    volume *opened = volume_open(&request, e);
    if (!opened) name_member(s, e);
    return opened;
}

/* Whether the sampled space may have another origin than the world: the mesh is the whole surface, and the
 * job has no positions in its space except a box. Not if the interior is dropped, because errors about such
 * a mesh contain positions. */
static bool may_move(const spec_mesh *m, double offset, const opening *o, const source_part *out)
{
    const spec *s = o->spec;
    return out == &o->source->whole && offset == 0 && !(s->has_region && s->features) && !s->region_inside &&
           !s->has_grid && !s->coherent && m->interior != SPEC_INTERIOR_DROP;
}

/* Opens a mesh of a file, or of an array (`given`, then fd does not matter). */
static bool open_mesh(const spec_mesh *m, double offset, int fd, const source_array *given, const opening *o,
                      source_part *out, error *e)
{
    const bbox cut = {o->spec->region.min, o->spec->region.max};
    const mesh_source_request request = {
        .spec = m,
        .target = o->spec->spacing > 0 || o->spec->density > 0 ? o->spec : NULL,
        .memory = (double)o->memory,
        .most_memory = (double)o->most_memory,
        .alone = o->direct && !o->spec->region_inside && offset == 0,
        .resolve = o->spec->resolve,
        .as_level_set = o->spec->method == SPEC_METHOD_WITKIN_HECKBERT,
        .to_world = o->placed ? (const double(*)[4])o->to_world : NULL,
        .region = o->spec->has_region ? &cut : NULL,
        .may_move = may_move(m, offset, o, out),
        .fd = fd,
        .array = given ? &given->mesh : NULL,
        .as_volume = {.path = m->path,
                      .resolution = {.voxel_size = m->voxel_size,
                                     .resolution = m->resolution,
                                     .max_resolution = m->max_resolution,
                                     .spacing = plan_spacing(o->spec),
                                     .count = (double)o->spec->count / (double)o->leaves,
                                     .per_spacing = o->leaves > 1 ? VOXELS_PER_SPACING : 0,
                                     .least = volume_mesh_least_voxel(offset),
                                     .memory_limit = memory_left(o),
                                     .point_bytes = plan_bytes(o->spec, (plan_particles){0}, 1)},
                      .band_vox = m->band_vox,
                      .weld = m->weld,
                      .offset = offset,
                      .keep_faces = m->on_mesh,
                      .pool = o->pool,
                      .isa = o->kernels},
    };
    return mesh_source_open(&request, &out->volume, &out->mesh, &o->source->origin, &out->notes, e);
}

/* NAN: no value means that there are no data. */
static double no_data_of(const spec_volume *v)
{
    return v->has_no_data ? v->no_data : NAN;
}

/* Takes ownership of the slices, which may be NULL. */
static volume *open_dense(slices *from, const char *path, double isovalue, spec_reconstruction how,
                          double no_data, const opening *o, error *e)
{
    if (!from) {
        sent_file_explain_header(path, e);
        error_prefix(e, "%s", path);
        return NULL;
    }
    const volume_dense_request request = {.source = from,
                                          .path = path,
                                          .isovalue = isovalue,
                                          .no_data = no_data,
                                          .reconstruction = reconstruction_of(how),
                                          .memory_limit = memory_left(o),
                                          .points = o->spec->count,
                                          .pool = o->pool,
                                          .isa = o->kernels};
    volume *v = volume_open_dense(&request, e);
    from->ops->close(from);
    return v;
}

static volume *open_stored(const spec_volume *v, const spec_exr *x, int fd, store_tree *tree,
                           const opening *o, error *e)
{
    const slices_files files = {open_input, o->source};
    const slices_directory directory = {open_in_tree, tree};
    const bbox cut = {o->spec->region.min, o->spec->region.max};
    /* the region is in world space; transformed parts are not in world space yet */
    const bool is_cut = o->direct && !o->placed && o->spec->has_region && !o->spec->region_inside;
    const volume_file file = {.fd = fd,
                              .path = v->path,
                              .index = v->has_index ? v->index : -1,
                              .files = &files,
                              .memory_limit = memory_left(o),
                              .directory = tree ? &directory : NULL,
                              .has_level = v->has_level,
                              .level = v->level,
                              .region = is_cut ? &cut : NULL,
                              .most_chunks = o->spec->max_chunks,
                              .voxel_size = x->has_voxel_size ? &x->voxel_size : NULL};
    return open_dense(volume_file_open(&file, e), v->path, v->isovalue, v->reconstruction, no_data_of(v), o,
                      e);
}

/* The slices of an array. */
static slices *open_array_grid(const source_array *given, bool has_index, bool has_level, const spec_exr *x,
                               error *e)
{
    if (!source_array_check(given, SOURCE_ARRAY_GRID, e)) return NULL;
    if (has_index || has_level) {
        error_set(e, ERROR_NOT_SUPPORTED,
                  "an array has one volume and one resolution: remove index and level");
        return NULL;
    }
    slices *s = array_slices_open(&given->grid, e);
    const double size[3] = {x->voxel_size.x, x->voxel_size.y, x->voxel_size.z};
    if (s && x->has_voxel_size) slices_set_voxel_size(s, size);
    return s;
}

exr_stack_params source_stack(const spec_exr *x, const slices_files *files)
{
    return (exr_stack_params){.count = x->count,
                              .paths = (const char *const *)x->files,
                              .numbers = x->numbers,
                              .part = x->part,
                              .channel = x->channel,
                              .has_voxel_size = x->has_voxel_size,
                              .voxel_size = x->voxel_size,
                              .origin = x->origin,
                              .files = files};
}

/* Opens a stack of images. `exr_alone`: other formats are refused. */
static volume *open_images(const spec_exr *x, bool exr_alone, double isovalue, spec_reconstruction how,
                           double no_data, const opening *o, error *e)
{
    const slices_files files = {open_input, o->source};
    exr_stack_params params = source_stack(x, &files);
    params.memory_limit = memory_left(o);
    slices *from = exr_alone ? exr_stack_open(&params, e) : volume_file_open_stack(&params, e);
    return open_dense(from, x->path, isovalue, how, no_data, o, e);
}

/* Checks the ends of dense data. Boundaries must lie on faces of axis-aligned boxes of the sampled space:
 * oblique data must not end within `box`.
 */
static bool check_ends(const volume *v, bbox box, const char *path, error *e)
{
    size_t loose = v ? volume_loose_ends(v, box) : 0;
    if (loose == 0) return true;
    const bbox clear = volume_clear_box(v);
    return error_set(
        e, ERROR_INPUT_UNSUPPORTED,
        "%s: its surface meets the end of the data in %zu cells, and the data lie obliquely in world space, where a "
        "job with a region, a grid, frames or several surfaces cannot follow that end, nor any where their axes are not "
        "at right angles: give a region (a box along the world's axes) that keeps clear of the end of the data, or "
        "another isovalue; the largest about their middle that is clear of it: [%.6g, %.6g, %.6g] to [%.6g, %.6g, %.6g]",
        path, loose, clear.min.x, clear.min.y, clear.min.z, clear.max.x, clear.max.y, clear.max.z);
}

/* The name of an input for messages. */
static const char *first_input(const source *s)
{
    return s->input_count > 0                  ? s->inputs[0].path
           : s->arrays && s->arrays->count > 0 ? s->arrays->item[0].name
                                               : "";
}

/* Rotates the sampled space to the axes of data that end obliquely, unless the job has positions in world
 * space. */
static void align_ends(const spec *s, source *out)
{
    double to_world[16];
    volume *v = out->whole.volume;
    if (!v || s->has_region || s->has_grid || s->coherent || s->features ||
        volume_loose_ends(v, out->field->domain) == 0)
        return;
    if (volume_align(v, to_world)) out->turned = placement_new_view(volume_field(v), to_world);
}

/* Opens the interfaces of a segmentation; they must be the whole surface. */
static bool open_labels(const spec_surface *s, const opening *o, source_part *out, error *e)
{
    const spec_labels *l = &s->labels;
    if (out != &o->source->whole)
        return error_set(
            e, ERROR_NOT_SUPPORTED,
            "the interfaces of labels do not bound one solid: use another surface for region.inside");
    store_tree *tree = NULL;
    const source_array *given = source_arrays_find(o->source->arrays, l->path);
    slices *array = given ? open_array_grid(given, l->has_index, l->has_level, &s->exr, e) : NULL;
    if (given && !array) return error_prefix(e, "%s", l->path);
    const int fd = l->path && !given ? open_file_or_tree(o->source, l->path, &tree, e) : -1;
    if (l->path && !given && fd < 0 && !tree) return false;
    const slices_directory directory = {open_in_tree, tree};
    const slices_files files = {open_input, o->source};
    exr_stack_params stack = source_stack(&s->exr, &files);
    stack.memory_limit = memory_left(o);
    const label_source_request request = {
        fd,
        {NULL, l, plan_spacing(o->spec), (double)o->spec->count, memory_left(o), o->pool},
        &files,
        l->path ? NULL : &stack,
        tree ? &directory : NULL,
        o->spec->max_chunks,
        s->exr.has_voxel_size ? &s->exr.voxel_size : NULL,
        array};
    out->labels = label_source_open(&request, e);
    if (array) array->ops->close(array);
    if (fd >= 0) close(fd);
    if (!out->labels) {
        const char *path = l->path ? l->path : s->exr.path;
        sent_file_explain_header(path, e);
        return error_prefix(e, "%s", path);
    }
    out->field = label_surface_field(out->labels);
    return true;
}

/* Opens a surface that an array gives. */
static bool open_array(const spec_surface *s, double offset, const source_array *given, const opening *o,
                       source_part *out, error *e)
{
    const spec_volume *v = &s->volume;
    if (s->kind == SPEC_SURFACE_MESH)
        return source_array_check(given, SOURCE_ARRAY_MESH, e) &&
               open_mesh(&s->mesh, offset, -1, given, o, out, e);
    if (s->kind == SPEC_SURFACE_VDB)
        return error_set(e, ERROR_SPEC_INVALID,
                         "%s: surface.vdb requires a file: give a dense grid as surface.volume", given->name);
    slices *from = open_array_grid(given, v->has_index, v->has_level, &s->exr, e);
    out->volume = open_dense(from, v->path, v->isovalue, v->reconstruction, no_data_of(v), o, e);
    return out->volume != NULL;
}

/* Opens a volume of one file, of the files of a stack, or of an array. */
static bool open_volume(const spec_surface *s, double offset, const opening *o, source_part *out, error *e)
{
    bool dense = s->kind == SPEC_SURFACE_VOLUME || s->kind == SPEC_SURFACE_EXR;
    if (dense && offset != 0)
        return error_set(
            e, ERROR_NOT_SUPPORTED,
            "an offset requires distances, which a dense volume does not have: give another isovalue");
    if (s->kind == SPEC_SURFACE_EXR) {
        out->volume = open_images(&s->exr, true, s->exr.isovalue, s->exr.reconstruction, NAN, o, e);
    } else if (s->exr.count > 0) {
        out->volume = open_images(&s->exr, false, s->volume.isovalue, s->volume.reconstruction,
                                  no_data_of(&s->volume), o, e);
    } else {
        const char *path = s->kind == SPEC_SURFACE_VDB    ? s->vdb.path
                           : s->kind == SPEC_SURFACE_MESH ? s->mesh.path
                                                          : s->volume.path;
        store_tree *tree = NULL;
        const source_array *given = source_arrays_find(o->source->arrays, path);
        const int fd = given                            ? -1
                       : s->kind == SPEC_SURFACE_VOLUME ? open_file_or_tree(o->source, path, &tree, e)
                                                        : open_input(o->source, path, e);
        if (fd < 0 && !tree && !given) return false;
        if (given)
            open_array(s, offset, given, o, out, e);
        else if (s->kind == SPEC_SURFACE_MESH)
            open_mesh(&s->mesh, offset, fd, NULL, o, out, e);
        else
            out->volume = s->kind == SPEC_SURFACE_VDB ? open_grid(s, offset, fd, o, e)
                                                      : open_stored(&s->volume, &s->exr, fd, tree, o, e);
        if (fd >= 0) close(fd);
    }
    if (out->mesh) out->field = mesh_surface_field(out->mesh);
    if (!out->volume) return out->mesh != NULL;
    out->field = volume_field(out->volume);
    /* for the whole surface the ends are checked later, since a region may cut them off */
    return out == &o->source->whole || check_ends(out->volume, out->field->domain, first_input(o->source), e);
}

static bool read_coefficients(const spec_bspline *b, const opening *o, source_part *out, error *e)
{
    int fd = open_input(o->source, b->path, e);
    if (fd < 0) return false;
    bool ok = (out->coefficients = coefficients_read(fd, b->path, b->dims, memory_left(o), e)) != NULL;
    close(fd);
    return ok;
}

static bool open_bspline(const spec_bspline *b, double offset, const opening *o, source_part *out, error *e)
{
    if (offset != 0)
        return error_set(e, ERROR_NOT_SUPPORTED,
                         "an offset requires distances, which a B-spline does not have: remove the offset");
    if (b->path && !read_coefficients(b, o, out, e)) return false;
    const bspline_params params = {{b->dims[0], b->dims[1], b->dims[2]},
                                   {b->domain.min, b->domain.max},
                                   b->path ? out->coefficients : b->coefficients,
                                   o->kernels};
    out->bspline = bspline_new(&params, o->pool, e);
    if (!out->bspline) return b->path ? error_prefix(e, "%s", b->path) : false;
    out->field = &out->bspline->base;
    return true;
}

/* ---- surfaces made of surfaces. An offset is passed down to the leaves: it commutes with the minimum and
 * maximum of distances.
 */

static bool open_part(const spec_surface *s, double offset, const opening *o, source_part *out, error *e);

/* Whether creases, and the ends at a region, are curves between patches. */
static bool makes_patches(const spec *s)
{
    return s->features || s->region_inside;
}

/* Opens a part of a combination. An empty part is omitted, unless the result would then be empty. */
static bool open_operand(const spec_surface *s, size_t k, double offset, const opening *o, source_part *out,
                         error *e)
{
    char where[POINTER_SIZE];
    opening inner = *o;
    inner.where = where;
    inner.direct = false;
    snprintf(where, sizeof where, "%s/%s/%zu", o->where, spec_surface_kind_name(s->kind), k);
    const double by = s->kind == SPEC_SURFACE_DIFFERENCE && k > 0 ? -offset : offset;
    source_part *part = &out->parts[k];
    if (open_part(s->parts[k], by, &inner, part, e)) return true;
    if (!part->nothing) return false;
    const bool is_needed =
        s->kind == SPEC_SURFACE_INTERSECTION || (s->kind == SPEC_SURFACE_DIFFERENCE && k == 0);
    char *why = part->nothing;
    part->nothing = NULL;
    close_part(part);
    *part = (source_part){.nothing = is_needed ? NULL : why};
    if (is_needed) out->nothing = why;
    return !is_needed;
}

/* The spacing of the points in units of the current part; 0: it follows from their number. */
static double spacing_within(const opening *o)
{
    double scale = 0;
    for (int axis = 0; axis < 3; axis++)
        scale = fmax(scale, vec3_norm(affine_axis((const double(*)[4])o->to_world, axis)));
    return plan_spacing(o->spec) / scale;
}

static bool open_combination(const spec_surface *s, double offset, const opening *o, source_part *out,
                             error *e)
{
    const combination_kind kind = s->kind == SPEC_SURFACE_UNION          ? COMBINATION_UNION
                                  : s->kind == SPEC_SURFACE_INTERSECTION ? COMBINATION_INTERSECTION
                                                                         : COMBINATION_DIFFERENCE;
    opening inner = *o;
    /* unbounded parts last, since the bounds of the others limit them */
    for (size_t n = 0; n < 2 * s->part_count; n++) {
        size_t k = n % s->part_count;
        if (spec_surface_is_bounded(s->parts[k]) != (n < s->part_count)) continue;
        if (!open_operand(s, k, offset, &inner, out, e)) return false;
        if (n < s->part_count &&
            (kind == COMBINATION_INTERSECTION || (kind == COMBINATION_DIFFERENCE && k == 0)))
            inner.bounds = out->parts[k].field->domain;
    }
    const field **fields = mem_alloc(s->part_count * sizeof(const field *));
    size_t count = 0;
    for (size_t k = 0; k < s->part_count; k++)
        if (!out->parts[k].nothing) fields[count++] = out->parts[k].field;
    *e = (error){0}; /* errors of omitted parts */
    const bool patches = makes_patches(o->spec);
    const int wall_levels = patches ? 0 : o->direct ? WALL_LEVELS : WALL_LEVELS_WITHIN;
    if (count > 0)
        out->combination = combination_new(kind, fields, count, wall_levels, patches ? 0 : spacing_within(o),
                                           patches ? 0 : (double)o->spec->count, memory_left(o), o->pool, e);
    else
        error_set(e, ERROR_NO_SURFACE, "every part of the union is empty: correct the parts");
    free(fields);
    if (!out->combination)
        return e->code == ERROR_NO_SURFACE && spec_surface_is_bounded(s) ? nothing_left(o, out, e) : false;
    out->field = combination_field(out->combination);
    return true;
}

/* Opens the part of an offset or transform. The result is empty if the part is. */
static bool open_inner(const spec_surface *s, double offset, const opening *o, source_part *out, error *e)
{
    char where[POINTER_SIZE];
    opening inner = *o;
    inner.where = where;
    snprintf(where, sizeof where, "%s/%s/surface", o->where, spec_surface_kind_name(s->kind));
    if (open_part(s->parts[0], offset, &inner, &out->parts[0], e)) return true;
    out->nothing = out->parts[0].nothing;
    out->parts[0].nothing = NULL;
    return false;
}

/* The factor by which a matrix scales all lengths; 0: it does not preserve angles. */
static double scale_of(const double m[16])
{
    double scale2 = 0, most = 0;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j <= i; j++) {
            double product = m[i] * m[j] + m[4 + i] * m[4 + j] + m[8 + i] * m[8 + j];
            if (i == 0) scale2 = product;
            most = fmax(most, fabs(product - (i == j ? scale2 : 0)));
        }
    return most <= ANGLE_ROUNDING * scale2 ? sqrt(scale2) : 0;
}

/* The bounding box, in the space of a part, of a box in the outer space. `matrix`: from the part to the
 * outer space. */
static bbox bounds_within(bbox bounds, const double matrix[16])
{
    double to_world[3][4], to_part[3][4];
    for (int k = 0; k < 12; k++) to_world[k / 4][k % 4] = matrix[k];
    affine_invert(to_world, to_part);
    return affine_box(to_part, bounds);
}

/* Appends a matrix to the transform to world space. */
static void place_within(opening *o, const double matrix[16])
{
    double placed[3][4];
    affine_compose((const double(*)[4])o->to_world, matrix, placed);
    memcpy(o->to_world, placed, sizeof placed);
    o->placed = true;
}

static bool open_placement(const spec_surface *s, double offset, const opening *o, source_part *out, error *e)
{
    double scale = scale_of(s->matrix);
    if (offset != 0 && scale == 0)
        return error_set(e, ERROR_NOT_SUPPORTED,
                         "an offset requires distances, which the transform within it does not preserve: its "
                         "matrix must be a rotation or reflection, times a number");
    opening inner = *o;
    inner.bounds = bounds_within(o->bounds, s->matrix);
    place_within(&inner, s->matrix);
    if (!open_inner(s, offset != 0 ? offset / scale : 0, &inner, out, e)) return false;
    const bool any = makes_patches(o->spec) || out->parts[0].field->patches;
    out->placement = any ? placement_new_view(out->parts[0].field, s->matrix)
                         : placement_new(out->parts[0].field, s->matrix, e);
    if (!out->placement) return false;
    /* a mesh of patches was transformed when it was opened */
    out->field = out->parts[0].field->patches ? out->parts[0].field : placement_field(out->placement);
    return true;
}

static bool open_part(const spec_surface *s, double offset, const opening *o, source_part *out, error *e)
{
    out->part_count = s->part_count;
    out->parts = mem_alloc(s->part_count * sizeof *out->parts);
    switch (s->kind) {
    case SPEC_SURFACE_ANALYTIC:
        return open_analytic(&s->analytic, offset, o, out, e);
    case SPEC_SURFACE_BSPLINE:
        return open_bspline(&s->bspline, offset, o, out, e);
    case SPEC_SURFACE_VDB:
    case SPEC_SURFACE_MESH:
    case SPEC_SURFACE_VOLUME:
    case SPEC_SURFACE_EXR:
        return open_volume(s, offset, o, out, e);
    case SPEC_SURFACE_LABELS:
        return open_labels(s, o, out, e);
    case SPEC_SURFACE_UNION:
    case SPEC_SURFACE_INTERSECTION:
    case SPEC_SURFACE_DIFFERENCE:
        return open_combination(s, offset, o, out, e);
    case SPEC_SURFACE_OFFSET:
        if (!open_inner(s, offset + s->distance, o, out, e)) return false;
        out->field = out->parts[0].field;
        return true;
    case SPEC_SURFACE_TRANSFORM:
        return open_placement(s, offset, o, out, e);
    }
    return false;
}

static bbox beyond(bbox box)
{
    vec3 size = vec3_sub(box.max, box.min);
    double longest = fmax(size.x, fmax(size.y, size.z)), low = BEYOND_LOW * longest,
           high = BEYOND_HIGH * longest;
    return (bbox){vec3_sub(box.min, vec3_make(low, low, low)),
                  vec3_add(box.max, vec3_make(high, high, high))};
}

static size_t count_leaves(const spec_surface *s)
{
    size_t count = s->part_count == 0;
    for (size_t k = 0; k < s->part_count; k++) count += count_leaves(s->parts[k]);
    return count;
}

static bool open_map(const spec *s, const opening *o, error *e)
{
    const char *path = s->grid.path                           ? s->grid.path
                       : s->surface.kind == SPEC_SURFACE_MESH ? s->surface.mesh.path
                                                              : s->surface.vdb.path;
    const source_array *given = source_arrays_find(o->source->arrays, path);
    if (given) {
        if (!source_array_check(given, SOURCE_ARRAY_GRID, e)) return false;
        o->source->map = map_of_array(&given->grid, e);
        return o->source->map || error_prefix(e, "%s", path);
    }
    mesh_notes *notes = find_input(o->source, path) ? NULL : &o->source->map_notes;
    int fd = open_input(o->source, path, e);
    if (fd < 0) return false;
    const mesh_file file = {fd, path, NULL, memory_left(o)};
    const bool is_mesh = file_formats[file_format_of_file(fd, path)].kind == FILE_FORMAT_MESHES;
    if (s->grid.has_component && !is_mesh)
        error_set(e, ERROR_SPEC_INVALID,
                  "/sampling/grid/component: the values of %s have no components, as those of a mesh have: "
                  "remove it",
                  path);
    else if (is_mesh)
        o->source->map = map_of_vertices(
            &file, s->grid.name, s->grid.has_component ? s->grid.component : MAP_NO_COMPONENT, notes, e);
    else
        o->source->map = map_open(fd, path, s->grid.name, memory_left(o), e);
    close(fd);
    return o->source->map != NULL;
}

/* Opens the surface and the surface of the region. An unbounded one is opened last, since the bounds of the
 * other one limit it. */
static bool open_all(const spec *s, const opening *o, error *e)
{
    source *out = o->source;
    opening of_surface = *o, of_region = *o;
    if (!s->region_inside) return open_part(&s->surface, 0, o, &out->whole, e);
    of_region.direct = false;
    of_region.where = "/region/inside";
    const bool bounded = spec_surface_is_bounded(&s->surface);
    if (bounded && !open_part(&s->surface, 0, o, &out->whole, e)) return false;
    if (bounded) of_region.bounds = beyond(out->whole.field->domain);
    if (!open_part(s->region_inside, 0, &of_region, &out->inside, e))
        return out->inside.nothing ? false : error_prefix(e, "/region/inside");
    if (bounded) return true;
    of_surface.bounds = beyond(out->inside.field->domain);
    return open_part(&s->surface, 0, &of_surface, &out->whole, e);
}

static bool open_source(const spec *s, const source_memory_limits *limits, isa kernels, threads *pool,
                        source *out, error *e)
{
    const opening o = {.memory = limits->job,
                       .most_memory = limits->most,
                       .kernels = kernels,
                       .pool = pool,
                       .source = out,
                       .spec = s,
                       .leaves = count_leaves(&s->surface),
                       .bounds = beyond((bbox){s->region.min, s->region.max}),
                       .direct = true,
                       .to_world = {{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 1, 0}},
                       .where = "/surface"};
    if (!open_all(s, &o, e) || (s->has_grid && !open_map(s, &o, e))) return false;
    out->field = out->whole.field;
    if (makes_patches(s)) {
        if (!(out->creased = creased_source_open(s, &out->whole, &out->inside, e))) return false;
        out->field = creased_field(out->creased);
    } else if (s->has_region && !out->field->patches) {
        const bbox box = bbox_move((bbox){s->region.min, s->region.max}, vec3_scale(out->origin, -1));
        out->region = region_new(out->field, box, e);
        if (!out->region) source_prefix_origin(out, e);
        if (!out->region) return *first_input(out) ? error_prefix(e, "%s", first_input(out)) : false;
        out->field = region_field(out->region);
    }
    align_ends(s, out);
    if (vec3_norm(out->origin) > 0) {
        const vec3 to = out->origin;
        const double to_world[16] = {1, 0, 0, to.x, 0, 1, 0, to.y, 0, 0, 1, to.z, 0, 0, 0, 1};
        out->turned = placement_new_view(out->field, to_world);
    }
    return check_ends(out->whole.volume, out->field->domain, first_input(out), e);
}

bool source_open(const spec *s, const store_roots *roots, const source_arrays *arrays,
                 const source_memory_limits *limits, isa kernels, threads *pool, source *out, error *e)
{
    error unused = {0};
    *out = (source){.roots = roots, .arrays = arrays, .hashes_beside = threads_count(pool) > 1};
    if (!e) e = &unused;
    const bool ok = open_source(s, limits, kernels, pool, out, e);
    out->hashes_beside = false;
    settle_trees(out);
    error damage = {0};
    const bool whole = settle_hash(out, &damage);
    /* a damaged upload is the cause of what else is wrong with it */
    if (!whole && (ok || damage.code == ERROR_INPUT_DAMAGED)) *e = damage;
    return whole && ok;
}

bool source_prefix_origin(const source *s, error *e)
{
    const vec3 o = s->origin;
    return vec3_norm(o) > 0 ? error_prefix(e, "relative to (%.17g, %.17g, %.17g)", o.x, o.y, o.z) : false;
}

const field *source_world(const source *s)
{
    return s->turned ? placement_field(s->turned) : s->field;
}

bbox source_box(const source *s, const surface *scan)
{
    vec3 t[FIELD_CELL_TRIANGLES][3];
    bbox box = bbox_empty();
    if (!s->turned) return scan->box;
    for (size_t k = 0; k < scan->cells; k++) {
        int count = surface_cell_triangles(scan, k, t);
        for (int i = 0; i < 3 * count; i++)
            box = bbox_include(box, placement_to_world(s->turned, t[i / 3][i % 3]));
    }
    return box;
}

void source_close(source *s)
{
    region_free(s->region);
    creased_free(s->creased);
    placement_free(s->turned);
    close_part(&s->whole);
    close_part(&s->inside);
    map_close(s->map);
    settle_trees(s);
    for (size_t k = 0; k < s->input_count; k++) free(s->inputs[k].path);
    free(s->inputs);
    *s = (source){0};
}

static size_t memory_of_part(const source_part *p)
{
    size_t bytes = p->combination ? combination_bytes(p->combination) : 0;
    if (p->volume) bytes += volume_describe(p->volume)->memory_bytes;
    if (p->mesh) bytes += mesh_surface_bytes(p->mesh);
    bytes += label_surface_bytes(p->labels);
    if (p->analytic) bytes += cell_grid_bytes(&p->analytic->grid);
    if (p->bspline) bytes += bspline_bytes(p->bspline);
    for (size_t k = 0; k < p->part_count; k++) bytes += memory_of_part(&p->parts[k]);
    return bytes;
}

/* Areas of meshes and combinations among the parts, and the areas that are missing: parts thinner than
 * voxels, and walls thinner than cells. */
typedef struct shortage {
    double of_meshes, thin;
    double combined; /* area of the outermost combinations, with the missing walls of combinations within
                      * them */
    double in_walls; /* missing walls of all combinations */
} shortage;

/* Adds the areas of a part. `scale`: length of the part's unit in the sampled space. */
static void add_missing(const source_part *p, double scale, shortage *out)
{
    const double unit = scale * scale;
    if (p->volume) {
        const fidelity *f = &volume_describe(p->volume)->fidelity;
        out->of_meshes += unit * f->area;
        out->thin += unit * f->thin * f->area;
    }
    if (p->combination) {
        double area;
        const double thin = unit * combination_missing(p->combination, &area) * area;
        out->in_walls += thin;
        out->combined += out->combined > 0 ? thin : unit * area;
    }
    if (p->placement) scale *= placement_scale(p->placement);
    for (size_t k = 0; k < p->part_count; k++) add_missing(&p->parts[k], scale, out);
}

double source_missing_share(const source *s)
{
    shortage of = {0};
    add_missing(&s->whole, 1, &of);
    return fmax(of.of_meshes > 0 ? of.thin / of.of_meshes : 0,
                of.combined > 0 ? of.in_walls / of.combined : 0);
}

static double ringing_of(const source_part *p)
{
    double most = p->volume ? volume_describe(p->volume)->ringing : 0;
    for (size_t k = 0; k < p->part_count; k++) most = fmax(most, ringing_of(&p->parts[k]));
    return most;
}

double source_ringing(const source *s)
{
    return ringing_of(&s->whole);
}

/* The largest share of the volumes among the parts. */
static double lost_share(const source_part *p)
{
    double share = p->volume ? volume_describe(p->volume)->lost_share : 0;
    for (size_t k = 0; k < p->part_count; k++) share = fmax(share, lost_share(&p->parts[k]));
    return share;
}

double source_lost_share(const source *s)
{
    return lost_share(&s->whole);
}

double source_thinnest_wall(const source *s, const spec *of)
{
    const bool is_volume = s->whole.volume && of->surface.kind != SPEC_SURFACE_MESH;
    const double voxel = s->whole.labels ? label_surface_voxel(s->whole.labels)
                         : is_volume     ? s->whole.field->cell_size
                                         : 0;
    return 0.5 * voxel;
}

size_t source_thin_places(const source *s, const vec3 **place)
{
    *place = NULL;
    if (!s->whole.volume || s->region || s->inside.field) return 0;
    const fidelity *f = &volume_describe(s->whole.volume)->fidelity;
    *place = f->thin_place;
    return f->thin_places;
}

const mesh *source_mesh(const source *s)
{
    return s->whole.mesh ? &mesh_surface_patches(s->whole.mesh)->m : NULL;
}

const mesh *source_closed_mesh(const source *s)
{
    const mesh_patches *p = s->whole.mesh ? mesh_surface_patches(s->whole.mesh) : NULL;
    return p && p->closed && p->nonmanifold_edges == 0 ? &p->m : NULL;
}

void source_end_solving(source *s)
{
    if (s->whole.mesh) mesh_surface_drop_shapes(s->whole.mesh);
}

const mesh_surface *source_triangles(const source *s)
{
    const source_part *p = &s->whole;
    const mesh_surface *on = p->mesh ? p->mesh : p->labels ? label_surface_triangles(p->labels) : NULL;
    return on && s->field == mesh_surface_field(on) ? on : NULL;
}

size_t source_memory(const source *s)
{
    return (s->region ? region_bytes(s->region) : 0) + creased_bytes(s->creased) + map_memory(s->map) +
           memory_of_part(&s->whole) + memory_of_part(&s->inside);
}

bool source_starts_in_cells(const source *s)
{
    return s->creased || (!s->whole.analytic && !s->whole.bspline);
}

/* The first part that is a combination or a leaf. *x is transformed to its space. */
static const source_part *find_combination(const source *s, vec3 *x)
{
    const source_part *p = &s->whole;
    for (; p->part_count == 1; p = p->parts)
        if (p->placement) *x = placement_to_part(p->placement, *x);
    return p;
}

size_t source_part_count(const source *s)
{
    vec3 unused = {0, 0, 0};
    size_t count = find_combination(s, &unused)->part_count;
    return count > 0 ? count : 1;
}

size_t source_part_at(const source *s, vec3 x)
{
    const source_part *whole = find_combination(s, &x);
    return source_nearest_part(whole, x);
}

size_t source_nearest_part(const source_part *whole, vec3 x)
{
    double nearest = INFINITY;
    size_t found = 0;
    for (size_t k = 0; whole->part_count > 1 && k < whole->part_count; k++) {
        field_sample sample;
        const field *f = whole->parts[k].field;
        if (!f || !field_sample_at(f, x, FIELD_GRADIENT, &sample)) continue;
        double distance = fabs(sample.value) / vec3_norm(sample.gradient);
        if (!(distance < nearest)) continue;
        nearest = distance;
        found = k;
    }
    return found;
}
