// SPDX-License-Identifier: Apache-2.0
#include "io/volumes/slice_faults.h"

#include <stdio.h>
#include <string.h>

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

void slice_faults_add(slice_faults *f, int number, int before, const error *e)
{
    if (f->count == 0 || f->last != before) {
        close_run(f);
        f->begin = number;
    }
    f->last = number;
    if (f->count++ == 0) f->first = *e;
}

bool slice_faults_report(slice_faults *f, const char *what, error *e)
{
    if (f->count == 0) return true;
    close_run(f);
    if (f->count == 1)
        return error_set(e, f->first.code, "slice %s is %s: %s", f->numbers, what, f->first.message);
    return error_set(e, f->first.code, "%zu slices are %s (slices %s). The first one: %s", f->count, what,
                     f->numbers, f->first.message);
}
