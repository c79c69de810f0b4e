// SPDX-License-Identifier: Apache-2.0
/* memory: arrays of every size are zeroed and aligned, also in reused memory. */
#include <pthread.h>
#include <semaphore.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <unistd.h>

#include "base/core/memory.h"

static void check(size_t count)
{
    unsigned char *block[3];
    for (int k = 0; k < 3; k++) {
        block[k] = mem_array(count, 1, "a test", NULL);
        assert_non_null(block[k]);
        assert_int_equal((uintptr_t)block[k] % 64, 0);
        for (size_t i = 0; i < count; i++)
            if (block[k][i] != 0) fail_msg("byte %zu of %zu is %d", i, count, block[k][i]);
        memset(block[k], 0xA5, count);
    }
    for (size_t i = 0; i < count; i++) /* arrays do not overlap */
        if (block[0][i] != 0xA5 || block[1][i] != 0xA5) fail_msg("byte %zu of %zu was lost", i, count);
    for (int k = 0; k < 3; k++) free(block[k]);
}

static void test_arrays_are_zeroed(void **state)
{
    (void)state;
    static const size_t sizes[] = {0,      1,      4095,   100000, 200000,  262079,
                                   262080, 262144, 262145, 300001, 1 << 20, 5000003};
    for (int round = 0; round < 3; round++)
        for (size_t k = 0; k < sizeof sizes / sizeof sizes[0]; k++) check(sizes[k]);
    for (size_t k = sizeof sizes / sizeof sizes[0]; k-- > 0;) check(sizes[k]);
    check((32 << 20) + 4097); /* in huge pages */
}

static void test_a_part_is_returned_to_the_kernel(void **state)
{
    (void)state;
    const size_t size = 8 << 20, from = 1000001, bytes = 3 << 20;
    unsigned char *p = mem_array(size, 1, "a test", NULL);
    memset(p, 0xA5, size);
    mem_release(p + from, bytes);
    for (size_t i = 0; i < size; i++) {
        const bool within = i >= from && i < from + bytes;
        if (p[i] != 0xA5 && !(within && p[i] == 0)) fail_msg("byte %zu is %d", i, p[i]);
    }
    assert_int_equal(p[from + bytes / 2], 0);
    mem_release(p + 1, 100); /* less than a page: no effect */
    assert_int_equal(p[50], 0xA5);
    free(p);
}

static void test_too_large_arrays_are_errors(void **state)
{
    (void)state;
    error e = {0};
    assert_null(mem_array(SIZE_MAX / 2, 3, "a test", &e));
    assert_int_equal(e.code, ERROR_LIMIT_MEMORY);
    assert_non_null(strstr(e.message, "a test"));
    assert_null(mem_array(SIZE_MAX / 64, 63, "a test", NULL));
}

static void test_growing_keeps_the_elements(void **state)
{
    (void)state;
    error e = {0};
    uint32_t *array = NULL;
    size_t capacity = 0;
    for (uint32_t n = 0; n < 1000; n++) {
        assert_true(MEM_GROW(array, n, &capacity, "a test", &e));
        array[n] = n;
    }
    assert_int_equal(capacity, 1024);
    for (uint32_t n = 0; n < 1000; n++) assert_int_equal(array[n], n);
    size_t full = SIZE_MAX / 16;
    uint32_t *const before = array;
    assert_false(MEM_GROW(array, full, &full, "a test", &e));
    assert_ptr_equal(array, before);
    assert_int_equal(e.code, ERROR_LIMIT_MEMORY);
    assert_int_equal(full, SIZE_MAX / 16);
    free(array);
}

static size_t peak_bytes(void)
{
    struct rusage used;
    assert_int_equal(getrusage(RUSAGE_SELF, &used), 0);
    return (size_t)used.ru_maxrss << 10;
}

/* Memory of moved elements is returned before the whole array is copied. */
static void test_growing_releases_the_old_array(void **state)
{
    (void)state;
    error e = {0};
    size_t count = (size_t)256 << 20, capacity = count;
    char *array = mem_array(count, 1, "a test", &e);
    memset(array, 7, count);
    const size_t before = peak_bytes();
    assert_true(MEM_GROW(array, count, &capacity, "a test", &e));
    assert_int_equal(capacity, 2 * count);
    for (size_t n = 0; n < count; n += 4093) assert_int_equal(array[n], 7);
    assert_int_equal(array[count - 1], 7);
    assert_int_equal(array[count], 0);
    assert_true(peak_bytes() - before < count / 2);
    free(array);
}

