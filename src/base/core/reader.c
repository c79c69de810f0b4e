// SPDX-License-Identifier: Apache-2.0
#include "base/core/reader.h"

#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <spawn.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#ifdef __SANITIZE_ADDRESS__
#define SANITIZED 1
#else
#define SANITIZED 0
#endif

/* Exit status of a process that a sanitizer stops; readers exit with other values. */
#define SANITIZER_STATUS 99
#define SANITIZER_OPTIONS "_OPTIONS=exitcode=99"

bool reader_check_file(int fd, const char *what, off_t *size, error *e)
{
    static const char lfs[] = "version https://git-lfs";
    struct stat st;
    char head[sizeof lfs] = {0};
    if (fstat(fd, &st) != 0 || !S_ISREG(st.st_mode))
        return error_set(e, ERROR_INPUT_DAMAGED, "the path is not a regular file: give the path of a file");
    if (st.st_size == 0)
        return error_set(e, ERROR_INPUT_DAMAGED, "the file is empty (0 bytes): copy or save it again");
    if (pread(fd, head, sizeof lfs - 1, 0) < 0)
        return error_set(e, ERROR_INPUT_DAMAGED, "the file cannot be read: %s", strerror(errno));
    if (strcmp(head, lfs) == 0)
        return error_set(
            e, ERROR_INPUT_DAMAGED,
            "the file is a Git LFS pointer instead of the %s: run `git lfs pull` in its repository", what);
    *size = st.st_size;
    return true;
}

bool reader_start(const reader_params *p, reader *out, error *e)
{
    char memory[32], seconds[32], program[] = "hexad-worker";
    char address[] = "ASAN" SANITIZER_OPTIONS, undefined[] = "UBSAN" SANITIZER_OPTIONS;
    char *environment[] = {SANITIZED ? address : NULL, undefined, NULL};
    snprintf(memory, sizeof memory, "%zu", p->memory_limit);
    snprintf(seconds, sizeof seconds, "%u", p->seconds);
    char *arguments[] = {program, (char *)p->command, (char *)p->argument, memory, seconds, NULL};
    int ends[2]; /* ends[0]: of this process; ends[1]: of the new process */
    bool talks = p->fd < 0;
    if ((talks ? socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends) : pipe2(ends, O_CLOEXEC)) != 0)
        return error_set(e, ERROR_INTERNAL, "no pipe to read the file through: %s", strerror(errno));
    posix_spawn_file_actions_t actions;
    posix_spawn_file_actions_init(&actions);
    posix_spawn_file_actions_adddup2(&actions, ends[1], STDOUT_FILENO);
    posix_spawn_file_actions_adddup2(&actions, talks ? ends[1] : p->fd, STDIN_FILENO);
    if (!SANITIZED) /* the report of a sanitizer goes to the standard error of this process */
        posix_spawn_file_actions_addopen(&actions, STDERR_FILENO, "/dev/null", O_WRONLY, 0);
    posix_spawn_file_actions_addclosefrom_np(&actions, STDERR_FILENO + 1);
    int why = posix_spawn(&out->pid, p->program ? p->program : "/proc/self/exe", &actions, NULL, arguments,
                          environment);
    posix_spawn_file_actions_destroy(&actions);
    close(ends[1]);
    out->begun = out->refused = false;
    const bool has_started = why == 0;
    if (has_started && (out->stream = fdopen(ends[0], "rb"))) return true;
    if (has_started) why = errno;
    close(ends[0]); /* a process that has started ends with its output */
    while (has_started && waitpid(out->pid, NULL, 0) < 0 && errno == EINTR) continue;
    return error_set(e, ERROR_INTERNAL, "the process that reads the file could not be started: %s",
                     strerror(why));
}

bool reader_end(reader *r, bool ok, error *e)
{
    int status;
    pid_t ended;
    fclose(r->stream);
    r->stream = NULL;
    if (!ok && r->begun) kill(r->pid, SIGKILL); /* in the sandbox, it ends with its output only */
    do ended = waitpid(r->pid, &status, 0);
    while (ended < 0 && errno == EINTR);
    if (ended != r->pid)
        return error_set(e, ERROR_INTERNAL, "the process that reads the file disappeared: try again");
    if (SANITIZED && WIFEXITED(status) && WEXITSTATUS(status) == SANITIZER_STATUS)
        return error_set(e, ERROR_INTERNAL, "a sanitizer stopped the process that reads the file");
    if (!ok && r->begun) return false;
    if (WIFSIGNALED(status) && WTERMSIG(status) == SIGXCPU)
        return error_set(
            e, ERROR_INPUT_DAMAGED,
            "the file takes too long to read, and its reader was stopped: save it in another format");
    if (WIFSIGNALED(status))
        return error_set(
            e, ERROR_INPUT_DAMAGED,
            "the library that reads this format crashed or aborted (%s), so the file is probably damaged. Save it again "
            "with a program that opens it.",
            strsignal(WTERMSIG(status)));
    return ok && (WEXITSTATUS(status) == 0 ||
                  error_set(e, ERROR_INPUT_DAMAGED,
                            "the file ended while it was read: check the disk and copy it again"));
}

bool reader_send(reader *r, const void *request, size_t size, int file, error *e)
{
    union {
        char buffer[CMSG_SPACE(sizeof(int))];
        struct cmsghdr align;
    } control = {.buffer = {0}};
    struct iovec text = {(void *)request, size};
    struct msghdr message = {.msg_iov = &text, .msg_iovlen = 1};
    r->begun = r->refused = false;
    if (file >= 0) {
        message.msg_control = control.buffer;
        message.msg_controllen = sizeof control.buffer;
        struct cmsghdr *c = CMSG_FIRSTHDR(&message);
        c->cmsg_level = SOL_SOCKET;
        c->cmsg_type = SCM_RIGHTS;
        c->cmsg_len = CMSG_LEN(sizeof file);
        memcpy(CMSG_DATA(c), &file, sizeof file);
    }
    return sendmsg(fileno(r->stream), &message, MSG_NOSIGNAL) == (ssize_t)size ||
           error_set(e, ERROR_INPUT_DAMAGED,
                     "the file ended while it was read: check the disk and copy it again");
}
