/* slice_faults: slices of a stack with the same kind of fault, which one message names. Threads: none. */
#ifndef HEXAD_DENSE_SLICE_FAULTS_H
#define HEXAD_DENSE_SLICE_FAULTS_H

#include <stdbool.h>
#include <stddef.h>

#include "base/error.h"

/* Begins as {0}. */
typedef struct slice_faults {
    size_t count;
    char numbers[320];
    int begin, last; /* the run of numbers at hand */
    error first;     /* of the first slice */
} slice_faults;

/* `before` is the number of the slice before this one. */
void slice_faults_add(slice_faults *f, int number, int before, const error *e);

/* True if there is none. Otherwise an error with the code of the first slice: "3 slices are WHAT (slices 4, 7-8). The first one: ...". */
bool slice_faults_report(slice_faults *f, const char *what, error *e);

#endif
