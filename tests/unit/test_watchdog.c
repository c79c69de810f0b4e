// SPDX-License-Identifier: Apache-2.0
/* watch: ends jobs that do not check for a stop, and prints lines for silent phases. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cmocka.h>

#include "job/phases/watchdog.h"

enum { LEFT = 42 };

static volatile sig_atomic_t told_to_stop;

static void stop(int number)
{
    told_to_stop = number;
}

static void leave(void *context)
{
    _exit(*(const int *)context);
}

/* A process whose job hangs ends when it is requested to. */
static void test_a_process_ends_although_its_job_hangs(void **state)
{
    (void)state;
    int ready[2];
    assert_int_equal(pipe(ready), 0);
    pid_t child = fork();
    if (child == 0) {
        int code = LEFT;
        const watchdog_params params = {NULL, &told_to_stop, leave, &code};
        signal(SIGTERM, stop);
        if (!watchdog_start(&params, NULL) || write(ready[1], "", 1) != 1) _exit(1);
        for (;;) pause();
    }
    char byte;
    assert_int_equal(read(ready[0], &byte, 1), 1);
    kill(child, SIGTERM);
    int status;
    assert_int_equal(waitpid(child, &status, 0), child);
    assert_true(WIFEXITED(status) && WEXITSTATUS(status) == LEFT);
    close(ready[0]);
    close(ready[1]);
}

static void never(void *context)
{
    (void)context;
    abort();
}

/* A silent phase has progress lines as long as the watch runs. */
static void test_a_silent_job_has_progress(void **state)
{
    (void)state;
    static const volatile sig_atomic_t no;
    int ends[2];
    assert_int_equal(pipe(ends), 0);
    progress p;
    progress_begin(&p, ends[1], false, (progress_listener){0});
    const watchdog_params params = {&p, &no, never, NULL};
    watchdog *w = watchdog_start(&params, NULL);
    assert_non_null(w);
    progress_enter(&p, PROGRESS_LOAD);
    progress_enter(&p, PROGRESS_WRITE);
    FILE *lines = fdopen(ends[0], "r");
    char line[512];
    for (int k = 0; k < 4; k++) {
        assert_non_null(fgets(line, sizeof line, lines));
        assert_non_null(strstr(line, k == 0 ? "\"phase\":\"load\"" : "\"phase\":\"write\""));
    }
    watchdog_end(w);
    watchdog_end(NULL);
    progress_end(&p);
    fclose(lines);
    close(ends[1]);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_a_process_ends_although_its_job_hangs),
        cmocka_unit_test(test_a_silent_job_has_progress),
    };
    return cmocka_run_group_tests_name("watch", tests, NULL, NULL);
}
