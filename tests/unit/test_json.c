// SPDX-License-Identifier: Apache-2.0
/* json: strict parsing, positions and pointers, numbers that round-trip. */
#include <dirent.h>
#include <errno.h>
#include <float.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "base/core/memory.h"
#include "base/json/json.h"
#include "base/json/json_copy.h"

static void refuse(const char *text, size_t length, const char *words)
{
    error e = {0};
    json *root = json_parse(text, length, &e);
    if (root) fail_msg("accepted: %s", text);
    assert_int_equal(e.code, ERROR_SPEC_INVALID);
    if (!strstr(e.message, words)) fail_msg("'%s' does not say '%s'", e.message, words);
}

static json *accept(const char *text)
{
    error e = {0};
    json *root = json_parse(text, strlen(text), &e);
    if (!root) fail_msg("%s refused: %s", text, e.message);
    return root;
}

static void test_errors_name_the_position(void **state)
{
    (void)state;
    static const struct {
        const char *text, *words;
    } cases[] = {
        {"", "line 1 column 1: the JSON text is incomplete"},
        {"{\n  \"a\": 1,\n  \"b\" 2}", "line 3 column 7: expected ':'"},
        {"[1, 2,]", "line 1 column 7: a comma before ']' is not allowed"},
        {"[01]", "the number begins with 0"},
        {"[1.]", "after its decimal point"},
        {"[1e]", "in its exponent"},
        {"[-]", "has no digit"},
        {"[1e400]", "line 1 column 2: the number is too large"},
        {"[NaN]", "expected a value"},
        {"{\"a\":1,\"b\":2,\"a\":3}", "line 1 column 14: the member 'a' is given twice"},
        {"{\"a\":1,\"\\u0061\":3}", "the member 'a' is given twice"},
        {"[\"\\u0000\"]", "line 1 column 3: the string contains \\u0000"},
        {"[\"\\ud800\"]", "high surrogate"},
        {"[\"\\ud800\\u0041\"]", "high surrogate"},
        {"[\"\\udc00\"]", "low surrogate"},
        {"[\"\xc3\"]", "UTF-8"},
        {"[\"\xed\xa0\x80\"]", "UTF-8"},
        {"[\"\xc0\xaf\"]", "UTF-8"},
        {"[\"\xf4\x90\x80\x80\"]", "UTF-8"},
        {"[\"a\tb\"]", "control character"},
        {"[\"\\x\"]", "unknown escape"},
        {"[\"\\u12g4\"]", "hexadecimal"},
        {"{a:1}", "member name"},
        {"{\"a\":1,}", "column 8: a comma before '}' is not allowed"},
        {"[1,\n]", "line 2 column 1: a comma before ']' is not allowed"},
        {"{\"a\":1, // x\n}", "JSON does not allow comments"},
        {"/* x */ {}", "JSON does not allow comments"},
        {"[1 # x\n]", "JSON does not allow comments"},
        {"[1] x", "line 1 column 5: more text follows"},
        {"[1", "JSON text is incomplete"},
        {"\"abc", "JSON text is incomplete"},
        {"[\"\xc3\xa4\xc3\xa4\" 1]", "line 1 column 7: expected ','"},
        {"\xef\xbb\xbf{}", "byte order mark"},
        {"[\f1]", "expected a value"},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++)
        refuse(cases[i].text, strlen(cases[i].text), cases[i].words);
    refuse("[1]\0", 4, "more text follows");
    refuse("[\"a\0b\"]", 7, "control character");
    assert_null(json_parse("[", 1, NULL));
}

static void test_depth_limit(void **state)
{
    (void)state;
    char text[4 * JSON_MAX_DEPTH];
    for (int depth = JSON_MAX_DEPTH; depth <= JSON_MAX_DEPTH + 1; depth++) {
        memset(text, '[', (size_t)depth);
        memset(text + depth, ']', (size_t)depth);
        json *root = json_parse(text, 2 * (size_t)depth, NULL);
        assert_int_equal(root != NULL, depth == JSON_MAX_DEPTH);
        json_free(root);
    }
    json_free(NULL);
}

