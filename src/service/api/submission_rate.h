/* submission_rate: limits the jobs that each user may submit in an hour.
 *
 * Each user has a token bucket, which holds `jobs_an_hour` tokens and is refilled at this rate; a job takes one
 * token. The buckets are in memory only, so a restart fills them. Any thread.
 */
#ifndef HEXAD_SERVICE_API_SUBMISSION_RATE_H
#define HEXAD_SERVICE_API_SUBMISSION_RATE_H

#include <stdbool.h>
#include <stdint.h>

typedef struct submission_rate submission_rate;

submission_rate *submission_rate_new(int64_t jobs_an_hour); /* > 0 */
void submission_rate_free(submission_rate *r);              /* accepts NULL */

/* Takes one token of the user. False if the bucket is empty: *wait_s is the time until the next token, in seconds,
 * rounded up. `now_ms` is monotonic. */
bool submission_rate_take(submission_rate *r, const char *user, int64_t now_ms, int64_t *wait_s);

#endif
