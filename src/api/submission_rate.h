/* submission_rate: how many jobs each user may still submit.
 *
 * A user may submit a number of jobs at once. What was used comes back evenly over an hour (a token bucket). Kept in
 * memory only. Any thread.
 */
#ifndef HEXAD_API_SUBMISSION_RATE_H
#define HEXAD_API_SUBMISSION_RATE_H

#include <stdbool.h>
#include <stdint.h>

typedef struct submission_rate submission_rate;

submission_rate *submission_rate_new(int64_t jobs_an_hour);
void submission_rate_free(submission_rate *r); /* accepts NULL */

/* Takes one job off what the user may submit. False when nothing is left: *wait_s says after how many seconds there is
 * again. `now_ms` is monotonic. */
bool submission_rate_take(submission_rate *r, const char *user, int64_t now_ms, int64_t *wait_s);

#endif
