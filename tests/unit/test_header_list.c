// SPDX-License-Identifier: Apache-2.0
/* Unit tests of service/http/header_list: elements of lists in headers. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include "service/http/header_list.h"

static void test_an_element_is_found_by_its_token(void **state)
{
    static const struct {
        const char *list, *rest; /* rest: behind "wait"; NULL: no such element */
    } rows[] = {
        {"wait=3", "=3"},
        {"WAIT \t= 3", "= 3"},
        {"wait", ""},
        {"a, wait=3, wait=9", "=3, wait=9"},
        {",, ,wait;a", ";a"},
        {"a=\"x, wait=9\", wait=3", "=3"},
        {"a=\"\\\", wait=9\", wait=3", "=3"},
        {"a=\"\\\\\", wait=3", "=3"},
        {"", NULL},
        {" , ", NULL},
        {"await=3, wait-a=3, waits", NULL},
        {"wai", NULL},
        {"a; wait=9", NULL},
        {"a=\"x, wait=9", NULL},
        {"a=\"\\", NULL},
    };
    (void)state;
    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
        const char *found = header_list_find(rows[i].list, "wait");
        if (!rows[i].rest && found) fail_msg("%s: found %s", rows[i].list, found);
        if (rows[i].rest && !found) fail_msg("%s: not found", rows[i].list);
        if (found) assert_string_equal(found, rows[i].rest);
    }
    assert_null(header_list_find(NULL, "wait"));
    assert_string_equal(header_list_find("text/html, Text/Event-Stream;q=1", "text/event-stream"), ";q=1");
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_an_element_is_found_by_its_token)};
    return cmocka_run_group_tests_name("header_list", tests, NULL, NULL);
}
