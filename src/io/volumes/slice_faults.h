// SPDX-License-Identifier: Apache-2.0
/* slice_faults: one message about all slices of a stack with the same kind of fault. One thread. */
#ifndef HEXAD_IO_VOLUMES_SLICE_FAULTS_H
#define HEXAD_IO_VOLUMES_SLICE_FAULTS_H

#include <stdbool.h>
#include <stddef.h>

#include "base/core/error.h"

/* Calls `check` for the slices from `first` on, which have these numbers. The error names all slices that are missing
 * (input_missing), or otherwise all that are damaged (input_damaged): "3 slices are damaged (slices 4, 7-8). The
 * first one: ...". Another error of a slice ends the check. */
bool slice_faults_check(size_t first, size_t count, const int *numbers,
                        bool (*check)(void *context, size_t k, error *e), void *context, error *e);

#endif
