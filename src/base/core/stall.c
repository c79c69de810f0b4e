// SPDX-License-Identifier: Apache-2.0
#include "base/core/stall.h"

#include "base/core/clock.h"
#include "base/core/log.h"

bool stall_check(stall *s, uint64_t turns, int64_t now_ms)
{
    const double passed_s = clock_seconds(now_ms - s->since_ms);
    if (!s->since_ms || turns != s->turns) {
        if (s->stalled) log_write(LOG_LEVEL_WARNING, "%s advances again, after %.1f s", s->loop, passed_s);
        s->turns = turns;
        s->since_ms = now_ms;
        s->stalled = false;
        return true;
    }
    if (!s->stalled)
        log_write(
            LOG_LEVEL_ERROR,
            "%s has not advanced for %.1f s: %s. If the log does not say that it advances again, restart hexad.",
            s->loop, passed_s, s->effect);
    s->stalled = true;
    return false;
}