static void test_every_truncation_is_refused(void **state)
{
    (void)state;
    const char *text = "{\"a\":[1.5e3,true,null,\"\\ud83d\\ude00\xc3\xa4\"],\"b\":{\"c\":false}}";
    size_t length = strlen(text);
    json_free(accept(text));
    for (size_t n = 0; n < length; n++) {
        char *part = mem_strndup(text, n); /* exactly n bytes, so that a sanitizer detects an overrun */
        refuse(part, n, "line 1");
        free(part);
    }
}

static void test_places(void **state)
{
    (void)state;
    json *root = accept("{\"a/b~\":[10,{\"x\":\"\\u00e4\\uD83D\\uDE00\"}],\"t\":true,\"z\":null}");
    json_at at = json_root(root), list = json_member(&at, "a/b~"), ten = json_first(&list),
            second = json_next(&ten), x = json_member(&second, "x"), none = json_member(&x, "no"),
            first = json_first(&at), beyond = json_next(&second), of_number = json_first(&ten);
    char pointer[64], small[6];
    assert_string_equal(json_pointer(&at, pointer, sizeof pointer), "");
    assert_string_equal(json_pointer(&x, pointer, sizeof pointer), "/a~1b~0/1/x");
    assert_string_equal(json_pointer(&none, pointer, sizeof pointer), "/a~1b~0/1/x/no");
    assert_string_equal(json_pointer(&x, small, sizeof small), "/a~1b");
    assert_string_equal(first.key, "a/b~");
    assert_int_equal(json_type_of(at), JSON_OBJECT);
    assert_int_equal(json_type_of(list), JSON_ARRAY);
    assert_int_equal(json_type_of(none), JSON_NONE);
    assert_int_equal(json_type_of(beyond), JSON_NONE);
    assert_int_equal(json_type_of(of_number), JSON_NONE);
    assert_int_equal(json_type_of(json_first(&none)), JSON_NONE);
    assert_string_equal(json_next(&first).key, "t");
    assert_int_equal(second.index, 1);
    assert_int_equal(json_type_of(json_member(&at, "z")), JSON_NULL);
    assert_int_equal(json_size(list), 2);
    assert_int_equal(json_size(at), 3);
    assert_int_equal(json_size(x), 0);
    assert_string_equal(json_string(x, ""), "\xc3\xa4\xf0\x9f\x98\x80");
    assert_true(json_number(ten, 0) == 10);
    assert_true(json_number(x, 7) == 7);
    assert_true(json_bool(json_member(&at, "t"), false));
    assert_true(json_bool(x, true));
    assert_null(json_string(list, NULL));
    json_free(root);
}

static void test_values_are_found_and_set(void **state)
{
    (void)state;
    json *root = accept("{\"a/b~\":[10,{\"x\":\"old\"}],\"~1\":2,\"\":3}");
    json_set_string(json_find(root, "/a~1b~0/1/x"), "longer than the old one");
    json_at at = json_root(root), list = json_member(&at, "a/b~"), first = json_first(&list),
            second = json_next(&first);
    assert_string_equal(json_string(json_member(&second, "x"), ""), "longer than the old one");
    assert_ptr_equal(json_find(root, ""), root);
    assert_ptr_equal(json_find(root, "/~01"), json_member(&at, "~1").node);
    assert_ptr_equal(json_find(root, "/"), json_member(&at, "").node);
    static const char *const none[] = {"a/b~",     "/no",        "/a~1b~0/2",   "/a~1b~0/x",
                                       "/a~1b~0/", "/a~1b~0/-1", "/a~1b~0/0/x", "/a~1b~0/1/x/y"};
    for (size_t i = 0; i < sizeof none / sizeof *none; i++)
        if (json_find(root, none[i])) fail_msg("%s is found", none[i]);
    json_free(root);
}

