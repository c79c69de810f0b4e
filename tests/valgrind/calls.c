// SPDX-License-Identifier: Apache-2.0
/* calls: loaded in front of what runs under valgrind (3.19), for what that does not do, so that workers are
 * started.
 *
 * It keeps descriptors for itself and lets nobody lower their limit (EPERM): here that is said to be done. It
 * does not know pidfd_open (ENOSYS): here a descriptor becomes readable when a thread has seen the process
 * end. And it dies of an execve that fails: here one fails before, where a script's interpreter is
 * missing. */
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <signal.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>
#include <sys/pidfd.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

int setrlimit(__rlimit_resource_t which, const struct rlimit *limit)
{
    int (*real)(__rlimit_resource_t, const struct rlimit *) =
        (int (*)(__rlimit_resource_t, const struct rlimit *))dlsym(RTLD_NEXT, "setrlimit");
    return which == RLIMIT_NOFILE ? 0 : real(which, limit);
}

typedef struct watch {
    pid_t pid;
    int end; /* of the pipe, which its closing makes readable */
} watch;

static void *wait_for_end(void *context)
{
    watch *w = context;
    siginfo_t info;
    while (waitid(P_PID, (id_t)w->pid, &info, WEXITED | WNOWAIT) != 0 && errno == EINTR) {
    }
    close(w->end);
    free(w);
    return NULL;
}

int pidfd_open(pid_t pid, unsigned flags)
{
    int ends[2];
    pthread_t thread;
    sigset_t all, before;
    watch *w = malloc(sizeof *w);
    (void)flags;
    if (!w || pipe2(ends, O_CLOEXEC) != 0) {
        free(w);
        return -1;
    }
    *w = (watch){pid, ends[1]};
    sigfillset(&all); /* signals are for the program's own threads */
    pthread_sigmask(SIG_SETMASK, &all, &before);
    int why = pthread_create(&thread, NULL, wait_for_end, w);
    pthread_sigmask(SIG_SETMASK, &before, NULL);
    if (why != 0) abort();
    pthread_detach(thread);
    return ends[0];
}

int execv(const char *path, char *const words[])
{
    int (*real)(const char *, char *const *) =
        (int (*)(const char *, char *const *))dlsym(RTLD_NEXT, "execv");
    char line[256] = "";
    int fd = open(path, O_RDONLY | O_CLOEXEC);
    bool script = fd >= 0 && read(fd, line, sizeof line - 1) > 2 && line[0] == '#' && line[1] == '!';
    if (fd >= 0) close(fd);
    line[2 + strcspn(line + 2, " \n")] = '\0';
    if (script && access(line + 2, X_OK) != 0) return -1;
    return real(path, words);
}
