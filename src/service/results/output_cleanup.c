// SPDX-License-Identifier: Apache-2.0
#include "service/results/output_cleanup.h"

#include <stdlib.h>
#include <string.h>

#include "base/core/clock.h"
#include "base/core/log.h"
#include "base/core/memory.h"

/* Time between two rounds, in milliseconds. An unreachable directory becomes reachable when its disk is
 * mounted. */
#define AGAIN_MS 60000

struct output_cleanup {
    queue *q;
    const store_outputs *outputs;
    queue_copy *copies; /* the task's; the name is NULL after the file was removed */
    size_t count;
    bool again; /* not the first round */
};

static bool remove_one(const output_cleanup *c, const queue_copy *copy, bool first)
{
    error e = {0};
    if (store_output_clear(c->outputs, copy->directory, copy->name, &e) &&
        queue_forget_copy(c->q, copy->name, &e)) {
        log_write(LOG_LEVEL_INFO, "temporary file of an interrupted copy removed directory=%s name=%s",
                  copy->directory, copy->name);
        return true;
    }
    log_write(first ? LOG_LEVEL_WARNING : LOG_LEVEL_DEBUG,
              "cannot remove the file %s of an interrupted copy from %s and tries again: %s", copy->name,
              copy->directory, e.message);
    return false;
}

/* Tries to remove all files that are left. */
static int64_t do_round(void *context)
{
    output_cleanup *c = context;
    size_t left = 0;
    for (size_t i = 0; i < c->count; i++) {
        if (!c->copies[i].name) continue;
        if (!remove_one(c, &c->copies[i], !c->again)) {
            left++;
            continue;
        }
        free(c->copies[i].name);
        c->copies[i].name = NULL;
    }
    c->again = true;
    return left ? clock_monotonic_ms() + AGAIN_MS : RUNNER_WHEN_WOKEN;
}

bool output_cleanup_add(runner *to, queue *q, const store_outputs *outputs, output_cleanup **made, error *e)
{
    output_cleanup *c = mem_alloc(sizeof *c);
    c->q = q;
    c->outputs = outputs;
    *made = c;
    if (!queue_list_copies(q, &c->copies, &c->count, e)) return false;
    if (c->count) runner_add(to, "cleanup", do_round, c);
    return true;
}

void output_cleanup_free(output_cleanup *c)
{
    if (!c) return;
    queue_copies_free(c->copies, c->count);
    free(c);
}
