// SPDX-License-Identifier: Apache-2.0
/* Hosts and origins that are accepted on a port without tokens. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include "service/http/pages.h"

static const char *const named[] = {"https://gui.example", "http://localhost:3000"};

static void test_hosts(void **state)
{
    (void)state;
    error e;
    pages *p = pages_new(named, 2, &e);
    assert_non_null(p);
    pages_add(p, "unix:/run/hexad", "unix:/run/hexad");
    pages_add(p, "10.0.0.1:0", "10.0.0.1:9090");
    pages_add(p, "myself:8080", "127.0.1.1:8080");
    static const char *const ours[] = {"127.0.1.1:8080", "localhost:8080", "LocalHost:8080", "127.0.0.1:8080",
                                       "[::1]:8080",     "myself:8080",    "10.0.0.1:9090",  "localhost:9090",
                                       "gui.example",    "localhost:3000"};
    static const char *const others[] = {"",
                                         "localhost",
                                         "localhost:80",
                                         "127.0.0.1",
                                         "evil.example:8080",
                                         "localhost:8080.evil",
                                         "::1:8080",
                                         "localhost:08080",
                                         "localhost:",
                                         "evil.example",
                                         "gui.example:8080",
                                         "xlocalhost:8080",
                                         "localhost.",
                                         "127.0.0.1:8080 ",
                                         "127.1:8080",
                                         "myself:9090"};
    for (size_t i = 0; i < sizeof ours / sizeof *ours; i++)
        if (!pages_is_host(p, ours[i])) fail_msg("%s", ours[i]);
    for (size_t i = 0; i < sizeof others / sizeof *others; i++)
        if (pages_is_host(p, others[i])) fail_msg("%s", others[i]);
    pages_free(p);
    p = pages_new(NULL, 0, &e);
    pages_add(p, "", "[::1]:80");
    assert_true(pages_is_host(p, "localhost") && pages_is_host(p, "[::1]"));
    assert_false(pages_has_listed(p) || pages_is_host(p, "localhost:8080"));
    pages_free(p);
    p = pages_new(NULL, 0, &e);
    pages_add(p, "", "unix:/run/hexad:1");
    assert_false(pages_is_host(p, "localhost:1") || pages_is_host(p, ""));
    pages_free(p);
}

static void test_origins(void **state)
{
    (void)state;
    error e;
    pages *p = pages_new(named, 2, &e);
    assert_non_null(p);
    pages_add(p, "127.0.0.1:0", "127.0.0.1:8080");
    assert_true(pages_is_permitted(p, "http://localhost:8080") && pages_is_permitted(p, "http://[::1]:8080"));
    assert_true(pages_is_permitted(p, "https://gui.example") && pages_is_listed(p, "https://gui.example"));
    assert_true(pages_is_listed(p, "http://localhost:3000") && !pages_is_listed(p, "http://localhost:8080"));
    static const char *const others[] = {"",
                                         "null",
                                         "http://",
                                         "http://evil.example",
                                         "https://localhost:8080",
                                         "http://gui.example",
                                         "https://gui.example:443",
                                         "https://gui.example.evil",
                                         "https://evil.gui.example",
                                         "localhost:8080",
                                         "http://localhost:8080/",
                                         "http://localhost:8080@evil.example",
                                         "http://localhost",
                                         "HTTPS://GUI.EXAMPLE"};
    for (size_t i = 0; i < sizeof others / sizeof *others; i++)
        if (pages_is_permitted(p, others[i])) fail_msg("%s", others[i]);
    pages_free(p);
}

static void test_texts_that_are_no_origins_are_refused(void **state)
{
    (void)state;
    static const char *const bad[] = {"",           "*",          "null",      "gui.example",
                                      "http://",    "ftp://x",    "http://x/", "http://X",
                                      "http://a b", "http://u@x", "http://x?", "http:/x"};
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        error e = {0};
        if (pages_new(&bad[i], 1, &e)) fail_msg("%s", bad[i]);
        assert_int_equal(e.code, ERROR_SPEC_INVALID);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_hosts),
        cmocka_unit_test(test_origins),
        cmocka_unit_test(test_texts_that_are_no_origins_are_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
