// SPDX-License-Identifier: Apache-2.0
#include "config.h"

#include "library/call.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"

_Static_assert((int)HEXAD_INT8 == (int)NUMBER_INT8 && (int)HEXAD_UINT32 == (int)NUMBER_UINT32 &&
                   (int)HEXAD_INT64 == (int)NUMBER_INT64 && (int)HEXAD_UINT64 == (int)NUMBER_UINT64 &&
                   (int)HEXAD_FLOAT32 == (int)NUMBER_FLOAT && (int)HEXAD_FLOAT64 == (int)NUMBER_DOUBLE,
               "the types of the header are those of base/core/number.h");

const char *hexad_version(void)
{
    return VERSION;
}

hexad_job *hexad_job_new(const char *text)
{
    hexad_job *job = mem_alloc(sizeof *job);
    job->text = mem_strdup(text ? text : "");
    return job;
}

void hexad_job_free(hexad_job *job)
{
    if (!job) return;
    for (size_t k = 0; k < job->arrays.count; k++) free(job->arrays.item[k].name);
    free(job->arrays.item);
    mem_free_texts(job->roots, job->root_count);
    free(job->directory);
    free(job->text);
    result_arrays_free(&job->results);
    free(job);
}

/* Begins a function of hexad.h that computes or can fail; `answer` ends it, and converts its outcome. */
static error enter(hexad_job *job)
{
    numeric_state_enter(&job->host);
    return (error){0};
}

static int answer(hexad_job *job, bool ok, const error *from, hexad_error *to)
{
    if (to) {
        snprintf(to->code, sizeof to->code, "%s", error_code_name(ok ? ERROR_NONE : from->code));
        snprintf(to->message, sizeof to->message, "%s", ok ? "" : from->message);
    }
    numeric_state_leave(&job->host);
    return ok ? 0 : -1;
}

/* ---- arrays */

/* The largest number of bytes between elements of an array; beyond it there is no memory. */
static const size_t LARGEST = PTRDIFF_MAX;

/* Whether all elements lie within the address space. */
static bool is_addressable(const hexad_array *a)
{
    size_t reach = 0;
    for (int k = 0; k < a->dimensions; k++) {
        size_t far;
        const size_t step = a->stride[k] < 0 ? -(size_t)a->stride[k] : (size_t)a->stride[k];
        if (a->size[k] == 0) return true;
        if (__builtin_mul_overflow(a->size[k] - 1, step, &far) ||
            __builtin_add_overflow(reach, far, &reach) || reach > LARGEST)
            return false;
    }
    return true;
}

/* The number of elements; false: it does not fit. */
static bool has_count(const hexad_array *a)
{
    size_t count = 1;
    for (int k = 0; k < a->dimensions; k++)
        if (__builtin_mul_overflow(count, a->size[k], &count)) return false;
    return count <= LARGEST / sizeof(double);
}

/* Checks an argument, and converts it. `what`: the name of the parameter. */
static bool take_array(const hexad_array *a, const char *what, int dimensions, bool is_whole, array_view *out,
                       error *e)
{
    if (!a) return error_set(e, ERROR_SPEC_INVALID, "%s is NULL: give an array", what);
    if ((unsigned)a->type >= NUMBER_TYPES)
        return error_set(e, ERROR_SPEC_INVALID, "%s has the type %d, which is none of hexad_type", what,
                         (int)a->type);
    if (is_whole && !number_is_whole((number_type)a->type))
        return error_set(e, ERROR_SPEC_INVALID, "%s must be of an integer type", what);
    if (a->dimensions != dimensions)
        return error_set(e, ERROR_SPEC_INVALID, "%s must have %d dimensions, and has %d", what, dimensions,
                         a->dimensions);
    if (!has_count(a) || !is_addressable(a))
        return error_set(e, ERROR_SPEC_INVALID,
                         "%s has sizes or strides beyond the address space: correct them", what);
    *out = (array_view){.data = a->data, .type = (number_type)a->type, .dimensions = dimensions};
    size_t count = 1;
    for (int k = 0; k < dimensions; k++) {
        out->size[k] = a->size[k];
        out->stride[k] = a->stride[k];
        count *= a->size[k];
    }
    return a->data || count == 0 || error_set(e, ERROR_SPEC_INVALID, "%s has no data: data is NULL", what);
}

static bool check_columns(const array_view *a, const char *what, size_t least, size_t most, error *e)
{
    if (a->size[1] >= least && a->size[1] <= most) return true;
    if (least == most)
        return error_set(e, ERROR_SPEC_INVALID, "%s has rows of %zu numbers: they must have %zu", what,
                         a->size[1], least);
    return error_set(e, ERROR_SPEC_INVALID, "%s has rows of %zu numbers: they must have at least %zu", what,
                     a->size[1], least);
}

