/* lattice: values between the samples of a grid, of whatever file. Threads: any number, if reading is safe. */
#ifndef HEXAD_ATTRIBUTE_LATTICE_H
#define HEXAD_ATTRIBUTE_LATTICE_H

#include "attribute/attribute.h"

typedef struct lattice {
    int components; /* 1 to 4 */
    bool
        staggered; /* component a of a vector is known half a sample before the others' place, along axis a */
    stencil_kind stencil;
    double to_index[3][4];  /* of the world */
    double from_file[3][4]; /* as in the request; vectors and normals go with it */
    point_attribute_kind kind;
    /* Reads a sample; false if the lattice has only a default there. */
    bool (*read)(const void *context, const int32_t at[3], double value[4]);
    const void *context;
} lattice;

/* With the maps of a request, and those of a file. */
void lattice_place(const attribute_request *request, const double index_to_file[16], lattice *out);

/* The value at a place, and what it adds to the counts. */
void lattice_value(const lattice *l, vec3 position, double *value, attribute_counts *counts);

/* Turns a vector or normal as the map does; leaves others alone. */
void lattice_turn(point_attribute_kind kind, const double map[3][4], double *value);

#endif
