// SPDX-License-Identifier: Apache-2.0
/* ledger: limits of holders and of all, rates, and the form of refusals. */
#include <pthread.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

#include <cmocka.h>

#include "service/ledger/ledger.h"

/* Added to the monotonic clock. */
static int64_t passed_ms;

int64_t __wrap_clock_monotonic_ms(void);
int64_t __wrap_clock_monotonic_ms(void)
{
    return 1000000 + passed_ms;
}

static int set_up(void **state)
{
    *state = ledger_new();
    passed_ms = 0;
    return 0;
}

static int tear_down(void **state)
{
    ledger_free(*state);
    return 0;
}

static void test_a_resource_without_a_limit_is_counted(void **state)
{
    ledger *l = *state;
    assert_int_equal(ledger_take(l, LEDGER_CONNECTIONS, "ann", 1000), LEDGER_FITS);
    assert_int_equal(ledger_held(l, LEDGER_CONNECTIONS, "ann"), 1000);
    assert_int_equal(ledger_held(l, LEDGER_CLIENT_CONNECTIONS, "ann"), 0);
    ledger_give_back(l, LEDGER_CONNECTIONS, "ann", 1000);
    assert_int_equal(ledger_held(l, LEDGER_CONNECTIONS, "ann"), 0);
}

static void test_a_holder_at_its_limit_leaves_the_rest_to_others(void **state)
{
    ledger *l = *state;
    ledger_limit(l, LEDGER_CONNECTIONS, (ledger_limits){.holder = 2});
    assert_int_equal(ledger_take(l, LEDGER_CONNECTIONS, "ann", 2), LEDGER_FITS);
    assert_int_equal(ledger_check(l, LEDGER_CONNECTIONS, "ann", 1), LEDGER_HOLDER_FULL);
    assert_int_equal(ledger_take(l, LEDGER_CONNECTIONS, "ann", 1), LEDGER_HOLDER_FULL);
    assert_int_equal(ledger_take(l, LEDGER_CONNECTIONS, "bob", 1), LEDGER_FITS);
    ledger_give_back(l, LEDGER_CONNECTIONS, "ann", 1);
    assert_int_equal(ledger_take(l, LEDGER_CONNECTIONS, "ann", 1), LEDGER_FITS);
}

static void test_a_small_amount_fits_although_all_is_taken(void **state)
{
    ledger *l = *state;
    ledger_limit(l, LEDGER_BODIES, (ledger_limits){.holder = 100000, .all = 100000});
    assert_int_equal(ledger_take(l, LEDGER_BODIES, "ann", 100000), LEDGER_FITS);
    assert_int_equal(ledger_take(l, LEDGER_BODIES, "bob", 16385), LEDGER_ALL_FULL);
    assert_int_equal(ledger_take(l, LEDGER_BODIES, "bob", 16384), LEDGER_FITS);
    assert_int_equal(ledger_take(l, LEDGER_BODIES, "bob", 1), LEDGER_ALL_FULL);
}

static void test_a_rate_gives_back_as_time_passes(void **state)
{
    ledger *l = *state;
    ledger_limit(l, LEDGER_SUBMISSIONS, (ledger_limits){.holder = 3});
    for (int i = 0; i < 3; i++) assert_int_equal(ledger_take(l, LEDGER_SUBMISSIONS, "ann", 1), LEDGER_FITS);
    assert_int_equal(ledger_take(l, LEDGER_SUBMISSIONS, "ann", 1), LEDGER_HOLDER_FULL);
    ledger_refusal why = ledger_explain(l, LEDGER_SUBMISSIONS, LEDGER_HOLDER_FULL, "ann");
    assert_int_equal(why.retry_s, 1200);
    passed_ms += 1199999;
    assert_int_equal(ledger_take(l, LEDGER_SUBMISSIONS, "ann", 1), LEDGER_HOLDER_FULL);
    assert_int_equal(ledger_explain(l, LEDGER_SUBMISSIONS, LEDGER_HOLDER_FULL, "ann").retry_s, 1);
    passed_ms += 1;
    assert_int_equal(ledger_take(l, LEDGER_SUBMISSIONS, "ann", 1), LEDGER_FITS);
    assert_int_equal(ledger_held(l, LEDGER_SUBMISSIONS, "ann"), 3);
    passed_ms += INT64_C(1) << 50;
    assert_int_equal(ledger_held(l, LEDGER_SUBMISSIONS, "ann"), 0);
}

/* A reload of the settings between a refusal and its message. */
static void test_a_refusal_whose_limit_is_removed_meanwhile_has_a_message(void **state)
{
    ledger *l = *state;
    ledger_limit(l, LEDGER_SUBMISSIONS, (ledger_limits){.holder = 1});
    assert_int_equal(ledger_take(l, LEDGER_SUBMISSIONS, "ann", 1), LEDGER_FITS);
    assert_int_equal(ledger_take(l, LEDGER_SUBMISSIONS, "ann", 1), LEDGER_HOLDER_FULL);
    ledger_limit(l, LEDGER_SUBMISSIONS, (ledger_limits){0});
    const ledger_refusal why = ledger_explain(l, LEDGER_SUBMISSIONS, LEDGER_HOLDER_FULL, "ann");
    assert_int_equal(why.retry_s, 1);
    assert_non_null(strstr(why.message, "try again in 1 s"));
}