static void test_values_are_put_at_pointers(void **state)
{
    (void)state;
    json *root = accept("{\"a/b~\":[10,{\"x\":\"old\"}],\"n\":2}");
    static const char *const places[] = {"/a~1b~0/0", "/a~1b~0/1/x", "/n", "/new", "/o/p~1/q"};
    for (size_t i = 0; i < sizeof places / sizeof *places; i++) {
        if (!json_set(root, places[i], json_new_number(1.5))) fail_msg("%s", places[i]);
        assert_true(json_number(json_root(json_find(root, places[i])), 0) == 1.5);
    }
    char *text = json_print(root);
    assert_string_equal(text,
                        "{\"a/b~\":[1.5,{\"x\":1.5}],\"n\":1.5,\"new\":1.5,\"o\":{\"p/\":{\"q\":1.5}}}");
    static const char *const none[] = {"", "n", "/a~1b~0/2", "/a~1b~0/x", "/a~1b~0/9/x", "/n/x", "/n/x/y"};
    json *value = json_new_number(7);
    for (size_t i = 0; i < sizeof none / sizeof *none; i++)
        if (json_set(root, none[i], value)) fail_msg("%s is a place", none[i]);
    json_free(value);
    free(text);
    json_free(root);
}

static void test_pointer_is_truncated_between_characters(void **state)
{
    (void)state;
    json *root = accept("{\"\xc3\xa4\xc3\xb6\":1}");
    json_at at = json_root(root), member = json_first(&at);
    char buffer[5];
    assert_string_equal(json_pointer(&member, buffer, sizeof buffer), "/\xc3\xa4");
    json_free(root);
}

static void test_building(void **state)
{
    (void)state;
    json *root = json_new_object();
    json_put_string(root, "s", "a\"\\\n\x01\xc3\xa4");
    json_put_string(root, "none", NULL);
    json_put_number(root, "n", 0.1);
    json_put_number(root, "inf", INFINITY);
    json_put_integer(root, "i", INT64_C(9007199254740992));
    json_put_bool(root, "b", false);
    json_put_null(root, "z");
    json_put_integer(root, "n", -3);
    json_put_text(root, "t", "{\"k\":[1.50]}");
    json_put_number(root, "zero", -0.0);
    json *list = json_put_array(root, "l");
    json_append_number(list, 1e300);
    json_append_string(list, "x");
    json *inner = json_append_object(json_put_array(root, "o"));
    json_put_object(inner, "e");
    char *text = json_print(root);
    assert_string_equal(
        text,
        "{\"s\":\"a\\\"\\\\\\n\\u0001\xc3\xa4\",\"none\":null,\"n\":-3,\"inf\":null,"
        "\"i\":9007199254740992,\"b\":false,\"z\":null,\"t\":{\"k\":[1.50]},\"zero\":-0,\"l\":[1e+300,\"x\"],"
        "\"o\":[{\"e\":{}}]}");
    json *copy = json_copy(root), *again = accept(text);
    char *copied = json_print(copy), *reread = json_print(again), *pretty = json_print_pretty(list);
    assert_string_equal(copied, text);
    assert_int_equal(strlen(reread), strlen(text) - 1); /* 1.50 becomes 1.5 */
    assert_string_equal(pretty, "[1e+300, \"x\"]\n");
    free(pretty);
    pretty = json_print_pretty(inner);
    assert_string_equal(pretty, "{\n  \"e\": {}\n}\n");
    free(text);
    free(copied);
    free(reread);
    free(pretty);
    json_free(copy);
    json_free(again);
    json_free(root);
}

/* splitmix64 (public domain, S. Vigna) */
static uint64_t next_random(uint64_t *seed)
{
    uint64_t z = *seed += UINT64_C(0x9E3779B97F4A7C15);
    z = (z ^ (z >> 30)) * UINT64_C(0xBF58476D1CE4E5B9);
    z = (z ^ (z >> 27)) * UINT64_C(0x94D049BB133111EB);
    return z ^ (z >> 31);
}

