/* results: the files of a finished job. Each is written under a temporary name, read again, verified, hashed and then
 * renamed. */
#ifndef HEXAD_RUN_RESULTS_H
#define HEXAD_RUN_RESULTS_H

#include "base/error.h"
#include "base/threads.h"
#include "field/field.h"
#include "formats/points.h"
#include "json/json.h"
#include "labels/label_surface.h"
#include "triangles/mesh.h"
#include "voronoi/triangulation.h"
#include "solver/solver.h"
#include "spec/spec.h"
#include "store/file.h"

typedef struct results_facts {
    /* Of |F| / (|grad F| h) of the positions in points.ply, the largest and the root of the mean square. Of a mesh, and of labels, it is
     * the distance from the triangles, over h. */
    double max_residual, rms_residual;
    bool widened; /* float was asked for, and double was written */
    vec3 origin;  /* of floats in glTF and USD; 0 where floats hold the positions as they are */
    double
        rounding; /* how far floats relative to the origin move a point, over h; 0 where there is no origin */
    bool y_up;    /* in pictures and scenes; else z is */
    bool has_mesh;
    triangulation_facts mesh;
    json *label_meshes; /* what a report tells of them, to be taken over; or NULL */
} results_facts;

typedef struct results_input {
    const spec *spec;
    const field *field; /* in world space, as the points of the set are: where they should be it is 0 */
    const points *set;
    const label_surface *labels; /* of interfaces; else NULL */
    const field *sampled;        /* that the points were found on, whose space may be another */
    const solver_points *solved; /* the points in that space, as the mesh is made of them */
    const mesh *triangles;       /* that the points lie on; or NULL */
    const uint32_t (*corner)[3]; /* of the triangles between the points, where these are known; else NULL */
    size_t corners;
    int frame;                  /* of a sequence */
    bool y_up;                  /* in pictures and scenes; else z is */
    bool unresolved;            /* many points lie on walls thinner than the spacing */
    double h;                   /* of the ideal packing */
    const solver_sweep *sweeps; /* at least one */
    size_t sweep_count;
} results_input;

/* Hashes a verified file, appends it to `outputs`, and puts it in place. */
bool results_commit(store_file *file, const char *name, json *outputs, error *e);

/* Writes what spec->output asks for into `directory` and appends {name, bytes, sha256} of each file to
 * `outputs`. Errors: internal (the disk, or a file that does not read back as written), limit_memory,
 * cancelled. */
bool results_write(const char *directory, const results_input *in, threads *pool, json *outputs,
                   results_facts *out, error *e);

/* Writes the summary and the report. The report comes last: a directory with a report is a result. */
bool results_write_report(const char *directory, const json *report, error *e);

/* results_remove removes the results of an earlier run; results_clear the temporary files of an interrupted one. */
bool results_remove(const char *directory, error *e);
void results_clear(const char *directory);

#endif
