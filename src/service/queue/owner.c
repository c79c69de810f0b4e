// SPDX-License-Identifier: Apache-2.0
#include "service/queue/owner.h"

#include <stdlib.h>

#include "service/database/schema.h"
#include "service/queue/usage.h"

/* Number of users, and number of jobs of each, among which a fitting job is searched. */
#define USERS_AHEAD "64"
#define JOBS_AHEAD "64"

#define BELOW_LIMITS "(?1 = 0 OR owner.running < ?1) AND " USAGE_BELOW
#define MAY_CLAIM "owner.priority IS NOT NULL AND " BELOW_LIMITS
#define IN_TURN "owner.priority DESC, owner.pass, owner.first"

static bool count(database *d, int64_t seq, int unfinished, int tasks, int running, error *e)
{
    return RUN(
        d, e,
        "INSERT INTO owner (name, unfinished, running, pass, tasks)"
        " SELECT owner, max(?2, 0), max(?3, 0), turn, max(?4, 0) FROM job CROSS JOIN service WHERE job.seq = ?1"
        " ON CONFLICT (name) DO UPDATE SET unfinished = unfinished + ?2, running = running + ?3,"
        " tasks = tasks + ?4, pass = iif(unfinished, pass, max(pass, excluded.pass))",
        integer(seq), integer(unfinished), integer(running), integer(tasks));
}

/* Deletes users without jobs. A user whose next turn is in the future is kept while other users wait. */
static bool forget(database *d, error *e)
{
    static const char sql[] = "DELETE FROM owner WHERE unfinished = 0 AND (pass <= (SELECT turn FROM service)"
                              " OR NOT EXISTS (SELECT 1 FROM owner WHERE unfinished > 0))";
    return database_run(d, sql, NULL, 0, e);
}

bool owner_update(database *d, int64_t seq, int unfinished, int tasks, int running, error *e)
{
    return ((!unfinished && !tasks && !running) || count(d, seq, unfinished, tasks, running, e)) &&
           RUN(d, e,
               "UPDATE owner SET (priority, first) =" SCHEMA_FIRST_JOB
               " WHERE name = (SELECT owner FROM job WHERE seq = ?1)",
               integer(seq)) &&
           (unfinished >= 0 || forget(d, e));
}

/* Reads the name of the job's owner; the caller frees it. */
static bool read_name(database *d, int64_t seq, char **name, error *e)
{
    bool ok = false;
    sqlite3_stmt *s = ASK(d, e, "SELECT owner FROM job WHERE seq = ?1", integer(seq));
    while (database_next(d, s, &ok, e)) *name = database_text(s, 0);
    return ok;
}

bool owner_take_turn(database *d, int64_t seq, const user_numbers *weights, error *e)
{
    char *name = NULL;
    bool ok = read_name(d, seq, &name, e);
    if (ok && name) {
        double step = 1 / user_numbers_of(weights, name, 1);
        ok = RUN(d, e, "UPDATE service SET turn = max(turn, (SELECT pass FROM owner WHERE name = ?1))",
                 text(name)) &&
             RUN(d, e, "UPDATE owner SET pass = (SELECT turn FROM service) + ?2 WHERE name = ?1", text(name),
                 real(step));
    }
    free(name);
    return ok;
}

#define FITS "((min(threads, ?2) <= ?3 AND memory_mb <= ?4) OR memory_mb > ?5)"

/* Finds the job that is first in order, and whether it fits. */
static bool find_head(database *d, const queue_resources *resources, const queue_sum *bound, int64_t *seq,
                      bool *fits, error *e)
{
    bool ok = false;
    sqlite3_stmt *s =
        ASK(d, e,
            "SELECT job.seq, " FITS " FROM owner CROSS JOIN job ON job.seq = owner.first WHERE " MAY_CLAIM
            " ORDER BY " IN_TURN " LIMIT 1",
            integer(resources->most_of_owner), integer(resources->all_threads), integer(resources->threads),
            integer(resources->memory_mb), integer(resources->all_memory_mb), integer(bound->bytes),
            integer(bound->results));
    while (database_next(d, s, &ok, e)) {
        *seq = sqlite3_column_int64(s, 0);
        *fits = sqlite3_column_int(s, 1);
    }
    return ok;
}

/* Finds the first job that fits. */
static bool find_fitting(database *d, const queue_resources *resources, const queue_sum *bound, int64_t *seq,
                         error *e)
{
    return database_read_integer(
        d,
        ASK(d, e,
            "SELECT job.seq FROM"
            " (SELECT name, pass FROM owner WHERE " MAY_CLAIM " ORDER BY " IN_TURN " LIMIT " USERS_AHEAD
            ") AS near"
            " CROSS JOIN job ON job.seq ="
            " (SELECT seq FROM (SELECT seq, threads, memory_mb FROM job INDEXED BY job_ready"
            "   WHERE owner = near.name AND " SCHEMA_CLAIMABLE
            " ORDER BY priority DESC, seq LIMIT " JOBS_AHEAD ")"
            "  WHERE " FITS " LIMIT 1)"
            " ORDER BY job.priority DESC, near.pass, job.seq LIMIT 1",
            integer(resources->most_of_owner), integer(resources->all_threads), integer(resources->threads),
            integer(resources->memory_mb), integer(resources->all_memory_mb), integer(bound->bytes),
            integer(bound->results)),
        seq, e);
}

bool owner_may_continue(queue *q, int64_t seq, const queue_resources *resources, bool *may, error *e)
{
    database *d = q->database;
    int64_t found = 0;
    bool ok = database_read_integer(
        d,
        ASK(d, e,
            "SELECT 1 FROM job CROSS JOIN owner ON owner.name = job.owner WHERE job.seq = ?8 AND is_paused = 0 AND target IS NULL"
            " AND (max_running = 0 OR job.running < max_running) AND " BELOW_LIMITS " AND " FITS,
            integer(resources->most_of_owner), integer(resources->all_threads), integer(resources->threads),
            integer(resources->memory_mb), integer(resources->all_memory_mb), integer(q->bounds.user.bytes),
            integer(q->bounds.user.results), integer(seq)),
        &found, e);
    *may = found != 0;
    return ok;
}

bool owner_choose(queue *q, const queue_resources *resources, int64_t *seq, error *e)
{
    database *d = q->database;
    overtaken *o = &q->overtaken;
    int64_t head = 0;
    bool fits = false;
    *seq = 0;
    if (!find_head(d, resources, &q->bounds.user, &head, &fits, e)) return false;
    if (!head || fits) {
        *seq = head;
        return true;
    }
    if (o->seq != head) *o = (overtaken){.seq = head};
    if (o->times == QUEUE_OVERTAKE_MOST) return true;
    if (!find_fitting(d, resources, &q->bounds.user, seq, e)) return false;
    if (*seq) o->times++;
    return true;
}
