// SPDX-License-Identifier: Apache-2.0
#include "service/queue/chunks.h"

#include <limits.h>

/* The first task after all tasks of the chunk of `task`. */
static int find_end(const job_state *j, int task)
{
    return task - task % j->chunk + j->chunk;
}

/* Finds the first ready task from `first` on and before `end`. */
static bool find_ready(database *d, const job_state *j, int first, int end, int *number, error *e)
{
    bool ok = false;
    *number = -1;
    sqlite3_stmt *s = ASK(d, e,
                          "SELECT number FROM task WHERE job = ?1 AND state = 'queued' AND waits = 0"
                          " AND number >= ?2 AND number < ?3 ORDER BY number LIMIT 1",
                          integer(j->seq), integer(first), integer(end));
    while (database_next(d, s, &ok, e)) *number = sqlite3_column_int(s, 0);
    return ok;
}

/* Whether a task of the chunk that ends before `end` runs. */
static bool find_running(database *d, const job_state *j, int end, bool *runs, error *e)
{
    int64_t found = 0;
    bool ok = database_read_integer(d,
                                    ASK(d, e,
                                        "SELECT 1 FROM task WHERE job = ?1 AND state = 'running'"
                                        " AND number >= ?2 AND number < ?3 LIMIT 1",
                                        integer(j->seq), integer(end - j->chunk), integer(end)),
                                    &found, e);
    *runs = found != 0;
    return ok;
}

bool chunks_find_task(database *d, const job_state *j, int *number, error *e)
{
    bool runs = true;
    for (int first = 0; runs; first = find_end(j, *number)) {
        if (!find_ready(d, j, first, INT_MAX, number, e)) return false;
        if (*number < 0 || j->chunk == 1) return true;
        if (!find_running(d, j, find_end(j, *number), &runs, e)) return false;
    }
    return true;
}

bool chunks_find_next(database *d, const job_state *j, int task, int *number, error *e)
{
    return find_ready(d, j, task + 1, find_end(j, task), number, e);
}

bool chunks_are_busy(database *d, const job_state *j, bool *busy, error *e)
{
    int number = -1;
    *busy = false;
    if (j->chunk == 1 || !j->running || j->ready <= j->held) return true;
    if (!chunks_find_task(d, j, &number, e)) return false;
    *busy = number < 0;
    return true;
}
