// SPDX-License-Identifier: Apache-2.0
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <stdlib.h>
#include <string.h>

#include "service/webhook/hosts.h"

static const char *const table[] = {"farm.example", "Hooks.example:8443", "[::1]:9000", "127.0.0.1:8080"};

static void test_listed_hosts_are_admitted(void **state)
{
    (void)state;
    static const char *const good[] = {
        "http://farm.example/x?y=1", "https://farm.example",         "https://FARM.example:443/",
        "http://farm.example:80",    "https://hooks.example:8443/a", "http://hooks.example:8443",
        "http://[::1]:9000/",        "http://127.0.0.1:8080/",       "HTTP://127.0.0.1:8080/%2e%2e"};
    webhook_hosts *hosts = webhook_hosts_read(table, 4, NULL);
    assert_non_null(hosts);
    for (size_t i = 0; i < sizeof good / sizeof *good; i++) {
        error e = {0};
        if (!webhook_hosts_admit(hosts, good[i], &e)) fail_msg("%s: %s", good[i], e.message);
    }
    webhook_hosts_free(hosts);
}

static void test_other_urls_are_refused(void **state)
{
    (void)state;
    static const char *const bad[] = {"http://farm.example:8080/",
                                      "https://farm.example:80/",
                                      "https://hooks.example/",
                                      "http://farm.example.evil/",
                                      "http://evil/farm.example",
                                      "http://evil/#@farm.example/",
                                      "http://evil\\@farm.example/",
                                      "http://farm.example@evil/",
                                      "http://user:word@farm.example/",
                                      "http://farm.example\r\nHost: evil/",
                                      "http://farm.example /",
                                      "ftp://farm.example/",
                                      "file:///etc/passwd",
                                      "gopher://127.0.0.1:8080/",
                                      "//farm.example/",
                                      "farm.example",
                                      "http://",
                                      ""};
    webhook_hosts *hosts = webhook_hosts_read(table, 4, NULL), *none = webhook_hosts_read(NULL, 0, NULL);
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        error e = {0};
        if (webhook_hosts_admit(hosts, bad[i], &e)) fail_msg("%s is admitted", bad[i]);
        assert_int_equal(e.code, ERROR_SPEC_INVALID);
    }
    error e = {0};
    assert_false(webhook_hosts_admit(none, "http://farm.example/", &e));
    assert_non_null(strstr(e.message, "webhook_hosts"));
    assert_false(webhook_hosts_admit(NULL, "http://farm.example/", NULL));
    webhook_hosts_free(none);
    webhook_hosts_free(hosts);
}

static void test_bad_entries_are_named(void **state)
{
    (void)state;
    static const char *const bad[] = {"",
                                      "http://farm.example",
                                      "farm.example/",
                                      "farm.example/x",
                                      "farm.example?x",
                                      "farm.example#x",
                                      "user@farm.example",
                                      "farm.example:99999",
                                      "a b"};
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        error e = {0};
        const char *const entries[] = {"good.example", bad[i]};
        if (webhook_hosts_read(entries, 2, &e)) fail_msg("%s is a host", bad[i]);
        assert_non_null(strstr(e.message, bad[i]));
    }
}

static bool is_of_host(const char *host, const char *address)
{
    return strncmp(address, host, strlen(host)) == 0;
}

static void test_addresses_of_one_host_have_the_same_beginning(void **state)
{
    (void)state;
    static const struct {
        const char *first, *second;
        bool same;
    } pairs[] = {
        {"http://farm", "http://Farm/x?y#z", true},      {"http://farm?x", "http://farm:80/", true},
        {"HTTPS://[::1]/", "https://[::1]:443/X", true}, {"http://farm", "http://farm2", false},
        {"http://farm", "http://farm.example/", false},  {"http://farm", "http://farm:81/", false},
        {"http://farm:80", "http://farm:8080/", false},  {"http://10.0.0.1", "http://10.0.0.10/x", false},
        {"http://farm:443", "https://farm/", false}};
    for (size_t i = 0; i < sizeof pairs / sizeof *pairs; i++) {
        char *first = webhook_address(pairs[i].first), *second = webhook_address(pairs[i].second);
        char *host = webhook_host_of(first), *other = webhook_host_of(second);
        assert_true(is_of_host(host, first));
        if (is_of_host(host, second) != pairs[i].same || is_of_host(other, first) != pairs[i].same)
            fail_msg("%s and %s", first, second);
        free(first);
        free(second);
        free(host);
        free(other);
    }
    char *address = webhook_address("http://Farm/A?B=c%2fD");
    assert_string_equal(address, "http://farm:80/A?B=c%2fD");
    free(address);
    assert_null(webhook_address("http://"));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_listed_hosts_are_admitted),
        cmocka_unit_test(test_other_urls_are_refused),
        cmocka_unit_test(test_bad_entries_are_named),
        cmocka_unit_test(test_addresses_of_one_host_have_the_same_beginning),
    };
    return cmocka_run_group_tests_name("webhook_hosts", tests, NULL, NULL);
}
