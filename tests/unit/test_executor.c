// SPDX-License-Identifier: Apache-2.0
/* The executor with shell scripts as faulty workers. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <dirent.h>
#include <errno.h>
#include <poll.h>
#include <sched.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mount.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include "set_clock.h"

#include "base/core/clock.h"
#include "base/core/log.h"
#include "base/core/memory.h"
#include "service/executor/executor.h"
#include "service/executor/host.h"
#include "service/executor/local.h"
#include "service/executor/settlement.h"
#include "service/executor/storage.h"
#include "service/results/result.h"
#include "files/file.h"

/* Time limit for a loaded machine; a passing test never waits for it. */
#define PATIENCE_MS 30000

/* The prologue of a worker: $D is the output directory. */
#define PROLOGUE "#!/bin/sh\nspec=$(cat)\nD=\"$4\"\n"
#define REPORT                                                                                     \
    "printf x > \"$D/points.ply\"\n"                                                               \
    "printf '%s' '{\"outcome\":\"converged\",\"count\":7,\"outputs\":[{\"name\":\"points.ply\","   \
    "\"bytes\":1,\"sha256\":\"2d711642b726b04401627ca9fbac32f5c8530fb1903cc4db02258717921a4881\"}" \
    "]}'"                                                                                          \
    " > \"$D/report.json\"\n"

typedef struct place {
    char base[64];
    char *worker;
    queue *q;
    ledger *counts;
    runner *tasks;
    executor *x;
} place;

static int set_up(void **state)
{
    place *p = mem_alloc(sizeof *p);
    strcpy(p->base, "/tmp/hexad-executor-XXXXXX");
    assert_non_null(mkdtemp(p->base));
    p->worker = mem_printf("%s/worker", p->base);
    error e = {0};
    p->q = queue_open(p->base, &e);
    if (!p->q) fail_msg("%s", e.message);
    p->counts = ledger_new();
    *state = p;
    return 0;
}

static void stop(place *p)
{
    if (!p->x) return;
    executor_stop(p->x);
    runner_stop(p->tasks);
    executor_free(p->x);
    runner_free(p->tasks);
    p->x = NULL;
}

static int tear_down(void **state)
{
    place *p = *state;
    stop(p);
    queue_close(p->q);
    ledger_free(p->counts);
    assert_true(store_remove(p->base, NULL));
    free(p->worker);
    free(p);
    return 0;
}

static const executor_settings usual = {.engine = &engine_local,
                                        .workers = 1,
                                        .threads = 8,
                                        .memory_mb = 1024,
                                        .grace_s = 0.2,
                                        .retry_s = 0.01,
                                        .retry_most_s = 0.02};

static void start_with(place *p, const char *script, executor_settings settings)
{
    assert_true(store_file_write(p->worker, script, strlen(script), NULL));
    assert_int_equal(chmod(p->worker, 0700), 0);
    settings.state_dir = settings.work_dir = p->base;
    settings.worker = p->worker;
    settings.counts = p->counts;
    error e = {0};
    p->tasks = runner_new();
    p->x = executor_open(&settings, p->q, p->tasks, &e);
    if (!p->x || !runner_start(p->tasks, &e) || !executor_start(p->x, &e)) fail_msg("%s", e.message);
}

static void start(place *p, const char *script, int workers)
{
    executor_settings settings = usual;
    settings.workers = workers;
    start_with(p, script, settings);
}

static void put_limited(place *p, int max_attempts, int64_t timeout_ms, int64_t stall_ms, const char *spec,
                        char id[ULID_SIZE])
{
    queue_submission s = {.name = "test",
                          .labels = "[]",
                          .spec = spec,
                          .max_attempts = max_attempts,
                          .timeout_ms = timeout_ms,
                          .stall_ms = stall_ms};
    queue_receipt receipt;
    error e = {0};
    if (!queue_put(p->q, &s, &receipt, &e)) fail_msg("%s", e.message);
    memcpy(id, receipt.id, sizeof receipt.id);
    if (p->x) executor_wake(p->x);
}

static void put(place *p, const char *spec, int max_attempts, char id[ULID_SIZE])
{
    put_limited(p, max_attempts, 0, 0, spec, id);
}

static queue_job get(place *p, const char *id)
{
    queue_job job = {0};
    bool found = false;
    assert_true(queue_get(p->q, id, &job, &found, NULL));
    assert_true(found);
    return job;
}

/* Waits between two checks of a condition that has no notification. */
static void look_again(int64_t since, const char *what)
{
    if (clock_monotonic_ms() - since > PATIENCE_MS) fail_msg("waited in vain for %s", what);
    poll(NULL, 0, 10);
}

static queue_job wait_final(place *p, const char *id)
{
    for (int64_t since = clock_monotonic_ms();; look_again(since, "the job's end")) {
        queue_job job = get(p, id);
        if (queue_state_is_final(job.state)) return job;
        queue_job_clear(&job);
    }
}

/* Waits for the file that the script writes when it has reached a certain point. */
static void wait_file(place *p, const char *name)
{
    char *path = mem_printf("%s/%s", p->base, name);
    for (int64_t since = clock_monotonic_ms(); access(path, F_OK) != 0;) look_again(since, path);
    free(path);
}

