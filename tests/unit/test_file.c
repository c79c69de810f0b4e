// SPDX-License-Identifier: Apache-2.0
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <dirent.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <linux/magic.h>
#include <sys/stat.h>
#include <sys/vfs.h>
#include <unistd.h>

#include "base/core/memory.h"
#include "files/file.h"
#include "files/late_commit.h"
#include "files/late_hash.h"

static char *make_place(void)
{
    char *base = mem_strdup("/tmp/hexad-file-XXXXXX");
    assert_non_null(mkdtemp(base));
    return base;
}

static void drop_place(char *base)
{
    error e = {0};
    if (!store_remove(base, &e)) fail_msg("%s", e.message);
    assert_int_equal(access(base, F_OK), -1);
    free(base);
}

static size_t count_entries(const char *path)
{
    DIR *listing = opendir(path);
    assert_non_null(listing);
    size_t count = 0;
    struct dirent *entry;
    while ((entry = readdir(listing)))
        if (strcmp(entry->d_name, ".") != 0 && strcmp(entry->d_name, "..") != 0) count++;
    closedir(listing);
    return count;
}

static void expect_content(const char *path, const char *want)
{
    size_t count = 0;
    error e = {0};
    char *text = store_file_read(path, 1 << 20, &count, &e);
    if (!text) fail_msg("%s", e.message);
    assert_int_equal(count, strlen(want));
    assert_string_equal(text, want);
    free(text);
}

static void test_commit_replaces_and_abort_leaves(void **state)
{
    (void)state;
    char *base = make_place();
    char *path = mem_printf("%s/file", base);
    error e = {0};
    assert_true(store_file_write(path, "old", 3, &e));
    store_file file;
    assert_true(store_file_begin(path, &file, &e));
    fputs("half", file.stream);
    expect_content(path, "old"); /* no change before the commit */
    store_file_abort(&file);
    store_file_abort(&file); /* accepts an empty file */
    expect_content(path, "old");
    assert_int_equal(count_entries(base), 1);
    assert_true(store_file_begin(path, &file, &e));
    fputs("new", file.stream);
    assert_true(store_file_commit(&file, &e));
    expect_content(path, "new");
    assert_int_equal(count_entries(base), 1);
    assert_true(store_file_begin(path, &file, &e));
    fputs("placed", file.stream);
    assert_true(store_file_place(&file, &e));
    assert_null(file.stream);
    expect_content(path, "placed");
    assert_int_equal(count_entries(base), 1);
    free(path);
    drop_place(base);
}

static void test_failures_name_the_path(void **state)
{
    (void)state;
    error e = {0};
    store_file file;
    assert_false(store_file_begin("/nonexistent/dir/file", &file, &e));
    assert_int_equal(e.code, ERROR_INTERNAL);
    assert_non_null(strstr(e.message, "/nonexistent/dir/file"));
    size_t count;
    assert_null(store_file_read("/nonexistent/file", 10, &count, &e));
    assert_null(store_file_read("/proc/self/maps", 10, &count, &e)); /* longer than the limit */
    assert_non_null(strstr(e.message, "too large"));
    assert_false(store_rename("/nonexistent/a", "/nonexistent/b", &e));
    assert_true(store_remove("/nonexistent/a", &e));
    /* a device that is always full: commit reports the loss, as on a full disk */
    FILE *full = fopen("/dev/full", "w");
    if (full) {
        file = (store_file){full, mem_strdup("/dev/full"), mem_strdup("/nonexistent/temporary"), NULL};
        fputs("lost", full);
        assert_false(store_file_commit(&file, &e));
        assert_non_null(strstr(e.message, "No space"));
    }
}

static void test_a_directory_with_files_is_not_free(void **state)
{
    (void)state;
    char *base = make_place(), *directory = mem_printf("%s/new", base),
         *file = mem_printf("%s/file", directory), *link = mem_printf("%s/link", base);
    error e = {0};
    assert_true(store_directory_is_free(directory, false) && store_directory_is_free(directory, true));
    assert_true(store_directory_create(directory, &e));
    assert_true(!store_directory_is_free(directory, false) && store_directory_is_free(directory, true));
    assert_true(store_file_write(file, "x", 1, &e));
    assert_true(!store_directory_is_free(directory, false) && !store_directory_is_free(directory, true));
    assert_true(!store_directory_is_free(file, false) && !store_directory_is_free(file, true));
    assert_int_equal(symlink("nowhere", link), 0);
    assert_true(!store_directory_is_free(link, false) && !store_directory_is_free(link, true));
    assert_true(store_remove(base, &e));
    free(base);
    free(directory);
    free(file);
    free(link);
}