static void test_many_holders_are_told_apart_and_forgotten(void **state)
{
    enum { HOLDERS = 10000 };
    ledger *l = *state;
    char name[32];
    ledger_limit(l, LEDGER_SUBMISSIONS, (ledger_limits){.holder = 1});
    for (int round = 0; round < 2; round++) {
        for (int i = 0; i < HOLDERS; i++) {
            snprintf(name, sizeof name, "user%d", i);
            assert_int_equal(ledger_take(l, LEDGER_SUBMISSIONS, name, 1), LEDGER_FITS);
            assert_int_equal(ledger_take(l, LEDGER_SUBMISSIONS, name, 1), LEDGER_HOLDER_FULL);
        }
        passed_ms += 3600000;
    }
}

static void test_a_refusal_names_holder_limit_setting_and_remedy(void **state)
{
    ledger *l = *state;
    ledger_limit(l, LEDGER_CONNECTIONS, (ledger_limits){.holder = 512, .all = 2048});
    ledger_limit(l, LEDGER_SUBMISSIONS, (ledger_limits){.holder = 10});
    ledger_refusal why = ledger_explain(l, LEDGER_CONNECTIONS, LEDGER_HOLDER_FULL, "ann");
    assert_string_equal(why.code, "too_many_requests");
    assert_string_equal(
        why.message,
        "ann has reached the limit of connections (512, setting user_connection_limit): close some");
    why = ledger_explain(l, LEDGER_CONNECTIONS, LEDGER_ALL_FULL, "ann");
    assert_string_equal(why.code, "unavailable");
    assert_string_equal(why.message,
                        "all users together have reached the limit of connections (2048, setting "
                        "connection_limit): try again later");
    why = ledger_explain(l, LEDGER_RESULTS, LEDGER_HOLDER_FULL, "ann");
    assert_string_equal(
        why.message,
        "ann has reached the limit of results, none of which was fetched (setting user_results_mb or "
        "user_results_count): fetch results with hexadctl fetch, so that hexad may delete them");
    while (ledger_take(l, LEDGER_SUBMISSIONS, "ann", 1) == LEDGER_FITS) {
    }
    why = ledger_explain(l, LEDGER_SUBMISSIONS, LEDGER_HOLDER_FULL, "ann");
    assert_string_equal(why.message, "ann has reached the limit of submissions in an hour (10, setting "
                                     "user_submissions): try again in 360 s");
}

enum { THREADS = 4, ROUNDS = 20000, OF_HOLDER = 2 };

/* Takes and gives back with holders that other threads use as well. */
static void *use(void *argument)
{
    ledger *l = argument;
    char name[8];
    for (int i = 0; i < ROUNDS; i++) {
        snprintf(name, sizeof name, "u%d", i % 3);
        if (ledger_take(l, LEDGER_BODIES, name, 1) != LEDGER_FITS) continue;
        if (ledger_held(l, LEDGER_BODIES, name) > OF_HOLDER) return "over the limit";
        ledger_give_back(l, LEDGER_BODIES, name, 1);
    }
    return NULL;
}

static void test_threads_share_a_ledger(void **state)
{
    ledger *l = *state;
    pthread_t thread[THREADS];
    ledger_limit(l, LEDGER_BODIES, (ledger_limits){.holder = OF_HOLDER});
    for (int i = 0; i < THREADS; i++) assert_int_equal(pthread_create(&thread[i], NULL, use, l), 0);
    for (int i = 0; i < THREADS; i++) {
        void *fault;
        pthread_join(thread[i], &fault);
        assert_null(fault);
    }
    for (int i = 0; i < 3; i++)
        assert_int_equal(ledger_held(l, LEDGER_BODIES, (char[]){'u', (char)('0' + i), 0}), 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_a_resource_without_a_limit_is_counted, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_a_holder_at_its_limit_leaves_the_rest_to_others, set_up,
                                        tear_down),
        cmocka_unit_test_setup_teardown(test_a_small_amount_fits_although_all_is_taken, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_a_rate_gives_back_as_time_passes, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_a_refusal_whose_limit_is_removed_meanwhile_has_a_message, set_up,
                                        tear_down),
        cmocka_unit_test_setup_teardown(test_many_holders_are_told_apart_and_forgotten, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_a_refusal_names_holder_limit_setting_and_remedy, set_up,
                                        tear_down),
        cmocka_unit_test_setup_teardown(test_threads_share_a_ledger, set_up, tear_down),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
