// SPDX-License-Identifier: Apache-2.0
/* The client behind proxies: only elements of trusted proxies count, beginning at the right end. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>
#include <cmocka.h>

#include "service/http/forwarded.h"

/* Trusted proxies in all cases; the last three bits of the second range vary. */
static const char *const proxies[] = {"127.0.0.1", "10.1.2.8/29", "2001:db8:aa::/48"};

static void test_cases(void **state)
{
    (void)state;
    static const struct {
        const char *peer, *first, *second, *client;
    } cases[] = {
        {"127.0.0.1", "for=192.0.2.7", NULL, "192.0.2.7"},
        {"127.0.0.1", "For=\"192.0.2.7:4711\";proto=http;by=_me", NULL, "192.0.2.7"},
        {"127.0.0.1", "proto=https;host=\"a,b;c=\\\"d\\\"\";for=192.0.2.7", NULL, "192.0.2.7"},
        {"127.0.0.1", "for=\"[2001:db8::1]:_x\"", NULL, "2001:db8::1"},
        {"127.0.0.1", "for=\"[2001:DB8:0::1]\"", NULL, "2001:db8::1"},
        {"::ffff:127.0.0.1", "for=\"[::ffff:192.0.2.7]\"", NULL, "192.0.2.7"},
        /* the last element counts; the client's own element precedes it */
        {"127.0.0.1", "for=198.51.100.1, for=192.0.2.7", NULL, "192.0.2.7"},
        {"127.0.0.1", "for=198.51.100.1", "for=192.0.2.7", "192.0.2.7"},
        /* past trusted proxies to the first address that is not trusted */
        {"127.0.0.1", "for=198.51.100.1,for=192.0.2.7 ,\tfor=10.1.2.15", NULL, "192.0.2.7"},
        {"127.0.0.1", "for=192.0.2.7, for=\"[2001:db8:aa:1::5]\"", "for=10.1.2.9", "192.0.2.7"},
        {"127.0.0.1", "for=10.1.2.9, for=10.1.2.10", NULL, "10.1.2.9"},
        {"127.0.0.1", "for=192.0.2.7, for=10.1.2.16", NULL, "10.1.2.16"},
        /* a proxy that gives no address is itself the client */
        {"127.0.0.1", "for=192.0.2.7, for=unknown", NULL, "127.0.0.1"},
        {"127.0.0.1", "for=192.0.2.7, for=_hidden, for=10.1.2.9", NULL, "10.1.2.9"},
        {"127.0.0.1", "for=192.0.2.7, proto=http", NULL, "127.0.0.1"},
        {"127.0.0.1", "", ",, ", "127.0.0.1"},
        {"127.0.0.1", NULL, NULL, "127.0.0.1"},
        /* not a trusted proxy */
        {"192.0.2.1", "for=198.51.100.1", NULL, "192.0.2.1"},
        {"127.0.0.2", "for=198.51.100.1", NULL, "127.0.0.2"},
        {"10.1.2.16", "for=198.51.100.1", NULL, "10.1.2.16"},
        {"2001:db8:ab::1", "for=198.51.100.1", NULL, "2001:db8:ab::1"},
        {"2001:db8:aa::1", "for=198.51.100.1", NULL, "198.51.100.1"},
        /* a malformed header is ignored */
        {"127.0.0.1", "for=\"unending", "for=192.0.2.7", "127.0.0.1"},
        {"127.0.0.1", "for=\"a\\", "for=192.0.2.7", "127.0.0.1"},
        {"127.0.0.1", "for", NULL, "127.0.0.1"},
        {"127.0.0.1", "for=", NULL, "127.0.0.1"},
        {"127.0.0.1", "=192.0.2.7", NULL, "127.0.0.1"},
        {"127.0.0.1", "for=192.0.2.7 for=192.0.2.8", NULL, "127.0.0.1"},
        {"127.0.0.1", "for=192.0.2.7;for=192.0.2.8", NULL, "127.0.0.1"},
        {"127.0.0.1", "for=192.0.2.7;", NULL, "127.0.0.1"},
        {"127.0.0.1", "for=192.0.2.7:80", NULL, "127.0.0.1"},
        {"127.0.0.1", "for=2001:db8::1", NULL, "127.0.0.1"},
        {"127.0.0.1", "for=\"2001:db8::1\"", NULL, "127.0.0.1"},
        {"127.0.0.1", "for=\"[192.0.2.7]\"", NULL, "127.0.0.1"},
        {"127.0.0.1", "for=\"192.0.2.7:123456\"", NULL, "127.0.0.1"},
        {"127.0.0.1", "for=\"192.0.2.7:\"", NULL, "127.0.0.1"},
        {"127.0.0.1", "for=192.0.2.256", NULL, "127.0.0.1"},
        {"127.0.0.1", "for=\"[2001:db8::1\"", NULL, "127.0.0.1"},
    };
    address_ranges trusted;
    assert_true(address_ranges_read(proxies, sizeof proxies / sizeof *proxies, &trusted, NULL));
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        const char *const values[] = {cases[i].first, cases[i].second};
        char text[ADDRESS_TEXT_SIZE];
        address peer;
        assert_true(address_parse(cases[i].peer, &peer));
        address client = forwarded_client(&peer, &trusted, values,
                                          cases[i].second  ? 2
                                          : cases[i].first ? 1
                                                           : 0);
        address_print(&client, text);
        if (strcmp(text, cases[i].client) != 0)
            fail_msg("%s of %s: %s, not %s", cases[i].first, cases[i].peer, text, cases[i].client);
    }
    address_ranges_clear(&trusted);
}

