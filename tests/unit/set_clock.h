// SPDX-License-Identifier: Apache-2.0
/* set_clock: replaces the clocks of a test program by clocks that the test sets. Include it in one file of
 * the program.
 */
#ifndef HEXAD_TESTS_SET_CLOCK_H
#define HEXAD_TESTS_SET_CLOCK_H

#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

/* Added to the time of the kernel, or to a fixed time after stop_clocks(). `passed_ms` is added to both
 * clocks. */
static _Atomic int64_t stepped_ms, passed_ms;
static atomic_bool clocks_are_stopped;
/* The value of `passed_ms` at the thread's last reading of the wall clock, for its next reading of the time
 * since boot. A program that reads both clocks in turn then sees no difference. */
static _Thread_local int64_t passed_at_wall_ms = -1;

static int64_t clock_ahead_ms(clockid_t clock)
{
    int64_t passed = passed_ms;
    if (clock == CLOCK_REALTIME) {
        passed_at_wall_ms = passed;
        return stepped_ms + passed;
    }
    if (clock != CLOCK_BOOTTIME) return 0;
    if (passed_at_wall_ms >= 0) passed = passed_at_wall_ms;
    passed_at_wall_ms = -1;
    return passed;
}

/* Replaces the function of the C library. */
int clock_gettime(clockid_t clock, struct timespec *now)
{
    int64_t ahead_ms = clock_ahead_ms(clock);
    if (syscall(SYS_clock_gettime, clock, now) != 0) return -1;
    if (clocks_are_stopped && (clock == CLOCK_REALTIME || clock == CLOCK_BOOTTIME))
        *now = (struct timespec){.tv_sec = clock == CLOCK_REALTIME ? 1800000000 : 1000000};
    int64_t ns = now->tv_nsec + ahead_ms % 1000 * 1000000, seconds = now->tv_sec + ahead_ms / 1000;
    if (ns < 0 || ns >= 1000000000) {
        seconds += ns < 0 ? -1 : 1;
        ns -= ns < 0 ? -1000000000 : 1000000000;
    }
    now->tv_sec = (time_t)seconds;
    now->tv_nsec = (long)ns;
    return 0;
}

/* From now on only step_wall() and pass() change the wall clock and the time since boot. The duration of the
 * test itself then does not affect its measurements. */
static inline void stop_clocks(void)
{
    clocks_are_stopped = true;
}

/* Steps the wall clock. */
static inline void step_wall(int64_t ms)
{
    stepped_ms += ms;
}

/* Advances both clocks. */
static inline void pass(int64_t ms)
{
    passed_ms += ms;
    passed_at_wall_ms = -1;
}

/* Restores both clocks of the kernel. */
static inline void reset_clocks(void)
{
    stepped_ms = passed_ms = 0;
    passed_at_wall_ms = -1;
}

#endif
