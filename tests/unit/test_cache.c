// SPDX-License-Identifier: Apache-2.0
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <fcntl.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include "config.h"

#include "base/core/memory.h"
#include "service/executor/cache.h"
#include "service/results/own_report.h"

typedef struct place {
    char base[64];
    char *input, *result, *target;
    store_roots *roots;
} place;

static void put(const char *path, const char *text)
{
    assert_true(store_file_write(path, text, strlen(text), NULL));
}

/* The SHA-256 of "x". */
#define OF_X "2d711642b726b04401627ca9fbac32f5c8530fb1903cc4db02258717921a4881"

/* Writes the report of a worker that has opened the input in its present state. */
static void write_report(const place *p)
{
    store_identity id;
    int fd = open(p->input, O_RDONLY);
    assert_true(fd >= 0 && store_identify(fd, &id));
    close(fd);
    char *path = mem_printf("%s/report.json", p->result);
    char *text = mem_printf(
        "{\"outcome\":\"converged\",\"count\":7,\"spec\":{\"name\":\"first\"},\"inputs\":[{\"path\":\"%s\","
        "\"sha256\":\"ab\",\"bytes\":%" PRIu64 ",\"inode\":\"%" PRIu64 "\",\"mtime_ns\":\"%" PRId64
        "\",\"ctime_ns\":\"%" PRId64 "\"}],"
        "\"outputs\":[{\"name\":\"points.ply\",\"bytes\":1,\"sha256\":\"" OF_X "\"}]}",
        p->input, id.bytes, id.inode, id.mtime_ns, id.ctime_ns);
    put(path, text);
    free(text);
    free(path);
}

static int set_up(void **state)
{
    place *p = mem_alloc(sizeof *p);
    strcpy(p->base, "/tmp/hexad-cache-XXXXXX");
    assert_non_null(mkdtemp(p->base));
    p->input = mem_printf("%s/a.vdb", p->base);
    p->result = mem_printf("%s/result", p->base);
    p->target = mem_printf("%s/target", p->base);
    put(p->input, "volume");
    assert_true(store_directory_create(p->result, NULL));
    char *points = mem_printf("%s/points.ply", p->result);
    put(points, "x");
    write_report(p);
    free(points);
    p->roots = store_roots_open(NULL, (const char *[]){p->base}, 1, NULL);
    assert_non_null(p->roots);
    *state = p;
    return 0;
}

static int tear_down(void **state)
{
    place *p = *state;
    store_roots_close(p->roots);
    assert_true(store_remove(p->base, NULL));
    free(p->input);
    free(p->result);
    free(p->target);
    free(p);
    return 0;
}

#define SPEC(name, count, rest) "{\"version\":1," name "\"sampling\":{\"count\":" count "}" rest "}"

static bool key_of(const char *spec, char key[STORE_HASH_SIZE])
{
    json *document = json_parse(spec, strlen(spec), NULL);
    bool can = cache_key(document, key);
    json_free(document);
    return can;
}

static void test_keys(void **state)
{
    (void)state;
    char key[STORE_HASH_SIZE], other[STORE_HASH_SIZE];
    static const char *const same[] = {
        SPEC("\"name\":\"n\",", "9", ",\"output\":{\"ply\":1},\"queue\":{\"priority\":7}"),
        SPEC("", "9", ",\"output\":{\"ply\":1,\"directory\":\"/a\"},\"limits\":{\"memory_mb\":77}")};
    static const char *const different[] = {SPEC("", "10", ",\"output\":{\"ply\":1}"),
                                            SPEC("", "9", ",\"output\":{\"ply\":2}"), SPEC("", "9", "")};
    assert_true(key_of(SPEC("", "9", ",\"output\":{\"ply\":1}"), key));
    assert_int_equal(strlen(key), 64);
    for (size_t i = 0; i < sizeof same / sizeof *same; i++) {
        assert_true(key_of(same[i], other));
        assert_string_equal(key, other);
    }
    for (size_t i = 0; i < sizeof different / sizeof *different; i++) {
        assert_true(key_of(different[i], other));
        assert_string_not_equal(key, other);
    }
    /* a build with a commit does not have the keys of one that has only the version */
    char *short_key = mem_printf("%s\n%s", PACKAGE_VERSION,
                                 "{\"version\":1,\"sampling\":{\"count\":9},\"output\":{\"ply\":1}}");
    store_hash(short_key, strlen(short_key), other);
    free(short_key);
    assert_int_equal(strcmp(key, other) == 0, !strchr(PACKAGE_VERSION, '~') || !cache_identifies_build());
}

