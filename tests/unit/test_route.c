// SPDX-License-Identifier: Apache-2.0
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <string.h>

#include "service/api/job_commands.h"
#include "service/api/jobs.h"
#include "service/api/result_files.h"
#include "service/api/routes.h"
#include "service/api/status.h"

static void test_parameters(void **state)
{
    (void)state;
    route_match m;
    route_find(&api_routes, "GET", "/v1/jobs/abc/results/points.ply", &m);
    assert_true(m.found->handler == result_files_send);
    assert_string_equal(m.parameter[0], "abc");
    assert_string_equal(m.parameter[1], "points.ply");
    route_find(&api_routes, "POST", "/v1/jobs/abc/cancel", &m);
    assert_true(m.found->handler == job_commands_cancel && !m.found->body && m.found->scope == SCOPE_CANCEL);
    assert_string_equal(m.parameter[0], "abc");
    assert_null(m.parameter[1]);
}

static void test_methods(void **state)
{
    (void)state;
    route_match m;
    route_find(&api_routes, "HEAD", "/healthz", &m);
    assert_true(m.found->handler == status_health);
    route_find(&api_routes, "POST", "/v1/jobs", &m);
    assert_true(m.found->handler == jobs_submit && m.found->body);
    route_find(&api_routes, "PATCH", "/v1/jobs", &m);
    assert_true(m.known && !m.found);
    assert_string_equal(m.allow, "POST, GET, HEAD");
}

static void test_unknown_paths(void **state)
{
    (void)state;
    static const char *const paths[] = {"",
                                        "*",
                                        "healthz",
                                        "/healthz/",
                                        "/healthzz",
                                        "/v1",
                                        "/v1/jobs/",
                                        "/v1//jobs",
                                        "/v1/jobs//results",
                                        "/v1/jobs/a/results/",
                                        "/v1/jobs/a/results/b/c",
                                        "/v1/jobs/{id}/other"};
    route_match m;
    for (size_t i = 0; i < sizeof paths / sizeof *paths; i++) {
        route_find(&api_routes, "GET", paths[i], &m);
        if (m.known) fail_msg("%s", paths[i]);
    }
    char deep[2 * ROUTE_PATH_BYTES];
    memset(deep, 'x', sizeof deep - 1);
    memcpy(deep, "/v1/jobs/", 9);
    deep[sizeof deep - 1] = '\0';
    route_find(&api_routes, "GET", deep, &m);
    assert_false(m.known);
}

static void each_row_says_where_its_handler_runs(void **state)
{
    (void)state;
    for (size_t i = 0; i < api_routes.count; i++) {
        const route *r = &api_routes.row[i];
        if (r->runs_in == ROUTE_UNDECLARED) fail_msg("%s", r->name);
        /* a keeper saves the way to a pool; a body, a sink and a provisional answer need one */
        bool needs_pool = r->kept || r->body || r->opener || r->awaiting || r->streams;
        if (needs_pool && r->runs_in == ROUTE_SERVING_THREAD) fail_msg("%s", r->name);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_parameters),
        cmocka_unit_test(test_methods),
        cmocka_unit_test(test_unknown_paths),
        cmocka_unit_test(each_row_says_where_its_handler_runs),
    };
    return cmocka_run_group_tests_name("route", tests, NULL, NULL);
}