/* Adds an array under a new name. */
static bool add(hexad_job *job, const char *name, source_array *added, error *e)
{
    if (!name || !*name) return error_set(e, ERROR_SPEC_INVALID, "the name of the array is empty: give one");
    if (source_arrays_find(&job->arrays, name))
        return error_set(e, ERROR_SPEC_INVALID, "the job has an array \"%.200s\": choose another name", name);
    added->name = mem_strdup(name);
    added->mesh.vertices.stop = added->mesh.faces.stop = added->grid.values.stop = added->points.stop =
        &job->stop;
    job->arrays.item = mem_resize(job->arrays.item, (job->arrays.count + 1) * sizeof *job->arrays.item);
    job->arrays.item[job->arrays.count++] = *added;
    return true;
}

int hexad_job_add_mesh(hexad_job *job, const char *name, const hexad_array *vertices,
                       const hexad_array *faces, const hexad_array *counts, hexad_error *why)
{
    error e = enter(job);
    source_array a = {.kind = SOURCE_ARRAY_MESH};
    mesh_array *m = &a.mesh;
    const bool ok = take_array(vertices, "vertices", 2, false, &m->vertices, &e) &&
                    check_columns(&m->vertices, "vertices", 3, 3, &e) &&
                    take_array(faces, "faces", counts ? 1 : 2, true, &m->faces, &e) &&
                    (counts ? take_array(counts, "counts", 1, true, &m->counts, &e)
                            : check_columns(&m->faces, "faces", 3, SIZE_MAX, &e)) &&
                    (!counts || m->counts.data ||
                     error_set(&e, ERROR_NO_SURFACE, "counts is empty: give a mesh with faces")) &&
                    add(job, name, &a, &e);
    return answer(job, ok, &e, why);
}

int hexad_job_add_grid(hexad_job *job, const char *name, const hexad_array *values, const double affine[16],
                       hexad_error *why)
{
    static const double identity[16] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};
    error e = enter(job);
    source_array a = {.kind = SOURCE_ARRAY_GRID};
    memcpy(a.grid.index_to_world, affine ? affine : identity, sizeof identity);
    const bool ok = take_array(values, "values", 3, false, &a.grid.values, &e) &&
                    array_grid_check(&a.grid, &e) && add(job, name, &a, &e);
    return answer(job, ok, &e, why);
}

int hexad_job_add_points(hexad_job *job, const char *name, const hexad_array *rows, hexad_error *why)
{
    error e = enter(job);
    source_array a = {.kind = SOURCE_ARRAY_POINTS};
    const bool ok = take_array(rows, "points", 2, false, &a.points, &e) &&
                    check_columns(&a.points, "points", 3, 3, &e) && add(job, name, &a, &e);
    return answer(job, ok, &e, why);
}

/* ---- settings */

void hexad_job_set_directory(hexad_job *job, const char *directory)
{
    free(job->directory);
    job->directory = directory ? mem_strdup(directory) : NULL;
}

void hexad_job_add_root(hexad_job *job, const char *directory)
{
    mem_add_text(&job->roots, &job->root_count, mem_strdup(directory));
}

void hexad_job_set_progress(hexad_job *job, hexad_progress *function, void *context)
{
    job->progress = function;
    job->progress_context = context;
}

/* ---- the spec */

/* Whether a member of `output` applies to a call. */
static bool is_for_arrays(const char *key)
{
    return strcmp(key, "order") == 0 || strcmp(key, "orient") == 0 || strcmp(key, "mesh") == 0 ||
           strcmp(key, "ply") == 0;
}

static bool is_false(json_at at)
{
    return json_type_of(at) == JSON_BOOL && !json_bool(at, true);
}

/* Refuses members that have no meaning in a call. A file that is not requested may be named. */
static bool refuse_members(const json *document, error *e)
{
    const json_at root = json_root(document), output = json_member(&root, "output"),
                  queue = json_member(&root, "queue");
    if (queue.node)
        return error_set(e, ERROR_NOT_SUPPORTED,
                         "/queue: a call has no queue: remove it, or submit the job to a service");
    if (json_type_of(output) != JSON_OBJECT) return true;
    for (json_at member = json_first(&output); member.node; member = json_next(&member))
        if (!is_for_arrays(member.key) && !is_false(member))
            return error_set(e, ERROR_NOT_SUPPORTED,
                             "/output/%.64s: a call returns arrays and writes no files: remove it",
                             member.key);
    const json_at ply = json_member(&output, "ply");
    if (json_type_of(ply) != JSON_OBJECT) return true;
    for (json_at member = json_first(&ply); member.node; member = json_next(&member))
        if (strcmp(member.key, "properties") != 0)
            return error_set(e, ERROR_NOT_SUPPORTED,
                             "/output/ply/%.64s: a call returns arrays and writes no files: remove it",
                             member.key);
    return true;
}