static void test_changed_inputs_make_an_entry_invalid(void **state)
{
    place *p = *state;
    int64_t later = INT64_C(1) << 42;
    assert_null(cache_describe_inputs(p->roots, p->result, 1000)); /* the file is younger than the attempt */
    char *inputs = cache_describe_inputs(p->roots, p->result, later);
    assert_non_null(inputs);
    assert_true(cache_is_fresh(p->roots, inputs));
    char *copy = mem_printf("%s.new", p->input);
    put(copy, "volume"); /* the same bytes, in another file */
    assert_int_equal(rename(copy, p->input), 0);
    assert_false(cache_is_fresh(p->roots, inputs));
    free(inputs);
    /* it is another file than the one that was read */
    assert_null(cache_describe_inputs(p->roots, p->result, later));
    write_report(p);
    inputs = cache_describe_inputs(p->roots, p->result, later);
    assert_true(cache_is_fresh(p->roots, inputs));
    put(p->input, "another");
    assert_false(cache_is_fresh(p->roots, inputs));
    assert_int_equal(unlink(p->input), 0);
    assert_false(cache_is_fresh(p->roots, inputs));
    assert_null(cache_describe_inputs(p->roots, p->result, later));
    assert_false(cache_is_fresh(p->roots, "no JSON"));
    free(copy);
    free(inputs);
}

static char *spec_in(const char *directory)
{
    result r = {0};
    json *report = result_read_report(directory, &r, NULL);
    assert_non_null(report);
    char *text = json_print(json_find(report, "/spec"));
    json_free(report);
    result_clear(&r);
    return text;
}

static bool is_same_file(const char *one, const char *other, const char *name)
{
    struct stat a, b;
    char *first = mem_printf("%s/%s", one, name), *second = mem_printf("%s/%s", other, name);
    assert_true(stat(first, &a) == 0 && stat(second, &b) == 0);
    free(first);
    free(second);
    return a.st_ino == b.st_ino;
}

static void test_a_hit_shares_all_files_but_the_report(void **state)
{
    place *p = *state;
    error e = {0};
    result r = {0};
    if (!cache_link_result(p->result, p->target, "{\"name\":\"asking\"}", NULL, &r, &e))
        fail_msg("%s", e.message);
    assert_int_equal(r.outcome, QUEUE_CONVERGED);
    assert_int_equal(r.output_count, 1);
    result_clear(&r);
    assert_true(is_same_file(p->result, p->target, "points.ply"));
    assert_false(is_same_file(p->result, p->target, "report.json"));
    char *there = spec_in(p->result), *here = spec_in(p->target);
    assert_string_equal(there, "{\"name\":\"first\"}");
    assert_string_equal(here, "{\"name\":\"asking\"}");
    assert_true(store_remove(p->result, NULL)); /* each job has its own links */
    assert_true(result_read(p->target, &r, NULL));
    result_clear(&r);
    assert_false(cache_link_result(p->result, p->base, "{}", NULL, &r, &e));
    free(there);
    free(here);
}

static void test_a_damaged_result_is_not_linked(void **state)
{
    place *p = *state;
    error e = {0};
    result r = {0};
    char *points = mem_printf("%s/points.ply", p->result);
    put(points, "y");
    assert_false(cache_link_result(p->result, p->target, "{}", NULL, &r, &e));
    assert_int_equal(e.code, ERROR_INPUT_DAMAGED);
    assert_non_null(strstr(e.message, "points.ply is damaged"));
    assert_int_equal(access(p->target, F_OK), -1);
    free(points);
}

/* A report whose sweeps take 100 MB when they are parsed, in whatever way it is printed. */
static void put_long_report(const place *p)
{
    char *path = mem_printf("%s/report.json", p->result);
    size_t length = 0;
    char *text = store_file_read(path, 10000, &length, NULL);
    FILE *file = fopen(path, "w");
    assert_non_null(file);
    fputs("{\"sweeps\": [0", file);
    for (int i = 0; i < 1500000; i++) fputs(",1", file);
    fprintf(file, "],%s", text + 1);
    assert_int_equal(fclose(file), 0);
    free(text);
    free(path);
}