static void expect_end(place *p, const char *id, queue_state state, const char *code, const char *words)
{
    queue_job job = wait_final(p, id);
    if (job.state != state) fail_msg("%s: %s", queue_state_name(job.state), job.error_message);
    if (code) assert_string_equal(job.error_code, code);
    if (words && !strstr(job.error_message, words)) fail_msg("%s", job.error_message);
    queue_job_clear(&job);
}

static size_t count_attempts(place *p, const char *id)
{
    queue_attempt *attempts;
    size_t count;
    assert_true(queue_list_attempts(p->q, id, -1, 0, 100, &attempts, &count, NULL));
    queue_attempts_free(attempts, count);
    return count;
}

static void test_success_is_delivered(void **state)
{
    place *p = *state;
    char id[ULID_SIZE];
    start(p, PROLOGUE "echo noise >&2\necho \"$spec\" > \"$D/spec\"\n" REPORT, 1);
    put(p, "{\"version\":1}", 3, id);
    expect_end(p, id, QUEUE_SUCCEEDED, NULL, NULL);
    queue_job job = get(p, id);
    assert_int_equal(job.outcome, QUEUE_CONVERGED);
    assert_null(job.error_code);
    queue_job_clear(&job);
    char *results = result_directory(p->base, id, QUEUE_NO_FRAME);
    result r = {0};
    error e = {0};
    if (!result_read(results, &r, &e)) fail_msg("%s", e.message);
    assert_int_equal(r.count, 7);
    assert_int_equal(r.output_count, 1);
    result_clear(&r);
    int64_t bytes;
    int fd = result_open_file(results, "spec", &bytes, &e);
    assert_int_equal(bytes, 14); /* standard input had the whole spec */
    close(fd);
    fd = result_open_file(results, "worker.log", &bytes, &e);
    assert_int_equal(bytes, 6);
    close(fd);
    free(results);
}

/* /proc is a disk without blocks, and has no subdirectories of the service. */
static void test_free_space_is_that_of_the_state_directory_too(void **state)
{
    place *p = *state;
    const storage s = {.state_dir = p->base, .work_dir = "/proc"};
    struct statvfs disk;
    int64_t size = 0;
    const char *directory = NULL;
    assert_int_equal(statvfs(p->base, &disk), 0);
    const int64_t free_bytes = storage_free_bytes(&s, &size, &directory);
    assert_string_equal(directory, p->base);
    assert_int_equal(size, disk.f_blocks * disk.f_frsize);
    assert_true(free_bytes > 0 && free_bytes < size);
}

/* The worker has ended, but the disk is faulty: the result cannot be moved to results/. The job waits, and
 * succeeds once the move is possible. */
static void test_a_result_waits_for_the_disk(void **state)
{
    place *p = *state;
    char id[ULID_SIZE];
    start(p,
          PROLOGUE "mv \"$D/../../results\" \"$D/../../away\"\n: > \"$D/../../results\"\n"
                   "echo $$ > \"$D/../../pid\"\n" REPORT,
          1);
    put(p, "{\"version\":1}", 1, id);
    wait_file(p, "pid");
    char *results = mem_printf("%s/results", p->base), *away = mem_printf("%s/away", p->base);
    char *pid_file = mem_printf("%s/pid", p->base), *text = NULL;
    size_t length;
    for (int64_t since = clock_monotonic_ms(); !text || length < 2; look_again(since, "the worker's id")) {
        free(text);
        text = store_file_read(pid_file, 100, &length, NULL);
    }
    pid_t worker = (pid_t)atoi(text);
    for (int64_t since = clock_monotonic_ms(); kill(worker, 0) == 0;) look_again(since, "the worker's end");
    queue_job job = get(p, id);
    if (queue_state_is_final(job.state)) fail_msg("%s: %s", queue_state_name(job.state), job.error_message);
    queue_job_clear(&job);
    assert_int_equal(unlink(results), 0);
    assert_int_equal(rename(away, results), 0);
    expect_end(p, id, QUEUE_SUCCEEDED, NULL, NULL);
    assert_int_equal(count_attempts(p, id), 1);
    free(results);
    free(away);
    free(pid_file);
    free(text);
}

static void test_a_crash_is_tried_again(void **state)
{
    place *p = *state;
    char id[ULID_SIZE];
    start(p, PROLOGUE "case $D in *.1) kill -SEGV $$;; esac\n" REPORT, 1);
    put(p, "{}", 3, id);
    expect_end(p, id, QUEUE_SUCCEEDED, NULL, NULL);
    queue_attempt *attempts;
    size_t count;
    assert_true(queue_list_attempts(p->q, id, -1, 0, 100, &attempts, &count, NULL));
    assert_int_equal(count, 2);
    assert_int_equal(attempts[0].signal, SIGSEGV);
    assert_int_equal(attempts[1].exit_status, 0);
    assert_true(attempts[1].peak_memory_bytes > 0);
    char host[256];
    host_name(host, sizeof host);
    assert_string_equal(attempts[1].host, host);
    queue_attempts_free(attempts, count);
}

static void test_crashes_end_with_the_reason(void **state)
{
    place *p = *state;
    char id[ULID_SIZE];
    start(p, PROLOGUE "kill -KILL $$\n", 1);
    put(p, "{}", 2, id);
    expect_end(p, id, QUEUE_FAILED, "internal", "SIGKILL) in attempt 2 of 2");
    assert_int_equal(count_attempts(p, id), 2);
}

