#include "dense/slice_faults.h"

#include <stdio.h>
#include <string.h>

static void close_run(slice_faults *f)
{
    size_t n = strlen(f->numbers);
    if (f->count == 0 || n + 40 > sizeof f->numbers)
        return; /* the first thirty runs or so; the count says the rest */
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
    return error_set(e, f->first.code, "%zu %s %s (slice%s %s), the first: %s", f->count,
                     f->count == 1 ? "slice is" : "slices are", what, f->count == 1 ? "" : "s", f->numbers,
                     f->first.message);
}