/* Sets the members that a call determines. */
static bool complete(const hexad_job *job, json *document, error *e)
{
    const json_at root = json_root(document);
    if (json_type_of(root) != JSON_OBJECT)
        return error_set(e, ERROR_SPEC_INVALID, "a spec must be a JSON object");
    if (!json_member(&root, "version").node) json_put_integer(document, "version", 1);
    const json *map = json_find(document, "/sampling/grid/path");
    const char *map_name = json_string(json_root(map), NULL);
    if (source_arrays_find(&job->arrays, map_name) && !json_find(document, "/sampling/grid/name"))
        json_put_string(json_find(document, "/sampling/grid"), "name", map_name);
    const json_at output = json_member(&root, "output");
    if (output.node && json_type_of(output) != JSON_OBJECT) return true; /* spec_parse refuses it */
    json *precision = json_new_string("double"), *no_preview = json_new_object();
    json_put_bool(no_preview, "preview", false);
    json *preview = json_copy(json_find(no_preview, "/preview"));
    json_free(no_preview);
    if (!json_set(document, "/output/ply/precision", precision)) json_free(precision);
    if (!json_set(document, "/output/preview", preview)) json_free(preview);
    return true;
}

/* Whether inputs of the spec are files. Error: some are arrays and some are files. */
static bool find_files(const hexad_job *job, const spec *s, bool *are_files, error *e)
{
    spec_input input, file = {0};
    bool any_array = false;
    for (size_t k = 0; spec_input_at(s, k, &input); k++) {
        const bool is_array = source_arrays_find(&job->arrays, input.path) != NULL;
        any_array |= is_array;
        if (!is_array && !file.path) file = input;
    }
    *are_files = file.path != NULL;
    if (!any_array || !file.path) return true;
    return error_set(
        e, ERROR_NOT_SUPPORTED,
        "%s: \"%.200s\" is not the name of an array: in a call all inputs are arrays, or all are files",
        file.pointer, file.path);
}

/* Each array must be used: otherwise a name in the spec is misspelt. */
static bool check_use(const hexad_job *job, const spec *s, error *e)
{
    spec_input input;
    for (size_t k = 0; k < job->arrays.count; k++) {
        bool is_used = false;
        for (size_t i = 0; !is_used && spec_input_at(s, i, &input); i++)
            is_used = strcmp(input.path, job->arrays.item[k].name) == 0;
        if (!is_used)
            return error_set(e, ERROR_SPEC_INVALID,
                             "no path of the spec is \"%.200s\", the name of an array: correct one of them",
                             job->arrays.item[k].name);
    }
    return true;
}

static bool run(hexad_job *job, error *e)
{
    bool are_files = false;
    if (job->has_run) return error_set(e, ERROR_SPEC_INVALID, "the job has run: make another one");
    job->has_run = true;
    json *document = json_parse(job->text, strlen(job->text), e);
    if (!document) return error_prefix(e, "a spec must be a valid JSON document");
    spec *s = NULL;
    bool ok = refuse_members(document, e) && complete(job, document, e) &&
              (s = spec_parse(document, NULL, e)) && check_use(job, s, e) &&
              find_files(job, s, &are_files, e);
    ok = ok && (are_files ? call_in_child(job, document, s, e) : call_in_process(job, s, e));
    spec_free(s);
    json_free(document);
    if (!ok) result_arrays_free(&job->results);
    return ok;
}

int hexad_job_run(hexad_job *job, hexad_error *why)
{
    error e = enter(job);
    return answer(job, run(job, &e), &e, why);
}

/* ---- results */

const char *hexad_job_report(const hexad_job *job)
{
    return job->results.report;
}

const char *hexad_job_array_name(const hexad_job *job, size_t index)
{
    return index < job->results.count ? job->results.item[index].name : NULL;
}

int hexad_job_array(const hexad_job *job, const char *name, hexad_array *out)
{
    for (size_t k = 0; k < job->results.count; k++) {
        const result_array *a = &job->results.item[k];
        if (strcmp(a->name, name) != 0) continue;
        const ptrdiff_t bytes = (ptrdiff_t)number_bytes(a->type);
        *out = (hexad_array){.data = a->data,
                             .type = (hexad_type)a->type,
                             .dimensions = a->components > 1 ? 2 : 1,
                             .size = {a->rows, a->components, 0},
                             .stride = {(ptrdiff_t)a->components * bytes, bytes, 0}};
        return 0;
    }
    return -1;
}