static void check_round_trip(double value)
{
    json *list = json_new_array();
    json_append_number(list, value);
    char *text = json_print(list);
    json *again = accept(text);
    json_at at = json_root(again);
    double read = json_number(json_first(&at), NAN);
    if (memcmp(&read, &value, sizeof read) != 0)
        fail_msg("%.17g came back as %.17g from %s", value, read, text);
    free(text);
    json_free(again);
    json_free(list);
}

static void test_numbers_round_trip(void **state)
{
    (void)state;
    static const double values[] = {0,
                                    -0.0,
                                    0.1,
                                    1.0 / 3,
                                    1e22,
                                    1e23,
                                    DBL_MAX,
                                    DBL_MIN,
                                    4.9e-324,
                                    0.3,
                                    123456789012345678.0,
                                    9007199254740993.0,
                                    -1e15,
                                    5e-5};
    for (size_t i = 0; i < sizeof values / sizeof *values; i++) check_round_trip(values[i]);
    const char *given = getenv("HEXAD_TEST_SEED");
    uint64_t seed = given ? strtoull(given, NULL, 10) : 20050101;
    printf("# seed %llu\n", (unsigned long long)seed);
    for (int i = 0; i < 20000; i++) {
        uint64_t bits = next_random(&seed);
        double value;
        memcpy(&value, &bits, sizeof value);
        if (isfinite(value)) check_round_trip(value);
    }
    json *root =
        accept("[0.1000000000000000000000000000000000000000000000000000000000000000000000000000001]");
    char *text = json_print(root);
    assert_string_equal(text, "[0.1]");
    free(text);
    json_free(root);
}

/* ---- JSONTestSuite ---- */

static char *read_whole(const char *path, size_t *length)
{
    FILE *file = fopen(path, "rb");
    if (!file) fail_msg("%s: %s", path, strerror(errno));
    fseek(file, 0, SEEK_END);
    *length = (size_t)ftell(file);
    rewind(file);
    char *text = mem_alloc(*length);
    assert_int_equal(fread(text, 1, *length, file), *length);
    fclose(file);
    return text;
}

static char *suite_directory(void)
{
    const char *shared = getenv("HEXAD_SHARED"), *source = getenv("HEXAD_SOURCE");
    return shared ? mem_printf("%s/json/JSONTestSuite", shared)
                  : mem_printf("%s/../shared/data/json/JSONTestSuite", source ? source : ".");
}

/* Valid JSON that the parser refuses by design, see json.h. */
static bool is_refused_on_purpose(const char *name)
{
    static const char *const names[] = {"y_object_duplicated_key.json",
                                        "y_object_duplicated_key_and_value.json",
                                        "y_object_escaped_null_in_key.json", "y_string_null_escape.json"};
    for (size_t i = 0; i < sizeof names / sizeof *names; i++)
        if (strcmp(names[i], name) == 0) return true;
    return false;
}

static void test_suite(void **state)
{
    (void)state;
    char *directory = suite_directory();
    DIR *handle = opendir(directory);
    assert_non_null(handle);
    int seen = 0;
    for (struct dirent *entry; (entry = readdir(handle));) {
        char kind = entry->d_name[0];
        if (entry->d_name[1] != '_') continue;
        char *path = mem_printf("%s/%s", directory, entry->d_name);
        size_t length;
        char *text = read_whole(path, &length);
        json *root = json_parse(text, length, NULL);
        if (kind == 'y' && !root != is_refused_on_purpose(entry->d_name)) fail_msg("%s", entry->d_name);
        if (kind == 'n' && root) fail_msg("accepted: %s", entry->d_name);
        if (root) free(json_print_pretty(root));
        json_free(root);
        free(text);
        free(path);
        seen++;
    }
    closedir(handle);
    free(directory);
    assert_true(seen > 300);
}

