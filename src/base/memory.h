/* memory: allocation in two kinds.
 *
 * mem_* are for small things (text, JSON nodes, tables): they never return NULL; when the machine
 * has no memory left they say so on standard error and abort, since nothing useful can be done.
 * mem_array is for what grows with a job: sizes are checked for overflow and failure is an error
 * with code limit_memory. Everything is released with free().
 */
#ifndef HEXAD_BASE_MEMORY_H
#define HEXAD_BASE_MEMORY_H

#include <stddef.h>

#include "base/error.h"

void *mem_alloc(size_t bytes); /* zeroed; never NULL */
void *mem_resize(void *old, size_t bytes);
char *mem_strdup(const char *text);
char *mem_strndup(const char *text, size_t length);
char *mem_printf(const char *format, ...) __attribute__((format(printf, 1, 2)));

/* `count` zeroed elements of `size` bytes, aligned for any vector unit (64 bytes); NULL and an
 * error that names `what` when they are not to be had. A count of 0 gives a pointer to free. */
void *mem_array(size_t count, size_t size, const char *what, error *e);

/* Makes room for one more element: `array`, of `count` elements of mem_array's, while they are fewer than *room; else one
 * twice as large, at first of `first` elements, into which they are moved and whose size goes to *room. NULL and an error
 * as mem_array's; `array` stays then. */
void *mem_grow(void *array, size_t count, size_t *room, size_t first, size_t size, const char *what,
               error *e);

/* For a program of large arrays, before it starts threads: each of 2 MB and more goes back to the kernel when it is freed, whatever
 * was allocated behind it. Of itself the library keeps ever larger ones. The first 12 MB are in large pages, where the kernel has
 * them, and 4 MB are there at once: a small job spends a fifth of its time on first touches of small pages otherwise. */
void mem_begin(void);

/* For a program of many threads that runs for long, before it starts threads: bounds the freed memory that the C library keeps. By
 * default that is up to 64 MB in each arena, with eight arenas for each processor. MALLOC_ARENA_MAX in the environment overrides the
 * number of arenas. */
void mem_begin_threads(void);

/* Gives the memory of whole pages within an array back to the kernel; what it held is lost. The array is freed as a whole
 * all the same. */
void mem_release(void *part, size_t bytes);

#endif
