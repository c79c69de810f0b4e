// SPDX-License-Identifier: Apache-2.0
#include "io/volumes/slice_faults.h"

#include <stdio.h>
#include <string.h>

typedef struct slice_faults {
    size_t count;
    char numbers[320];
    int begin, last; /* the current run of consecutive numbers */
    error first;     /* of the first slice */
} slice_faults;

static void close_run(slice_faults *f)
{
    size_t n = strlen(f->numbers);
    if (f->count == 0 || n + 40 > sizeof f->numbers)
        return; /* about thirty runs fit; the message has the total count */
    if (f->begin == f->last)
        snprintf(f->numbers + n, sizeof f->numbers - n, "%s%d", n ? ", " : "", f->begin);
    else
        snprintf(f->numbers + n, sizeof f->numbers - n, "%s%d-%d", n ? ", " : "", f->begin, f->last);
}

/* `before`: the number of the preceding slice. */
static void add(slice_faults *f, int number, int before, const error *e)
{
    if (f->count == 0 || f->last != before) {
        close_run(f);
        f->begin = number;
    }
    f->last = number;
    if (f->count++ == 0) f->first = *e;
}

static bool report(slice_faults *f, const char *what, error *e)
{
    if (f->count == 0) return true;
    close_run(f);
    if (f->count == 1)
        return error_set(e, f->first.code, "slice %s is %s: %s", f->numbers, what, f->first.message);
    return error_set(e, f->first.code, "%zu slices are %s (slices %s). The first one: %s", f->count, what,
                     f->numbers, f->first.message);
}

bool slice_faults_check(size_t first, size_t count, const int *numbers,
                        bool (*check)(void *context, size_t k, error *e), void *context, error *e)
{
    slice_faults missing = {0}, damaged = {0};
    for (size_t k = first; k < count; k++) {
        error fault = {0};
        const int number = numbers[k], before = k ? numbers[k - 1] : number - 1;
        if (check(context, k, &fault)) continue;
        if (fault.code == ERROR_INPUT_MISSING) {
            add(&missing, number, before, &fault);
        } else if (fault.code == ERROR_INPUT_DAMAGED) {
            add(&damaged, number, before, &fault);
        } else { /* other errors concern all slices */
            if (e) *e = fault;
            return error_prefix(e, "slice %d", number);
        }
    }
    return report(&missing, "missing", e) && report(&damaged, "damaged", e);
}
