/* mesh: triangles as plain arrays, and what was noticed about them.
 *
 * Units: as the file has them until levelset_make turns them into voxels. Ownership: mesh_free.
 * Threads: those of a pool, or NULL, whose number does not show; no shared state.
 */
#ifndef HEXAD_TRIANGLES_MESH_H
#define HEXAD_TRIANGLES_MESH_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/error.h"
#include "base/threads.h"
#include "geometry/bbox.h"
#include "geometry/vec3.h"

typedef struct mesh {
    size_t vertex_count, triangle_count;
    vec3 *vertex;
    uint32_t (*triangle)[3]; /* counter-clockwise seen from outside, if the file keeps to that */
    bool welded;             /* mesh_weld would leave it as it is, and so every vertex is a triangle's: who
                                moves, joins or leaves out anything says false */
} mesh;

#define MESH_MAX_NOTES 8

/* Sentences for the report's warnings. */
typedef struct mesh_notes {
    size_t count;
    char text[MESH_MAX_NOTES][256];
} mesh_notes;

void mesh_note(mesh_notes *notes, const char *format, ...) __attribute__((format(printf, 2, 3)));

void mesh_free(mesh *m); /* NULL, and a zeroed one, will do */

/* Errors: limit_memory, cancelled. */
bool mesh_copy(const mesh *m, threads *pool, mesh *out, error *e);

/* Bytes that a mesh takes while it is judged, edges and all: what a caller holds against a limit. */
size_t mesh_bytes(size_t vertices, size_t triangles);

/* Of the vertices of its triangles; those of none do not count. The whole one also where loops are to stop. */
bbox mesh_box(const mesh *m, threads *pool);

/* Of its triangles, each as often as it stands. */
double mesh_area(const mesh *m);

/* What becomes of a triangle that stands as often one way round as the other. */
typedef enum mesh_cancelled {
    MESH_DROP_CANCELLED, /* it bounds nothing. One of each stays if all triangles cancel, and where there would be a hole (contacts.h) */
    MESH_KEEP_CANCELLED, /* one of them stays */
    MESH_DROP_IF_CLOSED /* MESH_DROP_CANCELLED where an even number of triangles meets at every edge: it is a contact of two solids;
                            else MESH_KEEP_CANCELLED, as the orientation of an open sheet says nothing */
} mesh_cancelled;

/* Joins vertices of equal coordinates, drops vertices of no triangle, triangles with two equal corners, and
 * triangles that stand more than once. Order is kept. */
bool mesh_weld(mesh *m, mesh_cancelled cancelled, mesh_notes *notes, error *e);

/* The same where it only joins vertices and drops those of no triangle, so that whoever welds the mesh, or a copy, has nothing
 * to do. Another mesh is left to them. Errors: limit_memory, cancelled. */
bool mesh_weld_clean(mesh *m, threads *pool, error *e);

/* Joins vertices of equal coordinates; no triangle and no vertex is dropped. Errors: limit_memory, cancelled. */
bool mesh_join(mesh *m, threads *pool, error *e);

/* Drops triangles with two equal corners, and returns how many there were. */
size_t mesh_drop_degenerate(mesh *m);

#endif
