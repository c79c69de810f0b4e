// SPDX-License-Identifier: Apache-2.0
/* slice_faults: collects slices of a stack with the same kind of fault, for one message. One thread. */
#ifndef HEXAD_IO_VOLUMES_SLICE_FAULTS_H
#define HEXAD_IO_VOLUMES_SLICE_FAULTS_H

#include <stdbool.h>
#include <stddef.h>

#include "base/core/error.h"

/* Initialise with {0}. */
typedef struct slice_faults {
    size_t count;
    char numbers[320];
    int begin, last; /* the current run of consecutive numbers */
    error first;     /* of the first slice */
} slice_faults;

/* Adds a slice with a fault. `before` is the number of the preceding slice. */
void slice_faults_add(slice_faults *f, int number, int before, const error *e);

/* True if there are no faults. Otherwise sets an error with the code of the first slice: "3 slices are WHAT
 * (slices 4, 7-8). The first one: ...". */
bool slice_faults_report(slice_faults *f, const char *what, error *e);

#endif