static long peak_kb(void)
{
    struct rusage usage;
    assert_int_equal(getrusage(RUSAGE_SELF, &usage), 0);
    return usage.ru_maxrss;
}

static void test_a_long_report_is_not_in_memory_as_a_whole(void **state)
{
    place *p = *state;
    result r = {0};
    put_long_report(p);
    long before = peak_kb();
    char *inputs = cache_describe_inputs(p->roots, p->result, INT64_C(1) << 42);
    assert_non_null(inputs);
    assert_true(cache_link_result(p->result, p->target, "{\"name\":\"asking\"}", NULL, &r, NULL));
    assert_true(peak_kb() - before < 32768);
    char *path = mem_printf("%s/report.json", p->target), *spec = spec_in(p->target);
    size_t length = 0;
    char *text = store_file_read(path, 100 << 20, &length, NULL);
    json *report = json_parse(text, length, NULL);
    assert_int_equal(json_size((json_at){json_find(report, "/sweeps"), NULL, NULL, 0}), 1500001);
    assert_string_equal(spec, "{\"name\":\"asking\"}");
    json_free(report);
    result_clear(&r);
    free(inputs);
    free(spec);
    free(path);
    free(text);
}

static void test_the_report_of_a_hit_has_its_summary(void **state)
{
    place *p = *state;
    result r = {0};
    struct stat info;
    char *report = mem_printf("%s/report.json", p->result),
         *summary = mem_printf("%s/summary.json", p->result);
    assert_int_equal(stat(report, &info), 0);
    char *text = mem_printf("{\"outcome\":\"unresolved\",\"count\":8,\"outputs\":[],\"report_bytes\":%lld}",
                            (long long)info.st_size);
    put(summary, text);
    assert_true(cache_link_result(p->result, p->target, "{\"name\":\"asking for more\"}", NULL, &r, NULL));
    result_clear(&r);
    assert_true(result_read(p->target, &r, NULL));
    assert_int_equal(r.count, 8); /* from the summary */
    result_clear(&r);
    free(text);
    free(summary);
    free(report);
}

static void test_a_report_with_another_spec_is_corrected(void **state)
{
    place *p = *state;
    error e = {0};
    result r = {0};
    char *old = mem_printf("%s/report.json", p->result), *linked = mem_printf("%s/report.json", p->target);
    assert_true(store_directory_create(p->target, NULL));
    assert_int_equal(link(old, linked), 0);
    assert_false(own_report_correct(p->target, "{}", &e)); /* the directory is not a result */
    assert_int_equal(e.code, ERROR_INPUT_DAMAGED);
    char *from = mem_printf("%s/points.ply", p->result), *to = mem_printf("%s/points.ply", p->target);
    assert_int_equal(link(from, to), 0);
    assert_true(result_list(p->target, &r, NULL));
    result_clear(&r);
    assert_true(own_report_correct(p->target, "{\"name\":\"first\"}", &e));
    assert_true(is_same_file(p->result, p->target, "report.json"));
    assert_true(own_report_correct(p->target, "{\"name\":\"asking\"}", &e));
    assert_false(is_same_file(p->result, p->target, "report.json"));
    char *there = spec_in(p->result), *here = spec_in(p->target), hash[STORE_HASH_SIZE];
    assert_string_equal(there, "{\"name\":\"first\"}");
    assert_string_equal(here, "{\"name\":\"asking\"}");
    size_t length = 0;
    char *text = store_file_read(linked, 10000, &length, NULL);
    store_hash(text, length, hash);
    assert_true(result_list(p->target, &r, NULL)); /* the stored list of the old report was removed */
    assert_string_equal(r.output[1].sha256, hash);
    result_clear(&r);
    free(text);
    free(there);
    free(here);
    free(from);
    free(to);
    free(old);
    free(linked);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_keys),
        cmocka_unit_test_setup_teardown(test_changed_inputs_make_an_entry_invalid, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_a_hit_shares_all_files_but_the_report, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_a_damaged_result_is_not_linked, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_a_long_report_is_not_in_memory_as_a_whole, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_the_report_of_a_hit_has_its_summary, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_a_report_with_another_spec_is_corrected, set_up, tear_down),
    };
    return cmocka_run_group_tests_name("cache", tests, NULL, NULL);
}
