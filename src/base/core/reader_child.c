// SPDX-License-Identifier: Apache-2.0
/* The functions of reader.h that run in the process that reads, which may be a module. */
#include "base/core/reader.h"

#include <errno.h>
#include <poll.h>
#include <pthread.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <unistd.h>

#include "base/core/transfer.h"

static rlim_t mapped_now(void)
{
    unsigned long pages = 0;
    FILE *file = fopen("/proc/self/statm", "r");
    if (file && fscanf(file, "%lu", &pages) != 1) pages = 0;
    if (file) fclose(file);
    return (rlim_t)pages * (rlim_t)sysconf(_SC_PAGESIZE);
}

/* Lowers a limit; a lower existing limit is kept. */
static void set_limit(int which, rlim_t soft, rlim_t hard)
{
    struct rlimit limit;
    if (getrlimit(which, &limit) != 0) return;
    if (limit.rlim_max < hard) hard = limit.rlim_max;
    if (hard < soft) soft = hard;
    limit = (struct rlimit){soft, hard};
    setrlimit(which, &limit);
}

/* Time, in ms, from the end of the output to the end of the process. One that is about to end does so by itself,
 * with the checks of sanitizers. */
#ifdef __SANITIZE_ADDRESS__
#define LAST_MS 1000
#else
#define LAST_MS 50
#endif
#define WATCH_STACK ((size_t)256 << 10) /* bytes */

static void *end_with_output(void *unused)
{
    struct pollfd output = {.fd = STDOUT_FILENO}; /* its other end is closed: always reported */
    int ready;
    (void)unused;
    do ready = poll(&output, 1, -1);
    while (ready < 0 && errno == EINTR);
    if (ready < 0) return NULL;
    poll(NULL, 0, LAST_MS);
    _exit(0);
}

/* Ends this process when the other end of its output is closed, since a computation does not notice that. Without
 * the thread, the limit of CPU time ends it. */
static void watch_output(void)
{
    pthread_attr_t attributes;
    pthread_t thread;
    pthread_attr_init(&attributes);
    pthread_attr_setdetachstate(&attributes, PTHREAD_CREATE_DETACHED);
    pthread_attr_setstacksize(&attributes, WATCH_STACK);
    pthread_create(&thread, &attributes, end_with_output, NULL);
    pthread_attr_destroy(&attributes);
}

size_t reader_limit(int argc, char **argv, unsigned descriptors)
{
    if (argc != 4) return 0;
    rlim_t memory = (rlim_t)strtoull(argv[2], NULL, 10), seconds = (rlim_t)strtoull(argv[3], NULL, 10);
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    watch_output(); /* before the memory of the process is measured */
    set_limit(RLIMIT_CORE, 0, 0);
    /* the soft limit sends SIGXCPU, which the parent recognises */
    set_limit(RLIMIT_CPU, seconds, seconds + 1);
#ifdef __SANITIZE_ADDRESS__
    (void)mapped_now; /* the sanitizer reserves more address space than any limit */
#else
    rlim_t most = memory + mapped_now();
    set_limit(RLIMIT_AS, most, most);
#endif
    set_limit(RLIMIT_FSIZE, 0, 0); /* pipes are not affected */
    set_limit(RLIMIT_NOFILE, descriptors, descriptors);
    return (size_t)memory;
}

bool reader_write(const void *from, size_t count)
{
    return transfer_write(STDOUT_FILENO, from, count);
}

bool reader_answer(const void *answer, size_t size, const char *text, size_t text_length)
{
    const reader_head head = {READER_MAGIC, ERROR_NONE, (uint32_t)text_length, size};
    return reader_write(&head, sizeof head) && reader_write(text, text_length) && reader_write(answer, size);
}

bool reader_refuse(error_code code, const char *message)
{
    const size_t length = strnlen(message, READER_MESSAGE_MAX);
    const reader_head head = {READER_MAGIC, (uint32_t)code, (uint32_t)length, 0};
    return reader_write(&head, sizeof head) && reader_write(message, length);
}

bool reader_receive(void *request, size_t size, int *file)
{
    union {
        char buffer[CMSG_SPACE(sizeof(int))];
        struct cmsghdr align;
    } control;
    struct iovec text = {request, size};
    struct msghdr message = {.msg_iov = &text,
                             .msg_iovlen = 1,
                             .msg_control = control.buffer,
                             .msg_controllen = sizeof control.buffer};
    ssize_t got;
    *file = -1;
    do got = recvmsg(STDIN_FILENO, &message, MSG_CMSG_CLOEXEC | MSG_WAITALL);
    while (got < 0 && errno == EINTR);
    struct cmsghdr *c = got > 0 ? CMSG_FIRSTHDR(&message) : NULL;
    if (c && c->cmsg_type == SCM_RIGHTS) memcpy(file, CMSG_DATA(c), sizeof *file);
    return got == (ssize_t)size;
}