static void test_errors_come_from_the_last_line(void **state)
{
    place *p = *state;
    char id[ULID_SIZE];
    start(p,
          PROLOGUE "echo first >&2\n"
                   "echo '{\"code\":\"input_damaged\",\"message\":\"a.vdb ends early\"}' >&2\nexit 3\n",
          1);
    put(p, "{}", 3, id);
    expect_end(p, id, QUEUE_FAILED, "input_damaged", "a.vdb ends early");
    assert_int_equal(count_attempts(p, id), 1); /* a bad file is not retried */
}

static void test_garbage_does_no_harm(void **state)
{
    place *p = *state;
    char id[ULID_SIZE];
    start(p,
          PROLOGUE "head -c 300000 /dev/zero | tr '\\0' x >&3; echo >&3; echo '[1]' >&3; echo '{\"a' >&3\n"
                   "head -c 300000 /dev/zero >&2; echo 'not JSON' >&2\nexit 9\n",
          1);
    put(p, "{}", 3, id);
    expect_end(p, id, QUEUE_FAILED, "internal", "exit status 9");
    queue_job job = get(p, id);
    assert_non_null(strstr(job.error_message, "not JSON"));
    queue_job_clear(&job);
    char *directory = result_attempt_directory(p->base, id, QUEUE_NO_FRAME, 1);
    int64_t bytes;
    int fd = result_open_file(directory, "worker.log", &bytes, NULL);
    assert_true(fd >= 0);
    assert_int_equal(bytes, 64 * 1024);
    close(fd);
    free(directory);
}

static void test_success_without_a_report_is_an_error(void **state)
{
    place *p = *state;
    char id[ULID_SIZE];
    start(p, PROLOGUE "exit 0\n", 1);
    put(p, "{}", 1, id);
    expect_end(p, id, QUEUE_FAILED, "internal", "no valid result");
    char *results = result_directory(p->base, id, QUEUE_NO_FRAME);
    assert_int_equal(access(results, F_OK), -1);
    free(results);
}

static void test_a_short_output_is_no_result(void **state)
{
    place *p = *state;
    char id[ULID_SIZE];
    start(p, PROLOGUE REPORT ": > \"$D/points.ply\"\n", 1);
    put(p, "{}", 1, id);
    expect_end(p, id, QUEUE_FAILED, "internal", "points.ply has 0 bytes");
}

static bool read_report(const place *p, const char *name, const char *bytes, const char *hash, error *e)
{
    result r = {0};
    char *text = mem_printf("{\"outcome\":\"converged\",\"count\":7,\"outputs\":[{\"name\":\"%s\","
                            "\"bytes\":%s,\"sha256\":\"%s\"}]}",
                            name, bytes, hash);
    char *report = mem_printf("%s/report.json", p->base), *points = mem_printf("%s/points.ply", p->base);
    assert_true(store_file_write(report, text, strlen(text), e) && store_file_write(points, "x", 1, e));
    const bool ok = result_read(p->base, &r, e);
    result_clear(&r);
    free(text);
    free(report);
    free(points);
    return ok;
}

static void test_an_output_that_is_not_described_is_no_result(void **state)
{
#define HASH_63 "2d711642b726b04401627ca9fbac32f5c8530fb1903cc4db02258717921a488"
    const place *p = *state;
    static const char *const bad[][3] = {
        {"points.ply", "1", ""},
        {"points.ply", "1", HASH_63},
        {"points.ply", "1", HASH_63 "11"},
        {"points.ply", "1", HASH_63 "g"},
        {"points.ply", "1.5", HASH_63 "1"},
        {"points.ply", "-1", HASH_63 "1"},
        {"../points.ply", "1", HASH_63 "1"},
        {"", "1", HASH_63 "1"},
    };
    error e = {0};
    if (!read_report(p, "points.ply", "1", HASH_63 "1", &e)) fail_msg("%s", e.message);
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        assert_false(read_report(p, bad[i][0], bad[i][1], bad[i][2], &e));
        assert_int_equal(e.code, ERROR_INPUT_DAMAGED);
    }
}

/* If a worker cannot be started, the job waits, and the attempts do not count. */
static void test_a_missing_worker_costs_no_attempt(void **state)
{
    place *p = *state;
    char id[ULID_SIZE];
    start(p, "#!/nonexistent/interpreter\n", 1);
    put(p, "{}", 1, id);
    for (int64_t since = clock_monotonic_ms();; look_again(since, "the first try")) {
        queue_job job = get(p, id);
        bool tried = job.attempts > 0 && job.state == QUEUE_QUEUED;
        queue_job_clear(&job);
        if (tried) break;
    }
    const char script[] = PROLOGUE REPORT;
    assert_true(store_file_write(p->worker, script, sizeof script - 1, NULL));
    assert_int_equal(chmod(p->worker, 0700), 0);
    expect_end(p, id, QUEUE_SUCCEEDED, NULL, NULL);
    queue_attempt *attempts;
    size_t count;
    assert_true(queue_list_attempts(p->q, id, -1, 0, 100, &attempts, &count, NULL));
    assert_true(count >= 2);
    assert_non_null(strstr(attempts[0].reason, "not started"));
    queue_attempts_free(attempts, count);
}

