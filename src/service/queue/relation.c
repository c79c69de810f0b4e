// SPDX-License-Identifier: Apache-2.0
#include "service/queue/relation.h"

#define FAILURE RELATION_FAILURE("job.owner", "need", "need")

bool relation_describe_failure(database *d, int64_t seq, int64_t need, char **message, error *e)
{
    bool ok = false;
    sqlite3_stmt *s = ASK(d, e,
                          "SELECT 'this job depends on the job ' || need.id || ', which ' || " FAILURE
                          " FROM job CROSS JOIN job AS need ON need.seq = ?2 WHERE job.seq = ?1",
                          integer(seq), integer(need));
    while (database_next(d, s, &ok, e)) *message = database_text(s, 0);
    return ok;
}
