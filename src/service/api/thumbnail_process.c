// SPDX-License-Identifier: Apache-2.0
#include "service/api/thumbnail_process.h"

#include <unistd.h>

#include "base/core/clock.h"
#include "base/core/worker_contract.h"
#include "service/results/result.h"

static bool stops(void *context)
{
    return wait_list_is_dismissed(context);
}

bool thumbnail_process_read(const http_context *c, const char *directory, int64_t until_ms, thumbnail *out,
                            error *e)
{
    const int64_t limit_ms = clock_monotonic_ms() + (int64_t)(c->thumbnail_timeout_s * 1000);
    const thumbnail_patience patience = {
        .until_ms = limit_ms < until_ms ? limit_ms : until_ms, .is_over = stops, .context = c->waiting};
    int64_t bytes;
    int fd = result_open_file(directory, WORKER_PREVIEW_NAME, &bytes, e);
    bool ok = fd >= 0 && thumbnail_read(c->worker, fd, &patience, out, e);
    if (fd >= 0) close(fd);
    return ok;
}