static void test_progress_is_seen(void **state)
{
    place *p = *state;
    char id[ULID_SIZE];
    start(p,
          PROLOGUE "echo '{\"phase\":\"relax\",\"fraction\":0.5}' >&3\n"
                   "while ! [ -e \"$D/../../go\" ]; do sleep 0.01; done\n" REPORT,
          1);
    put(p, "{}", 1, id);
    char *progress = NULL;
    for (int64_t since = clock_monotonic_ms(); !(progress = executor_progress(p->x, id));)
        look_again(since, "progress");
    assert_string_equal(progress, "{\"phase\":\"relax\",\"fraction\":0.5}");
    free(progress);
    char *go = mem_printf("%s/go", p->base);
    assert_true(store_file_write(go, "", 0, NULL));
    free(go);
    expect_end(p, id, QUEUE_SUCCEEDED, NULL, NULL);
}

/* Ignores SIGTERM. Its child must not outlive it. */
#define DEAF PROLOGUE "trap '' TERM\nsleep 600 &\necho $! > \"$D/../../child\"\nwait\nwait\n"

static void expect_child_gone(place *p)
{
    char *path = mem_printf("%s/child", p->base);
    size_t length;
    char *text = store_file_read(path, 100, &length, NULL);
    assert_non_null(text);
    pid_t child = atoi(text);
    assert_true(child > 1);
    for (int64_t since = clock_monotonic_ms(); kill(child, 0) == 0;) {
        /* a zombie counts as ended */
        char *proc = mem_printf("/proc/%d/stat", (int)child);
        char *stat = store_file_read(proc, 4096, &length, NULL);
        bool zombie = !stat || strstr(stat, ") Z");
        free(stat);
        free(proc);
        if (zombie) break;
        look_again(since, "the worker's child to go");
    }
    free(text);
    free(path);
}

static void test_a_timeout_kills(void **state)
{
    place *p = *state;
    char id[ULID_SIZE];
    start(p, DEAF, 1);
    put_limited(p, 3, 300, 0, "{}", id);
    expect_end(p, id, QUEUE_TIMED_OUT, "limit_time", "0.3 s");
    assert_int_equal(count_attempts(p, id), 1);
    expect_child_gone(p);
}

/* Each attempt ends within the time limit; all attempts together exceed it. */
static void test_a_timeout_is_of_all_attempts(void **state)
{
    place *p = *state;
    char id[ULID_SIZE];
    start(p, PROLOGUE "sleep 0.4\nkill -9 $$\n", 1);
    put_limited(p, 9, 1000, 0, "{}", id);
    expect_end(p, id, QUEUE_TIMED_OUT, "limit_time", "1 s");
}

static void test_a_stall_is_noticed(void **state)
{
    place *p = *state;
    char id[ULID_SIZE];
    start(p, PROLOGUE "sleep 600\n", 1);
    put_limited(p, 2, 0, 200, "{}", id);
    expect_end(p, id, QUEUE_FAILED, "stalled", "0.2 s (limits.stall_s) in attempt 2 of 2");
    assert_int_equal(count_attempts(p, id), 2);
}

static void test_a_stall_is_tried_again(void **state)
{
    place *p = *state;
    char id[ULID_SIZE];
    start(p, PROLOGUE "case $D in *.1) sleep 600;; esac\n" REPORT, 1);
    put_limited(p, 2, 0, 200, "{}", id);
    expect_end(p, id, QUEUE_SUCCEEDED, NULL, NULL);
    assert_int_equal(count_attempts(p, id), 2);
}

static void test_cancel_of_a_worker_that_ignores_sigterm(void **state)
{
    place *p = *state;
    char id[ULID_SIZE];
    start(p, DEAF, 1);
    put(p, "{}", 3, id);
    wait_file(p, "child");
    bool found, changed;
    queue_state now;
    assert_true(executor_apply_command(p->x, id, QUEUE_CANCEL, &found, &changed, &now, NULL));
    assert_true(found && changed && now == QUEUE_CANCELLING);
    expect_end(p, id, QUEUE_CANCELLED, "cancelled", NULL);
    expect_child_gone(p);
}

static void wait_drained(place *p)
{
    struct pollfd drained = {.fd = executor_drained_fd(p->x), .events = POLLIN};
    assert_int_equal(poll(&drained, 1, PATIENCE_MS), 1);
}

static void test_drain_puts_back_uncounted(void **state)
{
    place *p = *state;
    char running[ULID_SIZE], waiting[ULID_SIZE];
    start(p, DEAF, 1);
    put(p, "{}", 1, running);
    wait_file(p, "child");
    put(p, "{}", 1, waiting);
    executor_drain(p->x, 0.1);
    assert_true(executor_is_draining(p->x));
    wait_drained(p);
    queue_job job = get(p, running);
    assert_int_equal(job.state, QUEUE_QUEUED);
    assert_int_equal(job.attempts, 1);
    queue_job_clear(&job);
    queue_task *task;
    size_t count;
    assert_true(queue_list_tasks(p->q, running, -1, 9, &task, &count, NULL));
    assert_int_equal(count, 1);
    assert_int_equal(task->spent, 0);
    queue_tasks_free(task, count);
    assert_int_equal(count_attempts(p, waiting), 0);
    expect_child_gone(p);
}