static void test_directories(void **state)
{
    (void)state;
    char *base = make_place();
    error e = {0};
    char *deep = mem_printf("%s/a/b/c", base);
    char *moved = mem_printf("%s/moved", base);
    char *leaf = mem_printf("%s/c/leaf", moved);
    char *from = mem_printf("%s/a/b", base);
    char *link = mem_printf("%s/link", moved);
    assert_true(store_directory_create(deep, &e));
    assert_true(store_directory_create(deep, &e));
    assert_true(store_rename(from, moved, &e));
    assert_int_equal(access(from, F_OK), -1);
    assert_true(store_file_write(leaf, "x", 1, &e));
    assert_false(store_directory_create(leaf, &e)); /* a file has this name */
    /* a link is removed, not followed */
    char *kept = mem_printf("%s/kept", base);
    assert_true(store_directory_create(kept, &e));
    char *inside = mem_printf("%s/inside", kept);
    assert_true(store_file_write(inside, "x", 1, &e));
    assert_int_equal(symlink(kept, link), 0);
    assert_true(store_remove(moved, &e));
    expect_content(inside, "x");
    free(deep);
    free(moved);
    free(leaf);
    free(from);
    free(link);
    free(kept);
    free(inside);
    drop_place(base);
}

static void test_hash(void **state)
{
    (void)state;
    char *base = make_place();
    char *path = mem_printf("%s/file", base);
    error e = {0};
    assert_true(store_file_write(path, "abc", 3, &e)); /* FIPS 180-2, appendix B.1 */
    int fd = open(path, O_RDONLY | O_CLOEXEC);
    char hex[STORE_HASH_SIZE];
    uint64_t bytes = 0;
    assert_true(store_file_hash(fd, hex, &bytes, &e));
    assert_int_equal(bytes, 3);
    assert_string_equal(hex, "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
    assert_int_equal(lseek(fd, 0, SEEK_CUR), 0);
    close(fd);
    assert_false(store_file_hash(-1, hex, &bytes, &e));
    free(path);
    drop_place(base);
}

/* Files of ended processes are removed; similar names are kept. */
static void test_clearing(void **state)
{
    (void)state;
    static const char *const names[] = {"clear.me",
                                        "clear.me.0123456789abcdef",
                                        "clear.me.0123456789abcde",
                                        "clear.me.0123456789abcdeg",
                                        "clear.you.0123456789abcdef",
                                        "clear.me.0123456789abcdef0"};
    enum { NAMES = sizeof names / sizeof names[0] };
    for (int k = 0; k < NAMES; k++) assert_true(store_file_write(names[k], "x", 1, NULL));
    store_file begun = {0};
    assert_true(store_file_begin("clear.me", &begun, NULL));
    char *temporary = mem_strdup(begun.temporary);
    store_file_clear("clear.me");
    assert_int_not_equal(access(temporary, F_OK), 0);
    for (int k = 0; k < NAMES; k++) assert_int_equal(access(names[k], F_OK) == 0, k != 1);
    store_file_abort(&begun);
    for (int k = 0; k < NAMES; k++) unlink(names[k]);
    free(temporary);
}

static bool write_text(FILE *stream, void *context, error *e)
{
    return (context && fputs(context, stream) >= 0 && fflush(stream) == 0) ||
           error_set(e, ERROR_STORAGE_FULL, "no room");
}

/* With and without a thread, the file exists at the end and its hash is returned. A failure is returned at
 * the end, too. A failure to write leaves no file. */
static void test_late_commits(void **state)
{
    (void)state;
    char *base = make_place(), *path = mem_printf("%s/late", base), *gone = mem_printf("%s/gone", base);
    char hash[STORE_HASH_SIZE];
    store_hash("text", 4, hash);
    for (int beside = 0; beside < 2; beside++) {
        error e = {0};
        store_file file = {0};
        late_commit *c;
        store_facts facts;
        assert_true(store_file_begin_hashed(path, &file, &e));
        c = late_commit_begin(&file, write_text, "text", beside);
        assert_null(file.stream);
        assert_true(late_commit_end(c, &facts, &e));
        assert_string_equal(facts.sha256, hash);
        assert_int_equal(facts.bytes, 4);
        assert_int_equal(access(path, F_OK), 0);
        assert_true(store_remove(path, &e));
        char *inner = mem_printf("%s/file", gone);
        assert_true(store_directory_create(gone, &e) && store_file_begin_hashed(inner, &file, &e));
        assert_true(store_remove(gone, &e));
        c = late_commit_begin(&file, write_text, "text", beside);
        assert_false(late_commit_end(c, &facts, &e));
        assert_int_not_equal(e.code, ERROR_NONE);
        free(inner);
        assert_true(store_file_begin_hashed(path, &file, &e));
        c = late_commit_begin(&file, write_text, NULL, beside);
        assert_false(late_commit_end(c, &facts, &e));
        assert_int_equal(e.code, ERROR_STORAGE_FULL);
        assert_int_equal(count_entries(base), 0);
    }
    free(gone);
    free(path);
    drop_place(base);
}

/* Writes in order, over two written blocks, and beyond the end. The bytes that the file must have are in
 * `want`. */
static void write_out_of_order(FILE *stream, char *want)
{
    for (int k = 0; k < 10000; k++) want[k] = (char)(k * k >> 5);
    fwrite(want, 1, 10000, stream);
    for (int round = 0; round < 2; round++) {
        memcpy(want + 4090, round ? "over two blocks" : "OVER TWO BLOCKS", 15);
        fseeko(stream, 4090, SEEK_SET);
        fwrite(want + 4090, 1, 15, stream);
        assert_int_equal(ftello(stream), 4105);
    }
    want[20383] = 'x';
    fseeko(stream, 20383, SEEK_SET);
    fputc('x', stream);
    assert_int_equal(fseeko(stream, -1, SEEK_SET), -1);
    fseeko(stream, 0, SEEK_END);
    assert_int_equal(ftello(stream), 20384);
}

enum { OUT_OF_ORDER_BYTES = 20384 };

/* What is placed has the bytes and the hash of what was written, also after seeks. */
static void test_verified_files(void **state)
{
    static const char *const places[] = {"/tmp/hexad-file-XXXXXX", "/dev/shm/hexad-file-XXXXXX"};
    (void)state;
    for (int k = 0; k < 2; k++) {
        char *base = mem_strdup(places[k]), want[OUT_OF_ORDER_BYTES] = {0}, hash[STORE_HASH_SIZE];
        error e = {0};
        store_file file = {0};
        store_facts facts;
        size_t count;
        if (!mkdtemp(base)) { /* without a file system in memory */
            free(base);
            continue;
        }
        char *path = mem_printf("%s/file", base);
        assert_true(store_file_begin_hashed(path, &file, &e));
        write_out_of_order(file.stream, want);
        if (!store_file_place_verified(&file, &facts, &e)) fail_msg("%s", e.message);
        store_hash(want, sizeof want, hash);
        assert_string_equal(facts.sha256, hash);
        assert_int_equal(facts.bytes, sizeof want);
        char *read = store_file_read(path, 1 << 20, &count, &e);
        assert_int_equal(count, sizeof want);
        assert_memory_equal(read, want, sizeof want);
        free(read);
        assert_true(store_file_begin_hashed(path, &file, &e)); /* an empty file */
        assert_true(store_file_place_verified(&file, &facts, &e));
        store_hash("", 0, hash);
        assert_string_equal(facts.sha256, hash);
        assert_int_equal(count_entries(base), 1);
        free(path);
        drop_place(base);
    }
}

/* Changes the file behind its writer, as a disk does that fails: at `at`, or its length if `at` is
 * negative. */
static void damage(const store_file *file, int at)
{
    const int fd = open(file->temporary, O_RDWR | O_CLOEXEC);
    char byte;
    if (at < 0) {
        assert_int_equal(ftruncate(fd, OUT_OF_ORDER_BYTES + at), 0);
    } else {
        assert_int_equal(pread(fd, &byte, 1, at), 1);
        byte ^= 0x10;
        assert_int_equal(pwrite(fd, &byte, 1, at), 1);
    }
    close(fd);
}

/* A byte that is not read as it was written, and an end that is missing, are errors of the disk, also in
 * a block that is read again because the writer seeks back. No file is left. */
static void test_a_byte_that_changes_on_the_disk_is_found(void **state)
{
    static const struct {
        int at; /* of damage */
        const char *words;
    } faults[] = {{0, "from byte 0 on"},        {4095, "from byte 0 on"},      {4096, "from byte 4096 on"},
                  {12000, "from byte 8192 on"}, {16384, "from byte 16384 on"}, {20383, "from byte 16384 on"},
                  {-1, "from byte 16384 on"},   {-6000, "from byte 14384 on"}, {-20384, "from byte 0 on"}};
    char *base = make_place(), *path = mem_printf("%s/file", base);
    (void)state;
    for (size_t k = 0; k < sizeof faults / sizeof *faults; k++) {
        char want[OUT_OF_ORDER_BYTES] = {0};
        error e = {0};
        store_file file = {0};
        store_facts facts;
        assert_true(store_file_begin_hashed(path, &file, &e));
        write_out_of_order(file.stream, want);
        assert_int_equal(fflush(file.stream), 0);
        damage(&file, faults[k].at);
        assert_false(store_file_place_verified(&file, &facts, &e));
        assert_int_equal(e.code, ERROR_STORAGE_FAILED);
        if (!strstr(e.message, faults[k].words)) fail_msg("%s", e.message);
        assert_non_null(strstr(e.message, path));
        assert_int_equal(count_entries(base), 0);
    }
    error e = {0};
    store_file file = {0};
    store_facts facts;
    char want[OUT_OF_ORDER_BYTES] = {0};
    assert_true(store_file_begin_hashed(path, &file, &e));
    write_out_of_order(file.stream, want);
    assert_int_equal(fflush(file.stream), 0);
    damage(&file, 100);
    fseeko(file.stream, 200, SEEK_SET);
    fputc('x', file.stream);
    assert_false(store_file_place_verified(&file, &facts, &e));
    assert_int_equal(e.code, ERROR_STORAGE_FAILED);
    assert_int_equal(count_entries(base), 0);
    free(path);
    drop_place(base);
}

/* Bytes that this process has read from disks; -1: the system does not count them. */
static long long bytes_from_disks(void)
{
    long long bytes = -1;
    char line[80];
    FILE *file = fopen("/proc/self/io", "re");
    while (file && fgets(line, sizeof line, file)) sscanf(line, "read_bytes: %lld", &bytes);
    if (file) fclose(file);
    return bytes;
}

/* The second reading is from the disk, not from memory. */
static void test_a_verified_file_is_read_from_the_disk(void **state)
{
    enum { BYTES = 1 << 20 };
    char *base = make_place(), *path = mem_printf("%s/file", base), *bytes = mem_alloc(BYTES);
    error e = {0};
    store_file file = {0};
    store_facts facts;
    struct statfs on;
    (void)state;
    for (size_t k = 0; k < BYTES; k++) bytes[k] = (char)(k * k >> 7);
    assert_int_equal(statfs(base, &on), 0);
    const long long before = bytes_from_disks();
    assert_true(store_file_begin_hashed(path, &file, &e));
    assert_int_equal(fwrite(bytes, 1, BYTES, file.stream), BYTES);
    if (!store_file_place_verified(&file, &facts, &e)) fail_msg("%s", e.message);
    const bool is_counted = before >= 0 && (on.f_type == EXT4_SUPER_MAGIC || on.f_type == XFS_SUPER_MAGIC);
    if (is_counted) assert_true(bytes_from_disks() - before >= BYTES);
    free(bytes);
    free(path);
    drop_place(base);
}

/* For files above and below the size for a thread. The descriptor may be closed in the meantime. */
static void test_late_hashes(void **state)
{
    enum { LARGE = 5 << 20 };
    char *base = make_place(), *path = mem_printf("%s/large", base);
    char *bytes = mem_alloc(LARGE);
    (void)state;
    for (size_t k = 0; k < LARGE; k++) bytes[k] = (char)(k * k >> 7);
    for (int large = 0; large < 2; large++)
        for (int beside = 0; beside < 2; beside++) {
            const size_t size = large ? LARGE : 1000;
            char hash[STORE_HASH_SIZE];
            store_facts facts = {0};
            error e = {0};
            int fd = open(path, O_RDWR | O_CREAT | O_TRUNC, 0600);
            assert_int_equal(write(fd, bytes, size), size);
            late_hash *h = late_hash_begin(fd, beside);
            close(fd);
            if (!late_hash_end(h, &facts, &e)) fail_msg("%s", e.message);
            store_hash(bytes, size, hash);
            assert_string_equal(facts.sha256, hash);
            assert_int_equal(facts.bytes, size);
        }
    store_facts kept = {.bytes = 7};
    error e = {0};
    assert_false(late_hash_end(late_hash_begin(-1, true), &kept, &e));
    assert_true(e.code != ERROR_NONE);
    assert_int_equal(kept.bytes, 7);
    assert_true(late_hash_end(NULL, &kept, &e));
    free(bytes);
    free(path);
    drop_place(base);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_clearing),
        cmocka_unit_test(test_a_directory_with_files_is_not_free),
        cmocka_unit_test(test_late_commits),
        cmocka_unit_test(test_verified_files),
        cmocka_unit_test(test_a_byte_that_changes_on_the_disk_is_found),
        cmocka_unit_test(test_a_verified_file_is_read_from_the_disk),
        cmocka_unit_test(test_commit_replaces_and_abort_leaves),
        cmocka_unit_test(test_failures_name_the_path),
        cmocka_unit_test(test_directories),
        cmocka_unit_test(test_hash),
        cmocka_unit_test(test_late_hashes),
    };
    return cmocka_run_group_tests_name("file", tests, NULL, NULL);
}