/* Arrays of the size of a small job are populated before they are accessed. */
static void test_page_faults_are_few(void **state)
{
    (void)state;
    enum { COUNT = 20, BYTES = 100000 };
    const size_t page = (size_t)sysconf(_SC_PAGESIZE);
    char *probe = mmap(NULL, page, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0), *array[COUNT];
    const bool knows = madvise(probe, page, MADV_POPULATE_WRITE) == 0;
    struct rusage before, after;
    munmap(probe, page);
#ifdef __SANITIZE_ADDRESS__
    return; /* the sanitizer has its own allocator */
#endif
    if (!knows) return; /* a kernel before 5.14 */
    mem_begin();
    getrusage(RUSAGE_SELF, &before);
    for (int k = 0; k < COUNT; k++) assert_non_null(array[k] = mem_array(BYTES, 1, "a test", NULL));
    getrusage(RUSAGE_SELF, &after);
    for (int k = 0; k < COUNT; k++) free(array[k]);
    assert_true((size_t)(after.ru_minflt - before.ru_minflt) < COUNT * (BYTES / page) / 4);
}

/* Bytes of this process in memory that do not belong to a file. */
static size_t anonymous_bytes(void)
{
    size_t kib = 0;
    char line[256];
    FILE *status = fopen("/proc/self/status", "r");
    assert_non_null(status);
    while (fgets(line, sizeof line, status)) sscanf(line, "RssAnon: %zu", &kib);
    fclose(status);
    return kib << 10;
}

enum { THREADS = 24, SMALL = 1000, SMALL_COUNT = 8000, LARGE_BYTES = 1 << 20, LARGE_COUNT = 24 };

static struct {
    pthread_t id;
    sem_t ready, may_end;
    void *kept;
} threads[THREADS];

/* Allocates 8 MB in small blocks and another block after them, and frees all except the last one. */
static void *use_memory(void *argument)
{
    const size_t index = *(size_t *)argument;
    char **small = malloc(SMALL_COUNT * sizeof *small);
    for (size_t k = 0; k < SMALL_COUNT; k++) memset(small[k] = malloc(SMALL), 1, SMALL);
    threads[index].kept = malloc(SMALL);
    for (size_t k = 0; k < SMALL_COUNT; k++) free(small[k]);
    free(small);
    char *large[LARGE_COUNT];
    for (size_t k = 0; k < LARGE_COUNT; k++) memset(large[k] = malloc(LARGE_BYTES), 1, LARGE_BYTES);
    for (size_t k = 0; k < LARGE_COUNT; k++) free(large[k]);
    sem_post(&threads[index].ready);
    sem_wait(&threads[index].may_end);
    return NULL;
}

/* Threads use 32 MB one after another, while earlier threads still exist. */
static void test_a_program_with_many_threads_keeps_little_freed_memory(void **state)
{
    (void)state;
#ifdef __SANITIZE_ADDRESS__
    return; /* the sanitizer has its own allocator */
#endif
    mem_begin_threads();
    const size_t before = anonymous_bytes();
    for (size_t k = 0; k < THREADS; k++) {
        sem_init(&threads[k].ready, 0, 0);
        sem_init(&threads[k].may_end, 0, 0);
        assert_int_equal(pthread_create(&threads[k].id, NULL, use_memory, &k), 0);
        sem_wait(&threads[k].ready);
    }
    const size_t after = anonymous_bytes();
    for (size_t k = 0; k < THREADS; k++) {
        sem_post(&threads[k].may_end);
        pthread_join(threads[k].id, NULL);
        free(threads[k].kept);
    }
    assert_true(after < before + ((size_t)60 << 20));
}

static void test_nothing_is_left_of_an_exceeded_limit(void **state)
{
    (void)state;
    assert_int_equal(mem_left(100, 30), 70);
    assert_int_equal(mem_left(100, 100), 0);
    assert_int_equal(mem_left(100, 101), 0); /* and not almost 2^64, which would be no limit */
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_page_faults_are_few),
        cmocka_unit_test(test_arrays_are_zeroed),
        cmocka_unit_test(test_a_part_is_returned_to_the_kernel),
        cmocka_unit_test(test_too_large_arrays_are_errors),
        cmocka_unit_test(test_nothing_is_left_of_an_exceeded_limit),
        cmocka_unit_test(test_growing_keeps_the_elements),
        cmocka_unit_test(test_growing_releases_the_old_array),
        cmocka_unit_test(test_a_program_with_many_threads_keeps_little_freed_memory),
    };
    return cmocka_run_group_tests_name("memory", tests, NULL, NULL);
}