/* A worker that runs at the same time as two others leaves a file. */
#define CROWD                                                     \
    PROLOGUE "R=\"$D/../../r\"; mkdir -p \"$R\"; : > \"$R/$$\"\n" \
             "[ $(ls \"$R\" | wc -l) -gt 2 ] && : > \"$R/../crowd\"\nsleep 0.02\nrm \"$R/$$\"\n" REPORT

static void expect_no_crowd(place *p, int workers, int threads, int64_t memory_mb)
{
    char id[4][ULID_SIZE];
    executor_settings settings = usual;
    settings.workers = workers;
    settings.threads = threads;
    settings.host_memory_mb = memory_mb;
    start_with(p, CROWD, settings);
    for (int i = 0; i < 4; i++) {
        queue_submission s = {.name = "one of four", .labels = "[]", .spec = "{}", .max_attempts = 1};
        queue_receipt receipt;
        s.threads = 2;
        assert_true(executor_size(p->x, &s.threads, &s.memory_mb, NULL));
        assert_true(queue_put(p->q, &s, &receipt, NULL));
        memcpy(id[i], receipt.id, sizeof receipt.id);
    }
    executor_wake(p->x);
    for (int i = 0; i < 4; i++) expect_end(p, id[i], QUEUE_SUCCEEDED, NULL, NULL);
    char *crowd = mem_printf("%s/crowd", p->base);
    assert_int_equal(access(crowd, F_OK), -1);
    free(crowd);
}

static void test_workers_bound_what_runs(void **state)
{
    expect_no_crowd(*state, 2, 64, 65536);
}

static void test_threads_bound_what_runs(void **state)
{
    expect_no_crowd(*state, 6, 5, 65536);
}

static void test_memory_bounds_what_runs(void **state)
{
    expect_no_crowd(*state, 6, 64, 3000);
}

/* Both jobs were accepted when the host was larger. */
static void test_jobs_from_a_larger_host_run_or_fail(void **state)
{
    place *p = *state;
    queue_submission s = {.labels = "[]", .spec = "{}", .max_attempts = 3, .threads = 1, .memory_mb = 2049};
    queue_receipt large, wide;
    assert_true(queue_put(p->q, &s, &large, NULL));
    s.threads = 99;
    s.memory_mb = 100;
    assert_true(queue_put(p->q, &s, &wide, NULL));
    executor_settings settings = usual;
    settings.host_memory_mb = 2048;
    start_with(p, PROLOGUE "echo \"$@\" > \"$D/words\"\n" REPORT, settings);
    expect_end(p, large.id, QUEUE_FAILED, "limit_memory", "2049 MiB");
    expect_end(p, wide.id, QUEUE_SUCCEEDED, NULL, NULL);
    char *results = result_directory(p->base, wide.id, QUEUE_NO_FRAME),
         *path = mem_printf("%s/words", results);
    size_t length;
    char *words = store_file_read(path, 4096, &length, NULL);
    assert_non_null(strstr(words, "--threads 8"));
    assert_non_null(strstr(words, "--memory-mb 100"));
    free(words);
    free(path);
    free(results);
    int threads = 0;
    int64_t memory_mb = 0;
    error e = {0};
    assert_true(executor_size(p->x, &threads, &memory_mb, &e));
    assert_int_equal(threads, 8); /* all threads, for the only worker */
    assert_int_equal(memory_mb, 1024);
    memory_mb = 2049;
    assert_false(executor_size(p->x, &threads, &memory_mb, &e));
    assert_int_equal(e.code, ERROR_LIMIT_MEMORY);
}

/* A worker that the kernel killed at its limit would need the same memory again. A worker that another
 * process killed may succeed. */
static void test_a_worker_out_of_memory_is_not_tried_again(void **state)
{
    (void)state;
    queue_claimed claimed = {.job = {.memory_mb = 77, .max_attempts = 3}, .task = {.spent = 1}};
    engine_ending ending = {.exit_status = -1, .signal = SIGKILL, .out_of_memory = true};
    settlement s;
    settlement_decide(&claimed, SETTLEMENT_NOT_STOPPED, 0, &ending, "/", &s);
    assert_int_equal(s.decision, SETTLEMENT_END);
    assert_int_equal(s.state, QUEUE_FAILED);
    assert_int_equal(s.code, ERROR_LIMIT_MEMORY);
    assert_non_null(strstr(s.message, "77 MiB"));
    assert_string_equal(s.reason, "out of memory: signal 9");
    ending.out_of_memory = false;
    settlement_decide(&claimed, SETTLEMENT_NOT_STOPPED, 0, &ending, "/", &s);
    assert_int_equal(s.decision, SETTLEMENT_RETRY_CRASHED);
    ending.out_of_memory = true;
    settlement_decide(&claimed, SETTLEMENT_CANCELLED, 0, &ending, "/", &s);
    assert_int_equal(s.state, QUEUE_CANCELLED);
}

/* The message about a signal from a fault of the program asks for a report. For a signal of another process
 * it refers to the logs. */
