// SPDX-License-Identifier: Apache-2.0
/* lattice: interpolates between the samples of a grid of any file. Any number of threads, if `read`
 * permits it. */
#ifndef HEXAD_JOB_ATTRIBUTES_LATTICE_H
#define HEXAD_JOB_ATTRIBUTES_LATTICE_H

#include "job/attributes/attribute.h"

typedef struct lattice {
    int components; /* 1 to 4 */
    bool staggered; /* component a of a vector is stored half a sample lower along axis a */
    stencil_kind stencil;
    double to_index[3][4];  /* world to index space */
    double from_file[3][4]; /* as in the request; transforms vectors and normals */
    point_attribute_kind kind;
    /* Reads a sample. False if the lattice has only a default value there. */
    bool (*read)(const void *context, const int32_t at[3], double value[4]);
    const void *context;
} lattice;

/* Sets the maps from those of a request and of a file. */
void lattice_place(const attribute_request *request, const double index_to_file[16], lattice *out);

/* Computes the value at a position, and updates the counts. */
void lattice_value(const lattice *l, vec3 position, double *value, attribute_counts *counts);

/* Transforms a vector or normal by the map; other kinds are unchanged. */
void lattice_turn(point_attribute_kind kind, const double map[3][4], double *value);

#endif
