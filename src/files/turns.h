// SPDX-License-Identifier: Apache-2.0
/* turns: threads that work in the same directory take turns.
 *
 * A directory is identified by its device and inode, so different paths to it are equal. Turns exclude
 * threads of one process only. Any thread may call.
 */
#ifndef HEXAD_FILES_TURNS_H
#define HEXAD_FILES_TURNS_H

#include <stdbool.h>
#include <sys/types.h>

#include "base/core/error.h"

typedef struct store_turns store_turns;

store_turns *store_turns_new(void);
void store_turns_free(store_turns *t); /* requires that no turn is taken; accepts NULL */

/* A turn: the directory that the thread has taken. */
typedef struct store_turn {
    dev_t device;
    ino_t inode;
} store_turn;

/* Waits until no other thread has a turn in this open directory, then takes the turn. False if fstat
 * fails. */
bool store_turns_take(store_turns *t, int directory, store_turn *turn, error *e);
void store_turns_end(store_turns *t, store_turn turn);

#endif