static void test_a_crash_in_the_last_attempt_says_what_to_do(void **state)
{
    (void)state;
    queue_claimed claimed = {.job = {.memory_mb = 77, .max_attempts = 3}, .task = {.spent = 3}};
    engine_ending ending = {.exit_status = -1, .signal = SIGSEGV};
    settlement s;
    settlement_decide(&claimed, SETTLEMENT_NOT_STOPPED, 0, &ending, "/", &s);
    assert_string_equal(
        s.message,
        "the worker was killed by signal 11 (SIGSEGV: it crashed or aborted) in attempt 3 of 3, a fault of "
        "hexad: report it with the spec and the log");
    ending.signal = SIGTRAP; /* an abort in the sandbox, on ARM */
    settlement_decide(&claimed, SETTLEMENT_NOT_STOPPED, 0, &ending, "/", &s);
    assert_non_null(strstr(s.message, "a fault of hexad"));
    ending.signal = SIGKILL;
    settlement_decide(&claimed, SETTLEMENT_NOT_STOPPED, 0, &ending, "/", &s);
    assert_non_null(strstr(s.message, "look for the cause in the logs of the job and of the machine"));
    settlement_decide(&claimed, SETTLEMENT_STALLED, 600, &ending, "/", &s);
    assert_non_null(
        strstr(s.message, "no progress for 600 s (limits.stall_s) in attempt 3 of 3: raise limits.stall_s"));
}

static void test_a_crashed_job_does_not_block_others(void **state)
{
    place *p = *state;
    char id[ULID_SIZE], other[ULID_SIZE];
    executor_settings settings = usual;
    settings.retry_s = 1000;
    settings.retry_most_s = 3000;
    start_with(p, PROLOGUE "case $spec in *crash*) kill -KILL $$;; esac\n" REPORT, settings);
    put(p, "{\"crash\":1}", 9, id);
    for (int64_t since = clock_monotonic_ms();; look_again(since, "the crash")) {
        queue_job job = get(p, id);
        bool crashed = job.attempts == 1 && job.state == QUEUE_QUEUED;
        queue_job_clear(&job);
        if (crashed) break;
    }
    put(p, "{}", 1, other);
    expect_end(p, other, QUEUE_SUCCEEDED, NULL, NULL);
    queue_task *task;
    size_t count;
    assert_true(queue_list_tasks(p->q, id, -1, 1, &task, &count, NULL));
    int64_t wait = task->not_before_ms - clock_wall_ms();
    assert_true(wait > (1000 - 60) * 1000 && wait <= 1000 * 1000);
    assert_int_equal(task->attempt, 1);
    queue_tasks_free(task, count);
}

/* Waits of 1, 2, 4 ... seconds, up to the limit. */
static void test_waits_double(void **state)
{
    place *p = *state;
    char id[ULID_SIZE];
    static const int64_t expected_s[] = {1000, 2000, 4000, 5000, 5000};
    meter counts = {.cache_hits = 0};
    const settlement_place where = {
        .q = p->q, .work_dir = p->base, .backoff = {1000, 5000}, .meter = &counts};
    const queue_resources resources = {.threads = 1, .all_threads = 1, .memory_mb = 9, .all_memory_mb = 9};
    put(p, "{}", 99, id);
    for (int i = 0; i < 5; i++) {
        queue_claimed claimed = {0};
        bool found = false, changed;
        queue_state now;
        if (i > 0) { /* not due yet: a cancellation and a retry reset the wait and the count */
            assert_true(queue_claim(p->q, &resources, &claimed, &found, NULL));
            assert_false(found);
            assert_true(queue_apply_command(p->q, id, QUEUE_CANCEL, &found, &changed, &now, NULL));
            assert_true(queue_apply_command(p->q, id, QUEUE_RETRY, &found, &changed, &now, NULL));
        }
        assert_true(queue_claim(p->q, &resources, &claimed, &found, NULL));
        assert_true(found);
        claimed.task.spent = i + 1;
        settlement s = {.decision = SETTLEMENT_RETRY_CRASHED};
        int64_t before = clock_wall_ms();
        assert_true(settlement_apply(&where, &claimed, &s, NULL, NULL));
        queue_task *task;
        size_t count;
        assert_true(queue_list_tasks(p->q, id, -1, 1, &task, &count, NULL));
        assert_true(task->not_before_ms >= before + expected_s[i] * 1000);
        assert_true(task->not_before_ms <= clock_wall_ms() + expected_s[i] * 1000);
        queue_tasks_free(task, count);
        queue_claimed_clear(&claimed);
    }
}

/* A wait of 20 ms ends soon, although the wall clock is set back by an hour while the daemon runs and before
 * it starts. */
static void test_a_clock_that_is_set_back_delays_no_retry(void **state)
{
    place *p = *state;
    char id[ULID_SIZE];
    meter counts = {.cache_hits = 0};
    const settlement_place where = {
        .q = p->q, .work_dir = p->base, .backoff = {0.02, 0.02}, .meter = &counts};
    for (int running = 1; running >= 0; running--) {
        if (running) start(p, PROLOGUE REPORT, 1);
        assert_true(queue_hold(p->q, true, NULL));
        put(p, "{}", 9, id);
        queue_claimed claimed = {0};
        bool found;
        assert_true(queue_claim_job(p->q, id, &claimed, &found, NULL));
        settlement s = {.decision = SETTLEMENT_RETRY_CRASHED};
        assert_true(settlement_apply(&where, &claimed, &s, NULL, NULL));
        queue_claimed_clear(&claimed);
        step_wall(-3600000);
        assert_true(queue_hold(p->q, false, NULL));
        if (running)
            executor_wake(p->x);
        else
            start(p, PROLOGUE REPORT, 1);
        expect_end(p, id, QUEUE_SUCCEEDED, NULL, NULL);
        stop(p);
    }
}

