// SPDX-License-Identifier: Apache-2.0
#include "base/core/manager.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/stat.h>
#include <unistd.h>

#include <systemd/sd-daemon.h>
#include <systemd/sd-journal.h>

#include "base/core/clock.h"

bool manager_is_present(void)
{
    const char *where = getenv("NOTIFY_SOCKET");
    return where && *where;
}

void manager_report_ready(void)
{
    sd_notify(0, "READY=1");
}

void manager_report_reloading(void)
{
    sd_notifyf(0, "RELOADING=1\nMONOTONIC_USEC=%lld", 1000 * (long long)clock_monotonic_ms());
}

void manager_report_starting(double seconds)
{
    sd_notifyf(0, "EXTEND_TIMEOUT_USEC=%.0f", 1e6 * seconds);
}

void manager_report_stopping(double seconds)
{
    sd_notifyf(0, "STOPPING=1\nEXTEND_TIMEOUT_USEC=%.0f", 1e6 * seconds);
}

void manager_report_status(const char *format, ...)
{
    char text[256];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    sd_notifyf(0, "STATUS=%s", text);
}

void manager_report_alive(void)
{
    sd_notify(0, "WATCHDOG=1");
}

int64_t manager_watchdog_ms(void)
{
    uint64_t microseconds = 0;
    return sd_watchdog_enabled(0, &microseconds) > 0 ? (int64_t)(microseconds / 1000) : 0;
}

size_t manager_sockets(int *first)
{
    int count = sd_listen_fds(0); /* keeps the environment, which other threads may read */
    *first = SD_LISTEN_FDS_START;
    return count > 0 ? (size_t)count : 0;
}

bool manager_has_journal(void)
{
    unsigned long long device, inode;
    struct stat info;
    const char *stream = getenv("JOURNAL_STREAM");
    return stream && sscanf(stream, "%llu:%llu", &device, &inode) == 2 && fstat(STDERR_FILENO, &info) == 0 &&
           info.st_dev == device && info.st_ino == inode;
}

bool manager_journal(const struct iovec *fields, size_t count)
{
    return sd_journal_sendv(fields, (int)count) == 0;
}
