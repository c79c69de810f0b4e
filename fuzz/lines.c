// SPDX-License-Identifier: Apache-2.0
/* lines: runs a target over the lines of standard input, each of which is one input, in one process.
 *
 * The number of each line is printed to standard error before the target sees it, so that a crash can be
 * attributed. The last line of standard output has the number of lines, and the one that took most CPU
 * time. */
#include <stdbool.h>
#include <string.h>
#include <time.h>

#include "fuzz/target.h"

static double cpu_ms(void)
{
    struct timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return 1e3 * (double)t.tv_sec + 1e-6 * (double)t.tv_nsec;
}

/* In a copy without a byte more, so that a sanitizer detects a read beyond it. */
static bool run_line(const char *line, size_t length)
{
    uint8_t *bytes = malloc(length ? length : 1);
    if (!bytes) return false;
    memcpy(bytes, line, length);
    LLVMFuzzerTestOneInput(bytes, length);
    free(bytes);
    return true;
}

int main(void)
{
    char *line = NULL;
    size_t capacity = 0, count = 0, slowest = 0;
    double most = 0, began = cpu_ms();
    for (ssize_t n; (n = getline(&line, &capacity, stdin)) > 0;) {
        fprintf(stderr, "%zu\n", ++count);
        const double before = cpu_ms();
        if (!run_line(line, (size_t)n - (line[n - 1] == '\n'))) return 1;
        const double took = cpu_ms() - before;
        if (took <= most) continue;
        most = took;
        slowest = count;
    }
    free(line);
    printf("%zu lines, %.3f CPU ms each, at most %.3f in line %zu\n", count,
           count ? (cpu_ms() - began) / (double)count : 0, most, slowest);
    return 0;
}