/* Claims a job like a daemon that then crashes. */
static void claim_and_die(place *p, const char *id)
{
    queue_claimed claimed = {0};
    bool found;
    assert_true(queue_claim_job(p->q, id, &claimed, &found, NULL));
    assert_true(found);
    queue_claimed_clear(&claimed);
}

static void put_file(const char *directory, const char *name, const char *text)
{
    char *path = mem_printf("%s/%s", directory, name);
    assert_true(store_directory_create(directory, NULL));
    assert_true(store_file_write(path, text, strlen(text), NULL));
    free(path);
}

static void test_recovery(void **state)
{
    place *p = *state;
    char done[ULID_SIZE], lost[ULID_SIZE], worn[ULID_SIZE], cancelled[ULID_SIZE];
    bool found, changed;
    queue_state now;
    put(p, "{}", 3, done);
    claim_and_die(p, done);
    char *results = result_directory(p->base, done, QUEUE_NO_FRAME);
    put_file(results, "report.json", "{\"outcome\":\"not_converged\",\"count\":1,\"outputs\":[]}");
    put(p, "{}", 3, lost);
    claim_and_die(p, lost);
    char *orphan = result_attempt_directory(p->base, lost, QUEUE_NO_FRAME, 1);
    put_file(orphan, "points.ply", "half");
    put(p, "{}", 1, worn);
    claim_and_die(p, worn);
    put(p, "{}", 3, cancelled);
    claim_and_die(p, cancelled);
    assert_true(queue_apply_command(p->q, cancelled, QUEUE_CANCEL, &found, &changed, &now, NULL));
    start(p, PROLOGUE REPORT, 1);
    expect_end(p, done, QUEUE_SUCCEEDED, NULL, NULL);
    queue_job job = get(p, done);
    assert_int_equal(job.outcome, QUEUE_NOT_CONVERGED);
    queue_job_clear(&job);
    expect_end(p, lost, QUEUE_SUCCEEDED, NULL, NULL);
    assert_int_equal(count_attempts(p, lost), 2);
    assert_int_equal(access(orphan, F_OK), -1);
    expect_end(p, worn, QUEUE_SUCCEEDED, NULL, NULL); /* its only attempt did not count */
    assert_int_equal(count_attempts(p, worn), 2);
    expect_end(p, cancelled, QUEUE_CANCELLED, "cancelled", NULL);
    free(results);
    free(orphan);
}

static settlement_place make_place(place *p, int max_interruptions)
{
    char *results = mem_printf("%s/results", p->base), *attempts = mem_printf("%s/attempts", p->base);
    assert_true(store_directory_create(results, NULL) && store_directory_create(attempts, NULL));
    free(results);
    free(attempts);
    static meter counts;
    return (settlement_place){.q = p->q,
                              .work_dir = p->base,
                              .host = "here",
                              .meter = &counts,
                              .max_interruptions = max_interruptions};
}

static void recover(const settlement_place *where, bool restarted)
{
    error e = {0};
    if (!settlement_recover(where, restarted, NULL, NULL, &e)) fail_msg("%s", e.message);
}

static queue_task only_task(place *p, const char *id)
{
    queue_task *tasks = NULL;
    size_t count = 0;
    assert_true(queue_list_tasks(p->q, id, -1, 2, &tasks, &count, NULL));
    assert_int_equal(count, 1);
    queue_task task = tasks[0];
    task.error_code = task.error_message = NULL;
    queue_tasks_free(tasks, count);
    return task;
}

/* The result has the report of another job, and there is no space for its own one. */
static void test_a_full_disk_at_the_start_loses_no_result(void **state)
{
    place *p = *state;
    const settlement_place where = make_place(p, 2);
    char id[ULID_SIZE];
    error e = {0};
    put(p, "{}", 3, id);
    claim_and_die(p, id);
    char *results = result_directory(p->base, id, QUEUE_NO_FRAME), *filler = mem_printf("%s/filler", results);
    assert_true(store_directory_create(results, NULL));
    if (unshare(CLONE_NEWNS) != 0 || mount(NULL, "/", NULL, MS_REC | MS_PRIVATE, NULL) != 0 ||
        mount("none", results, "tmpfs", 0, "size=64k") != 0) {
        free(results);
        free(filler);
        skip(); /* only root can mount */
    }
    put_file(results, "report.json",
             "{\"spec\":{\"name\":\"other\"},\"outcome\":\"not_converged\",\"count\":1,\"outputs\":[]}");
    FILE *rest = fopen(filler, "w");
    while (fputs("rest of the disk\n", rest) >= 0 && fflush(rest) == 0) continue;
    fclose(rest);
    const bool full = settlement_recover(&where, false, NULL, NULL, &e);
    const queue_task before = only_task(p, id);
    unlink(filler);
    const bool free_again = settlement_recover(&where, false, NULL, NULL, NULL);
    assert_int_equal(umount(results), 0);
    free(results);
    free(filler);
    assert_true(!full && free_again);
    assert_int_equal(e.code, ERROR_STORAGE_FULL);
    assert_int_equal(before.state, QUEUE_RUNNING);
    expect_end(p, id, QUEUE_SUCCEEDED, NULL, NULL);
}

