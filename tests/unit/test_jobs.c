// SPDX-License-Identifier: Apache-2.0
/* Handlers with a queue that fails on request of the test. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "service/executor/local.h"
#include "base/core/log.h"
#include "base/core/memory.h"
#include "service/api/job_json.h"
#include "service/api/jobs.h"
#include "files/file.h"

static bool get_fails;

/* The linker replaces the functions of the queue by these (--wrap). */
bool __real_queue_get(queue *q, const char *id, queue_job *job, bool *found, error *e);
bool __wrap_queue_get(queue *q, const char *id, queue_job *job, bool *found, error *e);

bool __wrap_queue_get(queue *q, const char *id, queue_job *job, bool *found, error *e)
{
    if (get_fails) return error_set(e, ERROR_INTERNAL, "the disk cannot be read");
    return __real_queue_get(q, id, job, found, e);
}

typedef struct place {
    char base[64];
    queue *q;
    runner *tasks;
    executor *x;
    ledger *counts;
    pthread_mutex_t frame_checks;
    http_context context;
} place;

static int set_up(void **state)
{
    place *p = mem_alloc(sizeof *p);
    strcpy(p->base, "/tmp/hexad-jobs-XXXXXX");
    assert_non_null(mkdtemp(p->base));
    error e = {0};
    p->q = queue_open(p->base, &e);
    if (!p->q) fail_msg("%s", e.message);
    p->counts = ledger_new();
    executor_settings settings = {.engine = &engine_local,
                                  .counts = p->counts,
                                  .state_dir = p->base,
                                  .work_dir = p->base,
                                  .worker = "/nonexistent",
                                  .workers = 1,
                                  .memory_mb = 1024};
    p->tasks = runner_new();
    p->x = executor_open(&settings, p->q, p->tasks, &e);
    if (!p->x || !executor_start(p->x, &e)) fail_msg("%s", e.message);
    p->context = (http_context){.counts = p->counts,
                                .q = p->q,
                                .x = p->x,
                                .work_dir = p->base,
                                .max_attempts = 3,
                                .frame_checks = &p->frame_checks};
    pthread_mutex_init(&p->frame_checks, NULL);
    get_fails = false;
    *state = p;
    return 0;
}

static int tear_down(void **state)
{
    place *p = *state;
    executor_stop(p->x);
    executor_free(p->x);
    runner_free(p->tasks);
    queue_close(p->q);
    ledger_free(p->counts);
    assert_true(store_remove(p->base, NULL));
    free(p);
    return 0;
}

static const char body[] = "{\"version\":1,\"name\":\"ball\",\"surface\":{\"analytic\":{\"shape\":\"sphere\","
                           "\"center\":[0,0,0],\"radius\":1}},\"sampling\":{\"count\":9},"
                           "\"queue\":{\"priority\":4,\"labels\":[\"a\"]}}";

/* A stored job is reported as accepted, even if the database fails afterwards. */
static void test_an_accepted_job_is_answered_201(void **state)
{
    place *p = *state;
    const access_caller caller = {.user = "alice", .scopes = SCOPE_USER, .max_priority = TOKEN_ANY_PRIORITY};
    http_request request = {.body = body, .length = sizeof body - 1, .caller = &caller};
    reply r = {.fd = -1};
    get_fails = true;
    jobs_submit(&p->context, &request, &r);
    get_fails = false;
    if (r.status != 201) fail_msg("%d: %s", r.status, r.body);
    json *document = json_parse(r.body, r.length, NULL);
    json_at root = json_root(document);
    const char *id = json_string(json_member(&root, "id"), "");
    assert_string_equal(json_string(json_member(&root, "state"), ""), "queued");
    assert_string_equal(json_string(json_member(&root, "name"), ""), "ball");
    assert_string_equal(json_string(json_member(&root, "owner"), ""), "alice");
    assert_int_equal((int)json_number(json_member(&root, "priority"), 0), 4);
    assert_int_equal((int)json_number(json_member(&root, "max_attempts"), 0), 3);
    assert_int_equal(json_size(json_member(&root, "labels")), 1);
    assert_int_equal(json_size(json_member(&root, "attempts")), 0);
    json_at spec = json_member(&root, "spec");
    assert_int_equal((int)json_number(json_member(&spec, "version"), 0), 1);
    /* the time of arrival is that of the queue */
    http_request look = {.parameter = {id}, .caller = &caller};
    reply shown = {.fd = -1};
    jobs_show(&p->context, &look, &shown);
    assert_int_equal(shown.status, 200);
    json *stored = json_parse(shown.body, shown.length, NULL);
    json_at stored_root = json_root(stored);
    assert_string_equal(json_string(json_member(&root, "created"), ""),
                        json_string(json_member(&stored_root, "created"), "?"));
    json_free(stored);
    json_free(document);
    reply_clear(&shown);
    reply_clear(&r);
}

#define CASE(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)

static void test_a_tag_contains_the_revision_of_its_job(void **state)
{
    (void)state;
    const queue_job job = {.revision = 47};
    char progress[] = "{\"fraction\":0.5}", input[] = "a.obj";
    const job_json_live live[] = {{.ahead = -1},
                                  {.ahead = 0},
                                  {.ahead = 1},
                                  {.ahead = -1, .progress = progress},
                                  {.ahead = -1, .input = input, .input_is_label = true},
                                  {.ahead = -1, .input_is_label = true}};
    for (size_t k = 0; k < sizeof live / sizeof *live; k++) {
        char tag[JOB_JSON_TAG_SIZE], weak[JOB_JSON_TAG_SIZE + 2] = "W/";
        int64_t revision = 0;
        job_json_print_tag(&job, &live[k], tag);
        for (size_t other = 0; other < k; other++) {
            char earlier[JOB_JSON_TAG_SIZE];
            job_json_print_tag(&job, &live[other], earlier);
            assert_string_not_equal(tag, earlier);
        }
        assert_true(job_json_read_tag(tag, &revision));
        assert_int_equal(revision, 47);
        revision = 0;
        assert_true(job_json_read_tag(strcat(weak, tag), &revision));
        assert_int_equal(revision, 47);
    }
}

static void test_other_tags_are_refused(void **state)
{
    (void)state;
    static const char *const tags[] = {"",     "47",      "\"",          "\"\"",    "\"x\"",
                                       "\"47", "\"47\"8", "\"47.12ag\"", "\"-47\"", "W/47"};
    for (size_t k = 0; k < sizeof tags / sizeof *tags; k++) {
        int64_t revision;
        assert_false(job_json_read_tag(tags[k], &revision));
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_a_tag_contains_the_revision_of_its_job),
        cmocka_unit_test(test_other_tags_are_refused),
        CASE(test_an_accepted_job_is_answered_201),
    };
    log_set_level(LOG_LEVEL_ERROR); /* hides the expected warning about a worker that does not start */
    return cmocka_run_group_tests_name("jobs", tests, NULL, NULL);
}
