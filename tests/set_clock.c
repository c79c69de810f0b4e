/* set_clock: preloaded into a program, adds to the wall clock what a file says. The environment variable HEXAD_SET_CLOCK
 * names the file, whose first 8 bytes are milliseconds as an integer of this host; a test changes them while the program
 * runs. tests/setclock.py builds it. */
#include <fcntl.h>
#include <stdint.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

static const volatile int64_t *ahead_ms;

__attribute__((constructor)) static void open_file(void)
{
    const char *path = getenv("HEXAD_SET_CLOCK");
    int fd = path ? open(path, O_RDONLY | O_CLOEXEC) : -1;
    void *found = fd < 0 ? MAP_FAILED : mmap(NULL, sizeof *ahead_ms, PROT_READ, MAP_SHARED, fd, 0);
    if (fd >= 0) close(fd);
    if (found != MAP_FAILED) ahead_ms = found;
}

int clock_gettime(clockid_t clock, struct timespec *now)
{
    if (syscall(SYS_clock_gettime, clock, now) != 0) return -1;
    if (clock != CLOCK_REALTIME || !ahead_ms) return 0;
    int64_t ns = (int64_t)now->tv_nsec + *ahead_ms % 1000 * 1000000;
    now->tv_sec += (time_t)(*ahead_ms / 1000 + (ns < 0 ? -1 : ns / 1000000000));
    now->tv_nsec = (long)(ns < 0 ? ns + 1000000000 : ns % 1000000000);
    return 0;
}