/* Interruptions are counted separately from failures of the job. A retry resets both counts. */
static void test_interruptions_have_a_bound(void **state)
{
    place *p = *state;
    const settlement_place where = make_place(p, 2), endless = make_place(p, 0);
    char id[ULID_SIZE];
    bool found, changed;
    queue_state now;
    put(p, "{}", 1, id);
    for (int times = 1; times <= 2; times++) {
        claim_and_die(p, id);
        recover(&where, false);
        queue_task task = only_task(p, id);
        assert_int_equal(task.state, QUEUE_QUEUED);
        assert_int_equal(task.spent, 0);
        assert_int_equal(task.interrupted, times);
        assert_int_equal(task.not_before_ms, 0);
    }
    claim_and_die(p, id);
    recover(&where, false);
    expect_end(p, id, QUEUE_FAILED, "interrupted", "3 times");
    expect_end(p, id, QUEUE_FAILED, "interrupted", "max_interruptions");
    assert_true(queue_apply_command(p->q, id, QUEUE_RETRY, &found, &changed, &now, NULL) && changed);
    assert_int_equal(only_task(p, id).interrupted, 0);
    for (int times = 1; times <= 5; times++) {
        claim_and_die(p, id);
        recover(&endless, false);
        assert_int_equal(only_task(p, id).interrupted, times);
    }
}

/* Earlier failures of the job still count. */
static void test_interruptions_keep_the_count_of_failures(void **state)
{
    place *p = *state;
    const settlement_place where = make_place(p, 1);
    char id[ULID_SIZE];
    bool accepted = false;
    put(p, "{}", 2, id);
    claim_and_die(p, id);
    const queue_ending crash = {.state = QUEUE_FAILED, .exit_status = -1, .signal = 9, .ran_ms = 7};
    assert_true(queue_requeue(p->q, &(queue_fence){id, 0, 1}, true, 0, &crash, &accepted, NULL) && accepted);
    claim_and_die(p, id);
    recover(&where, false);
    queue_task task = only_task(p, id);
    assert_int_equal(task.spent, 1);
    assert_int_equal(task.ran_ms, 7);
    assert_int_equal(task.interrupted, 1);
}

static void test_the_reason_names_the_cause(void **state)
{
    place *p = *state;
    const settlement_place where = make_place(p, 0);
    char id[ULID_SIZE];
    queue_attempt *attempts;
    size_t count;
    put(p, "{}", 3, id);
    for (int restarted = 0; restarted < 2; restarted++) {
        claim_and_die(p, id);
        recover(&where, restarted);
    }
    assert_true(queue_list_attempts(p->q, id, -1, 0, 100, &attempts, &count, NULL));
    assert_int_equal(count, 2);
    assert_string_equal(attempts[0].reason, "the daemon ended during the attempt");
    assert_string_equal(attempts[1].reason, "the host restarted during the attempt");
    queue_attempts_free(attempts, count);
}

#define CASE(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)

int main(void)
{
    const struct CMUnitTest tests[] = {
        CASE(test_success_is_delivered),
        CASE(test_a_result_waits_for_the_disk),
        CASE(test_a_crash_is_tried_again),
        CASE(test_crashes_end_with_the_reason),
        CASE(test_errors_come_from_the_last_line),
        CASE(test_garbage_does_no_harm),
        CASE(test_success_without_a_report_is_an_error),
        CASE(test_a_short_output_is_no_result),
        CASE(test_an_output_that_is_not_described_is_no_result),
        CASE(test_a_missing_worker_costs_no_attempt),
        CASE(test_progress_is_seen),
        CASE(test_a_timeout_kills),
        CASE(test_a_timeout_is_of_all_attempts),
        CASE(test_a_stall_is_noticed),
        CASE(test_a_stall_is_tried_again),
        CASE(test_cancel_of_a_worker_that_ignores_sigterm),
        CASE(test_drain_puts_back_uncounted),
        CASE(test_workers_bound_what_runs),
        CASE(test_threads_bound_what_runs),
        CASE(test_memory_bounds_what_runs),
        CASE(test_jobs_from_a_larger_host_run_or_fail),
        CASE(test_free_space_is_that_of_the_state_directory_too),
        cmocka_unit_test(test_a_worker_out_of_memory_is_not_tried_again),
        cmocka_unit_test(test_a_crash_in_the_last_attempt_says_what_to_do),
        CASE(test_a_crashed_job_does_not_block_others),
        CASE(test_waits_double),
        CASE(test_a_clock_that_is_set_back_delays_no_retry),
        CASE(test_recovery),
        CASE(test_a_full_disk_at_the_start_loses_no_result),
        CASE(test_interruptions_have_a_bound),
        CASE(test_interruptions_keep_the_count_of_failures),
        CASE(test_the_reason_names_the_cause),
    };
    log_set_level(LOG_LEVEL_ERROR); /* hides the expected warning about a worker that does not start */
    return cmocka_run_group_tests_name("executor", tests, NULL, NULL);
}
