// SPDX-License-Identifier: Apache-2.0
#include "service/api/backup_download.h"

#include "base/core/log.h"
#include "service/database/backup.h"

void backup_download_send(const http_context *c, const http_request *request, reply *r)
{
    error e = {0};
    int64_t bytes = 0;
    if (atomic_exchange(c->copying, true)) {
        reply_set_unavailable(r, "another backup is in progress; try again later");
        return;
    }
    int fd = backup_open(queue_database(c->q), executor_get_space(c->x).floor_bytes, &bytes, &e);
    atomic_store(c->copying, false);
    if (fd < 0 && e.code == ERROR_CANCELLED)
        reply_set_unavailable(r, e.message);
    else if (fd < 0)
        reply_set_error(r, &e, NULL);
    if (fd < 0) return;
    log_write(LOG_LEVEL_INFO, "backup made bytes=%lld user=%s", (long long)bytes, request->caller->user);
    reply_set_file(r, "application/vnd.sqlite3", fd, bytes);
}
