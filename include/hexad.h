// SPDX-License-Identifier: Apache-2.0
/* hexad: evenly packed points on surfaces. Arrays in, arrays out, in this process.
 *
 *     static const char spec[] = "{\"surface\": {\"mesh\": {\"path\": \"bunny\"}}, \"sampling\": {\"count\": 2048}}";
 *     hexad_array vertices = hexad_array_2d(xyz, HEXAD_FLOAT32, vertex_count, 3);
 *     hexad_array faces = hexad_array_2d(corners, HEXAD_INT32, face_count, 3);
 *     hexad_error error;
 *     hexad_array position;
 *     hexad_job *job = hexad_job_new(spec);
 *     if (hexad_job_add_mesh(job, "bunny", &vertices, &faces, NULL, &error) == 0 &&
 *         hexad_job_run(job, &error) == 0 && hexad_job_array(job, "position", &position) == 0)
 *         use((const double *)position.data, position.size[0]);
 *     else
 *         fprintf(stderr, "%s: %s\n", error.code, error.message);
 *     hexad_job_free(job);
 *
 * A spec is a JSON text, as for hexad-worker: `hexad-worker spec-help` lists its members. The same spec, seed and build
 * give the same points in both, for any number of threads. `version` may be omitted. Of `output`, only order, orient,
 * mesh and ply.properties (the arrays of the result) apply: results are arrays, not files. `queue` does not apply.
 *
 * Each path in the spec is the name of an array, or each is a file. Files are read by a child process: hexad-worker, at
 * the path in the environment variable HEXAD_WORKER, beside the library, or where it was installed. Without files, no
 * process is started and no file is opened.
 *
 * Functions that can fail return 0, or -1 and *error, which may be NULL. If small objects cannot be allocated, the
 * process is aborted; if memory is out for an array, the call fails with the code limit_memory.
 *
 * Threads: a job belongs to one thread at a time; different jobs may run at the same time. A call of hexad_job_run
 * ends all threads and processes that it starts. There is no other state, so a process may fork between calls. Results do
 * not depend on the locale and the floating-point environment (rounding, subnormals, traps) of the thread, which a call
 * restores at its end and while it calls the progress function. */
#ifndef HEXAD_H
#define HEXAD_H

#include <stddef.h>

#ifdef __cplusplus
extern "C" {
#endif

#define HEXAD_API __attribute__((visibility("default")))

typedef enum hexad_type {
    HEXAD_INT8,
    HEXAD_UINT8,
    HEXAD_INT16,
    HEXAD_UINT16,
    HEXAD_INT32,
    HEXAD_UINT32,
    HEXAD_INT64,
    HEXAD_UINT64,
    HEXAD_FLOAT32,
    HEXAD_FLOAT64
} hexad_type;

/* An array of numbers in native byte order, at any address. */
typedef struct hexad_array {
    const void *data;
    hexad_type type;
    int dimensions;      /* 1 to 3 */
    size_t size[3];      /* elements along each axis */
    ptrdiff_t stride[3]; /* bytes from an element to the next one along each axis; may be negative */
} hexad_array;

/* `rows` rows of `width` elements, without gaps. */
static inline hexad_array hexad_array_2d(const void *data, hexad_type type, size_t rows, size_t width)
{
    static const unsigned char bytes[] = {1, 1, 2, 2, 4, 4, 8, 8, 4, 8};
    hexad_array a = {data, type, 2, {rows, width, 0}, {0, 0, 0}};
    a.stride[1] = bytes[type];
    a.stride[0] = (ptrdiff_t)width * a.stride[1];
    return a;
}

typedef struct hexad_error {
    char code[32];      /* spec_invalid, no_surface, limit_memory, cancelled, ...; "none" after a success */
    char message[1024]; /* UTF-8 */
} hexad_error;

typedef struct hexad_job hexad_job;

HEXAD_API const char *hexad_version(void);

/* Copies the spec. Never NULL; free the job with hexad_job_free, which accepts NULL. */
HEXAD_API hexad_job *hexad_job_new(const char *spec);
HEXAD_API void hexad_job_free(hexad_job *job);

/* Arrays in place of files. The elements are not copied: they must stay unchanged until the run has ended. `name`
 * is copied; the name of an earlier array of the job is an error.
 *
 * mesh: vertices (V, 3) of any type, and faces (F, n) of an integer type, n >= 3, counter-clockwise seen from outside.
 * With counts (F) of an integer type, face k has counts[k] corners, and faces (C) lists the corners of all faces. */
HEXAD_API int hexad_job_add_mesh(hexad_job *job, const char *name, const hexad_array *vertices,
                                 const hexad_array *faces, const hexad_array *counts, hexad_error *error);

/* grid: values (I, J, K) of any type, for surface.volume (values above the isovalue are inside), surface.labels or
 * sampling.grid. Element (i, j, k) is at affine (i, j, k, 1) in world space; affine is row-major. NULL: identity. */
HEXAD_API int hexad_job_add_grid(hexad_job *job, const char *name, const hexad_array *values,
                                 const double affine[16], hexad_error *error);

/* points (N, 3) of any type, for sampling.points. */
HEXAD_API int hexad_job_add_points(hexad_job *job, const char *name, const hexad_array *points,
                                   hexad_error *error);

/* Where files may be: relative paths of the spec start at `directory` (default: the working directory), and with one
 * or more roots, files must be below one of them. */
HEXAD_API void hexad_job_set_directory(hexad_job *job, const char *directory);
HEXAD_API void hexad_job_add_root(hexad_job *job, const char *directory);

/* Called by the thread that calls hexad_job_run, at least every 100 ms. `fraction`: 0 to 1 of the job. A result
 * other than 0 cancels the job. */
typedef int hexad_progress(void *context, const char *phase, double fraction);
HEXAD_API void hexad_job_set_progress(hexad_job *job, hexad_progress *function, void *context);

/* Runs the job, once. Members of the spec: limits.timeout_s and limits.memory_mb end it; solver.threads is the number of
 * threads (default: one per processor). */
HEXAD_API int hexad_job_run(hexad_job *job, hexad_error *error);

/* Results, owned by the job. Before a run that succeeded there are none (NULL, -1).
 *
 * report: the JSON text of report.json (doc/report.md), with the outcome: converged, unresolved or not_converged.
 * array_name: the names of the arrays, from index 0; NULL: there are no more.
 * array: position (N, 3) and what output.ply.properties names: by default normal (N, 3), spacing_local (N) and
 * attributes; with "all" those of points.npz (doc/formats.md). They are doubles or, if they are whole numbers, 64-bit
 * integers; with output.mesh also triangle (T, 3), 32-bit unsigned. */
HEXAD_API const char *hexad_job_report(const hexad_job *job);
HEXAD_API const char *hexad_job_array_name(const hexad_job *job, size_t index);
HEXAD_API int hexad_job_array(const hexad_job *job, const char *name, hexad_array *array);

#ifdef __cplusplus
}
#endif

#endif