/* A header with too long words or too many proxies is ignored. */
static void test_long_values(void **state)
{
    (void)state;
    char word[1000] = "for=\"", row[1000];
    memset(word + 5, 'x', sizeof word - 6);
    word[sizeof word - 1] = row[sizeof row - 1] = '\0';
    for (size_t i = 0; i + 1 < sizeof row; i++) row[i] = "for=1.1.1.1,"[i % 12];
    const char *const values[] = {word, row};
    address_ranges trusted;
    address peer;
    assert_true(address_parse("127.0.0.1", &peer));
    assert_true(address_ranges_read(proxies, 1, &trusted, NULL));
    for (size_t i = 0; i < 2; i++) {
        address client = forwarded_client(&peer, &trusted, &values[i], 1);
        assert_memory_equal(&client, &peer, sizeof peer);
    }
    address_ranges_clear(&trusted);
}

static void test_ranges(void **state)
{
    (void)state;
    static const char *const bad[] = {"",
                                      "x",
                                      "10.0.0.0/33",
                                      "10.0.0.0/",
                                      "10.0.0.0/-1",
                                      "10.0.0.0/x",
                                      "10.0.0/8",
                                      "::/129",
                                      "[::1]",
                                      "10.0.0.1:80",
                                      "/8",
                                      "10.0.0.1 ",
                                      "localhost",
                                      "10.0.0.0/99999999999999999999"};
    error e;
    address_ranges r;
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        if (address_ranges_read(&bad[i], 1, &r, &e)) fail_msg("%s", bad[i]);
        assert_int_equal(e.code, ERROR_SPEC_INVALID);
        address_ranges_clear(&r);
    }
    static const char *const all[] = {"0.0.0.0/0"};
    address v4, v6;
    assert_true(address_parse("203.0.113.9", &v4) && address_parse("2001:db8::1", &v6));
    assert_true(address_ranges_read(all, 1, &r, &e));
    assert_true(address_ranges_hold(&r, &v4));
    assert_false(address_ranges_hold(&r, &v6));
    address_ranges_clear(&r);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_cases),
        cmocka_unit_test(test_long_values),
        cmocka_unit_test(test_ranges),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