static void test_ill_formed_utf8_is_printed_as_json(void **state)
{
    (void)state;
    const struct {
        const char *given, *printed;
    } cases[] = {
        {"caf\xE9", "[\"caf\xEF\xBF\xBD\"]"},
        {"\xFF\xFEx", "[\"\xEF\xBF\xBD\xEF\xBF\xBDx\"]"},
        {"cut \xE2\x82", "[\"cut \xEF\xBF\xBD\xEF\xBF\xBD\"]"},
        {"\xE2\x82\xAC good", "[\"\xE2\x82\xAC good\"]"},
    };
    for (size_t k = 0; k < sizeof cases / sizeof cases[0]; k++) {
        json *list = json_new_array();
        json_append_string(list, cases[k].given);
        char *text = json_print(list);
        assert_string_equal(text, cases[k].printed);
        assert_int_equal(json_is_text(cases[k].given), strstr(text, cases[k].given) != NULL);
        json *back = json_parse(text, strlen(text), NULL);
        assert_non_null(back);
        json_free(back);
        free(text);
        json_free(list);
    }
}

/* The copy of a text, which the caller frees; NULL if it is refused. */
static char *replace(const char *text, const char *key, const char *value, size_t *replaced)
{
    char *copy = NULL;
    size_t length = 0;
    FILE *from = fmemopen((void *)(uintptr_t)text, strlen(text), "r"), *to = open_memstream(&copy, &length);
    assert_true(from && to);
    bool ok = json_copy_replacing(from, key, value, to, replaced);
    fclose(from);
    assert_int_equal(fclose(to), 0);
    if (ok) return copy;
    free(copy);
    return NULL;
}

static void test_a_copy_replaces_members_of_the_outermost_object_only(void **state)
{
    (void)state;
    static const struct {
        const char *text, *copy;
        size_t replaced;
    } cases[] = {
        {"{\"a\": {\"a\": [1, \"}\"]}, \"b\": 2}", "{\"a\":7, \"b\": 2}", 1},
        {"{\"b\":\"a\",\"a\":\"\\\\\\\"},\",\"c\":3}", "{\"b\":\"a\",\"a\":7,\"c\":3}", 1},
        {"{\"b\":{\"a\":1},\"ab\":1,\"\":1,\"c\":[{\"a\":1}]}",
         "{\"b\":{\"a\":1},\"ab\":1,\"\":1,\"c\":[{\"a\":1}]}", 0},
        {"{\"a\":1}\n", "{\"a\":7}\n", 1},
        {"{\"a\":1,\"a\":[]}", "{\"a\":7,\"a\":7}", 2},
        {"[\"a\",{\"a\":1}]", "[\"a\",{\"a\":1}]", 0},
    };
    static const char *const refused[] = {"1", "{\"a\":1", "{\"a\":[1}]}}", "{\"a\":\"}", "}"};
    size_t replaced = 0;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        char *copy = replace(cases[i].text, "a", "7", &replaced);
        assert_non_null(copy);
        assert_string_equal(copy, cases[i].copy);
        assert_int_equal(replaced, cases[i].replaced);
        free(copy);
    }
    for (size_t i = 0; i < sizeof refused / sizeof *refused; i++)
        assert_null(replace(refused[i], "a", "7", &replaced));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_a_copy_replaces_members_of_the_outermost_object_only),
        cmocka_unit_test(test_errors_name_the_position),
        cmocka_unit_test(test_depth_limit),
        cmocka_unit_test(test_every_truncation_is_refused),
        cmocka_unit_test(test_places),
        cmocka_unit_test(test_values_are_found_and_set),
        cmocka_unit_test(test_values_are_put_at_pointers),
        cmocka_unit_test(test_pointer_is_truncated_between_characters),
        cmocka_unit_test(test_building),
        cmocka_unit_test(test_numbers_round_trip),
        cmocka_unit_test(test_ill_formed_utf8_is_printed_as_json),
        cmocka_unit_test(test_suite), /* last: skipped without shared data */
    };
    size_t count = sizeof tests / sizeof *tests;
    char *directory = suite_directory();
    DIR *handle = opendir(directory);
    if (handle) {
        closedir(handle);
    } else {
        printf("# skipped: no shared data (%s)\n", directory);
        count--;
    }
    free(directory);
    return _cmocka_run_group_tests("json", tests, count, NULL, NULL);
}
