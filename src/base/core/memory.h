// SPDX-License-Identifier: Apache-2.0
/* memory: allocation, in two kinds, and settings of malloc.
 *
 * mem_* functions are for small objects (text, JSON nodes, tables): they never return NULL; if memory is
 * exhausted they print a message to standard error and abort. mem_array is for arrays whose size grows with a
 * job: sizes are checked for overflow, and failure is the error limit_memory. Free everything with free().
 * Any thread.
 */
#ifndef HEXAD_BASE_CORE_MEMORY_H
#define HEXAD_BASE_CORE_MEMORY_H

#include <stdarg.h>
#include <stddef.h>

#include "base/core/error.h"

void *mem_alloc(size_t bytes); /* zeroed; never NULL */
void *mem_resize(void *old, size_t bytes);
char *mem_strdup(const char *text);
char *mem_strndup(const char *text, size_t length);
char *mem_printf(const char *format, ...) __attribute__((format(printf, 1, 2)));
char *mem_print_list(const char *format, va_list arguments) __attribute__((format(printf, 1, 0)));

/* A list of texts, which it owns: adds one, and frees all with the list. NULL is an empty list. */
void mem_add_text(char ***list, size_t *count, char *text);
void mem_free_texts(char **list, size_t count);

/* The bytes of a limit that remain if `held` bytes are used; 0 if these exceed it. */
static inline size_t mem_left(size_t limit, size_t held)
{
    return limit > held ? limit - held : 0;
}

/* `count` zeroed elements of `size` bytes, aligned to 64 bytes for vector units. Error: limit_memory, NULL;
 * the message contains `what`. For a count of 0 the result is not NULL. */
void *mem_array(size_t count, size_t size, const char *what, error *e);

/* Grows an array of mem_array, a pointer in a variable, for one more element. If count == *capacity, its elements
 * are moved to one of twice the size, at first 256 elements, and *capacity is set. Error: limit_memory, false; the
 * array is unchanged. */
#define MEM_GROW(array, count, capacity, what, e) \
    mem_make_room(&(array), count, capacity, sizeof *(array), what, e)

/* For MEM_GROW. `array`: the address of the pointer. */
bool mem_make_room(void *array, size_t count, size_t *capacity, size_t size, const char *what, error *e);

/* For a program with large arrays; call it before starting threads. Arrays of 2 MB and more are returned to
 * the kernel when freed, whatever was allocated after them; by default the C library raises this size. The
 * first 12 MB are in huge pages, if the kernel has them, and 4 MB of them are populated: a small job
 * otherwise spends a fifth of its time on page faults. */
void mem_begin(void);

/* For a long-running program with many threads; call it before starting threads. Bounds the freed memory that
 * the C library keeps; by default that is up to 64 MB per arena, with eight arenas per processor.
 * MALLOC_ARENA_MAX in the environment overrides the number of arenas. */
void mem_begin_threads(void);

/* Returns the whole pages within an array to the kernel; their contents are lost. The array is still freed as
 * a whole. */
void mem_release(void *part, size_t bytes);

#endif
