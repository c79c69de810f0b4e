/* set_clock: the clocks of a test program, which it sets. Include it in one file of the program. */
#ifndef HEXAD_TESTS_SET_CLOCK_H
#define HEXAD_TESTS_SET_CLOCK_H

#include <stdatomic.h>
#include <stdint.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

/* Added to what the kernel says. */
static _Atomic int64_t wall_ahead_ms, boot_ahead_ms;

/* Takes the place of the C library's function. */
int clock_gettime(clockid_t clock, struct timespec *now)
{
    int64_t ahead_ms = clock == CLOCK_REALTIME ? wall_ahead_ms : clock == CLOCK_BOOTTIME ? boot_ahead_ms : 0;
    if (syscall(SYS_clock_gettime, clock, now) != 0) return -1;
    int64_t ns = now->tv_nsec + ahead_ms % 1000 * 1000000, seconds = now->tv_sec + ahead_ms / 1000;
    if (ns < 0 || ns >= 1000000000) {
        seconds += ns < 0 ? -1 : 1;
        ns -= ns < 0 ? -1000000000 : 1000000000;
    }
    now->tv_sec = (time_t)seconds;
    now->tv_nsec = (long)ns;
    return 0;
}

/* The wall clock is set. */
static inline void step_wall(int64_t ms)
{
    wall_ahead_ms += ms;
}

/* Time passes. */
static inline void pass(int64_t ms)
{
    wall_ahead_ms += ms;
    boot_ahead_ms += ms;
}

#endif
