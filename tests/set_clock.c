// SPDX-License-Identifier: Apache-2.0
/* set_clock: preloaded into a program, adds to its clocks what a file says. The environment variable
 * HEXAD_SET_CLOCK names the file, which has three 64-bit integers of this host, in milliseconds: what is
 * added to the wall clock; what is added to the monotonic clock; what each reading of the monotonic clock
 * adds to the later ones. A test changes them while the program runs. tests/setclock.py builds it. */
#include <fcntl.h>
#include <stdatomic.h>
#include <stdint.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

enum { WALL, MONOTONIC, PER_READING, NUMBERS };

static const volatile int64_t *number;
static atomic_int_fast64_t readings;

__attribute__((constructor)) static void open_file(void)
{
    const char *path = getenv("HEXAD_SET_CLOCK");
    int fd = path ? open(path, O_RDONLY | O_CLOEXEC) : -1;
    void *found = fd < 0 ? MAP_FAILED : mmap(NULL, NUMBERS * sizeof *number, PROT_READ, MAP_SHARED, fd, 0);
    if (fd >= 0) close(fd);
    if (found != MAP_FAILED) number = found;
}

int clock_gettime(clockid_t clock, struct timespec *now)
{
    if (syscall(SYS_clock_gettime, clock, now) != 0) return -1;
    if ((clock != CLOCK_REALTIME && clock != CLOCK_MONOTONIC) || !number) return 0;
    const int64_t ahead_ms = clock == CLOCK_REALTIME
                                 ? number[WALL]
                                 : number[MONOTONIC] + number[PER_READING] * atomic_fetch_add(&readings, 1);
    int64_t ns = (int64_t)now->tv_nsec + ahead_ms % 1000 * 1000000;
    now->tv_sec += (time_t)(ahead_ms / 1000 + (ns < 0 ? -1 : ns / 1000000000));
    now->tv_nsec = (long)(ns < 0 ? ns + 1000000000 : ns % 1000000000);
    return 0;
}
