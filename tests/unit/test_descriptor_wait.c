// SPDX-License-Identifier: Apache-2.0
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/eventfd.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>
#include <cmocka.h>

#include "base/core/descriptor_wait.h"

static void an_event_is_taken_once(void **state)
{
    (void)state;
    int descriptor = eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC);
    uint64_t count = 0;
    assert_false(descriptor_take_event(descriptor, &count, sizeof count));
    eventfd_write(descriptor, 3);
    struct pollfd polled = {.fd = descriptor, .events = POLLIN};
    descriptor_wait(&polled, 1, -1);
    assert_true(polled.revents & POLLIN);
    assert_true(descriptor_take_event(descriptor, &count, sizeof count));
    assert_int_equal(count, 3);
    assert_false(descriptor_take_event(descriptor, &count, sizeof count));
    close(descriptor);
}

static void take_from_closed_descriptor(void)
{
    uint64_t count;
    descriptor_take_event(-1, &count, sizeof count);
}

static void poll_more_descriptors_than_allowed(void)
{
    setrlimit(RLIMIT_NOFILE, &(struct rlimit){0, 0});
    struct pollfd polled = {.fd = -1};
    descriptor_wait(&polled, 1, 0);
}

/* Runs action() in a child. Returns its exit status, or -1 if it was killed. */
static int status_of(void (*action)(void))
{
    fflush(NULL);
    pid_t child = fork();
    if (child == 0) {
        dup2(open("/dev/null", O_WRONLY | O_CLOEXEC), STDERR_FILENO); /* the error is logged */
        action();
        _exit(0);
    }
    int status;
    assert_int_equal(waitpid(child, &status, 0), child);
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
}

/* A loop that ignored the error would never wait again. */
static void errors_of_descriptors_end_the_process(void **state)
{
    (void)state;
    assert_int_equal(status_of(take_from_closed_descriptor), EXIT_FAILURE);
    assert_int_equal(status_of(poll_more_descriptors_than_allowed), EXIT_FAILURE);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(an_event_is_taken_once),
        cmocka_unit_test(errors_of_descriptors_end_the_process),
    };
    return cmocka_run_group_tests_name("descriptor_wait", tests, NULL, NULL);
}
