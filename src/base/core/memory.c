// SPDX-License-Identifier: Apache-2.0
#include "base/core/memory.h"

#include <malloc.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

/* Elements of an array that MEM_GROW allocates first. */
enum { FIRST_CAPACITY = 256 };

static void *not_null(void *p)
{
    if (!p) {
        fputs("hexad: out of memory\n", stderr);
        abort();
    }
    return p;
}

void *mem_alloc(size_t bytes)
{
    return not_null(calloc(1, bytes ? bytes : 1));
}

void *mem_resize(void *old, size_t bytes)
{
    return not_null(realloc(old, bytes ? bytes : 1));
}

char *mem_strdup(const char *text)
{
    return not_null(strdup(text));
}

char *mem_strndup(const char *text, size_t length)
{
    return not_null(strndup(text, length));
}

char *mem_print_list(const char *format, va_list arguments)
{
    char *text = NULL;
    int length = vasprintf(&text, format, arguments);
    return not_null(length < 0 ? NULL : text);
}

char *mem_printf(const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    char *text = mem_print_list(format, arguments);
    va_end(arguments);
    return text;
}

void mem_add_text(char ***list, size_t *count, char *text)
{
    *list = mem_resize(*list, (*count + 1) * sizeof **list);
    (*list)[(*count)++] = text;
}

void mem_free_texts(char **list, size_t count)
{
    for (size_t k = 0; list && k < count; k++) free(list[k]);
    free(list);
}

/* Arrays from LARGE bytes: whole pages are returned to the kernel, which zeroes them at the first access,
 * since arrays are often only partly used. Smaller arrays, such as a picture of usual size, are zeroed at
 * once. From SEVERAL_PAGES bytes all pages are populated first: a page fault takes as long as zeroing several
 * pages, on virtual machines fifty. */
static const size_t LARGE = 5 << 18, SEVERAL_PAGES = 1 << 17;

/* Arrays from this size use pages of 2 MB: the kernel needs a third of a second to end a process with
 * gigabytes in small pages. */
static const size_t VERY_LARGE = 2 << 20;
/* Bytes of an array that are moved before their old memory is returned. */
static const size_t AT_ONCE = 32 << 20;

/* The number of bytes in whole pages within a range; *head: bytes before them. */
static size_t whole_pages(const char *p, size_t bytes, size_t *head)
{
    const size_t page = (size_t)sysconf(_SC_PAGESIZE);
    *head = (page - (uintptr_t)p % page) % page;
    return bytes < *head ? 0 : (bytes - *head) / page * page;
}

/* Populates small pages, all at once. Best effort: needs Linux 5.14. */
static void populate(char *p, size_t bytes)
{
    if (bytes > 0) madvise(p, bytes, MADV_POPULATE_WRITE);
}

static void *zeroed(char *p, size_t bytes)
{
    size_t head = 0, pages = bytes < SEVERAL_PAGES ? 0 : whole_pages(p, bytes, &head);
    if (bytes < LARGE) populate(p + head, pages);
    if (bytes < LARGE || madvise(p + head, pages, MADV_DONTNEED) != 0) return memset(p, 0, bytes);
    if (bytes >= VERY_LARGE) {
        madvise(p + head, pages, MADV_HUGEPAGE); /* best effort: the kernel may have none */
        populate(p + head + pages - pages % VERY_LARGE, pages % VERY_LARGE);
    }
    memset(p, 0, head);
    memset(p + head + pages, 0, bytes - head - pages);
    return p;
}

/* Memory of a small job, and the part of it that is populated at once. */
static const size_t FIRST = 12 << 20, POPULATED = 4 << 20;
/* Free bytes kept at the top of the heap; more than FIRST. */
static const int KEPT = 16 << 20;

void mem_begin(void)
{
    size_t head = 0;
    mallopt(M_TRIM_THRESHOLD, KEPT);
    mallopt(M_MMAP_THRESHOLD, KEPT);
    char *first = malloc(FIRST);
    if (first) {
        const size_t pages = whole_pages(first, FIRST, &head);
        madvise(first + head, pages, MADV_HUGEPAGE);
        populate(first + head, POPULATED);
    }
    free(first);
    mallopt(M_MMAP_THRESHOLD, (int)VERY_LARGE);
}

/* Threads share the arenas. Each arena keeps freed memory below blocks in use. */
enum { ARENAS = 4 };
/* Blocks from MAPPED_BYTES are returned to the kernel when freed; KEPT_BYTES are kept at the top of an arena.
 * Explicit values are not raised by the library. */
enum { MAPPED_BYTES = 256 << 10, KEPT_BYTES = 1 << 20 };

void mem_begin_threads(void)
{
    if (!getenv("MALLOC_ARENA_MAX")) mallopt(M_ARENA_MAX, ARENAS);
    mallopt(M_MMAP_THRESHOLD, MAPPED_BYTES);
    mallopt(M_TRIM_THRESHOLD, KEPT_BYTES);
}

void *mem_array(size_t count, size_t size, const char *what, error *e)
{
    size_t bytes;
    if (!__builtin_mul_overflow(count, size, &bytes) &&
        bytes <= PTRDIFF_MAX - 128) { /* maximum size of an object */
        bytes = (bytes + 64) & ~(size_t)63;
        void *p;
        if (posix_memalign(&p, bytes < VERY_LARGE ? 64 : VERY_LARGE, bytes) == 0) return zeroed(p, bytes);
    }
    error_set(e, ERROR_LIMIT_MEMORY,
              "not enough memory for %s (%zu elements of %zu bytes): raise limits.memory_mb or ask "
              "for fewer points",
              what, count, size);
    return NULL;
}

void mem_release(void *part, size_t bytes)
{
    size_t head, pages = whole_pages(part, bytes, &head);
    if (pages > 0) madvise((char *)part + head, pages, MADV_DONTNEED); /* best effort */
}

/* Moves an array in parts, so that a large one does not need its memory twice. */
static void move_bytes(char *to, char *from, size_t bytes)
{
    for (size_t done = 0; done < bytes; done += AT_ONCE) {
        const size_t part = bytes - done < AT_ONCE ? bytes - done : AT_ONCE;
        memcpy(to + done, from + done, part);
        if (bytes > AT_ONCE) mem_release(from + done, part);
    }
}

bool mem_make_room(void *array, size_t count, size_t *capacity, size_t size, const char *what, error *e)
{
    if (count < *capacity) return true;
    const size_t larger = *capacity ? 2 * *capacity : FIRST_CAPACITY;
    char *old, *moved = mem_array(larger, size, what, e);
    if (!moved) return false;
    memcpy(&old, array, sizeof old);
    if (count) move_bytes(moved, old, count * size);
    free(old);
    memcpy(array, &moved, sizeof moved);
    *capacity = larger;
    return true;
}
