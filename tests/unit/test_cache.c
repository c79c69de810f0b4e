#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/memory.h"
#include "executor/cache.h"

typedef struct place {
    char base[64];
    char *input, *result, *target;
    store_roots *roots;
} place;

static void put(const char *path, const char *text)
{
    assert_true(store_file_write(path, text, strlen(text), NULL));
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
    char *report = mem_printf("%s/report.json", p->result), *points = mem_printf("%s/points.ply", p->result);
    char *text =
        mem_printf("{\"outcome\":\"converged\",\"count\":7,\"inputs\":[{\"path\":\"%s\",\"sha256\":\"ab\"}],"
                   "\"outputs\":[{\"name\":\"points.ply\",\"bytes\":1,\"sha256\":\"%064d\"}]}",
                   p->input, 0);
    put(report, text);
    put(points, "x");
    free(text);
    free(report);
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
    assert_false(
        key_of("{\"sampling\":{\"time_s\":3}}", other)); /* the best of that time is another each time */
}

static void test_inputs_that_change(void **state)
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

static void test_a_result_is_linked(void **state)
{
    place *p = *state;
    error e = {0};
    if (!cache_link_result(p->result, p->target, &e)) fail_msg("%s", e.message);
    char *points = mem_printf("%s/points.ply", p->target), *report = mem_printf("%s/report.json", p->target);
    assert_true(store_remove(p->result, NULL)); /* each job has its files */
    assert_int_equal(access(points, R_OK), 0);
    assert_int_equal(access(report, R_OK), 0);
    assert_false(cache_link_result(p->result, p->base, &e));
    free(points);
    free(report);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_keys),
        cmocka_unit_test_setup_teardown(test_inputs_that_change, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_a_result_is_linked, set_up, tear_down),
    };
    return cmocka_run_group_tests_name("cache", tests, NULL, NULL);
}
