// SPDX-License-Identifier: Apache-2.0
/* numeric_state: what of the state of a thread changes its numbers and texts: the locale, and the floating-point
 * environment (rounding, subnormals, traps, exceptions). The host of a library sets them as it likes, and a new thread
 * has the rounding of the thread that starts it, and the locale of the process.
 */
#ifndef HEXAD_BASE_CORE_NUMERIC_STATE_H
#define HEXAD_BASE_CORE_NUMERIC_STATE_H

#include <fenv.h>
#include <locale.h>
#include <pthread.h>

typedef struct numeric_state {
    fenv_t arithmetic;
    locale_t locale;
} numeric_state;

/* Gives the calling thread the locale "C" and the default environment. *before: its state until then. */
void numeric_state_enter(numeric_state *before);

/* Gives the calling thread the state *before. */
void numeric_state_leave(const numeric_state *before);

/* As pthread_create: starts a thread that has the state of numeric_state_enter. */
int numeric_state_start_thread(pthread_t *thread, const pthread_attr_t *attributes,
                               void *(*run)(void *argument), void *argument);

#endif
