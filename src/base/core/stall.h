// SPDX-License-Identifier: Apache-2.0
/* stall: notices that the loop of a thread does not advance, and writes it to the log: once when a stall is
 * noticed, and once when the loop advances again.
 */
#ifndef HEXAD_BASE_CORE_STALL_H
#define HEXAD_BASE_CORE_STALL_H

#include <stdbool.h>
#include <stdint.h>

typedef struct stall {
    const char *loop;   /* subject of the log line, such as "the supervisor" */
    const char *effect; /* what does not happen meanwhile */
    uint64_t turns;     /* turns of the loop, at the last call at which it had advanced */
    int64_t since_ms;   /* time of that call; 0: there was no call yet */
    bool stalled;
} stall;

/* Returns whether the loop has advanced since the last call. `turns` is the number of its turns, and `now_ms`
 * > 0 the monotonic time. The caller makes the loop turn after each call. */
bool stall_check(stall *s, uint64_t turns, int64_t now_ms);

#endif
