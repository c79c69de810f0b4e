// SPDX-License-Identifier: Apache-2.0
/* Records which basic blocks a program executes: a part of the traced build that measurements/mutations/mutate.py makes.
 *
 * gcc's -fsanitize-coverage=trace-pc inserts a call of __sanitizer_cov_trace_pc into every basic block. The
 * call sets the byte of its return address in the file TRACE_DIRECTORY/PROGRAM, which is mapped when the
 * program starts. Counts of --coverage are written at exit; these bytes remain when a process is killed,
 * calls _exit, or may write no files. */
#include <dlfcn.h>
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

extern const char __ehdr_start[] __attribute__((visibility("hidden")));
void __sanitizer_cov_trace_pc(void) __attribute__((visibility("hidden")));

static char *executed;
static size_t executed_size;

void __sanitizer_cov_trace_pc(void)
{
    size_t at = (size_t)((const char *)__builtin_return_address(0) - __ehdr_start);
    if (at < executed_size) executed[at] = 1;
}

/* Maps the file of this program or module. A program without a file is not traced. */
__attribute__((constructor(101))) static void begin_trace(void)
{
    char program[4096], path[8192];
    Dl_info info;
    const char *name = dladdr(__ehdr_start, &info) && info.dli_fname ? info.dli_fname : "";
    size_t length = strlen(name);
    if (length < 3 || strcmp(name + length - 3, ".so") != 0) {
        ssize_t got = readlink("/proc/self/exe", program, sizeof program - 1);
        if (got < 0) return;
        program[got] = 0;
        name = program;
    }
    const char *slash = strrchr(name, '/');
    snprintf(path, sizeof path, TRACE_DIRECTORY "/%s", slash ? slash + 1 : name);
    int fd = open(path, O_RDWR | O_CLOEXEC);
    if (fd < 0) return;
    struct stat st;
    if (fstat(fd, &st) == 0 && st.st_size > 0) {
        void *mapped = mmap(NULL, (size_t)st.st_size, PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0);
        if (mapped != MAP_FAILED) {
            executed = mapped;
            executed_size = (size_t)st.st_size;
        }
    }
    close(fd);
}
