/* turns: threads that work in the same directory take turns.
 *
 * A directory is known by its device and inode, whatever the path by which it was opened. Only threads of one process take
 * turns. Any thread.
 */
#ifndef HEXAD_STORE_TURNS_H
#define HEXAD_STORE_TURNS_H

#include <stdbool.h>
#include <sys/types.h>

#include "base/error.h"

typedef struct store_turns store_turns;

store_turns *store_turns_new(void);
void store_turns_free(store_turns *t); /* no turn is taken; accepts NULL */

/* One turn. */
typedef struct store_turn {
    dev_t device;
    ino_t inode;
} store_turn;

/* Waits until no other thread has a turn in this open directory, and takes it. False: its inode cannot be read. */
bool store_turns_take(store_turns *t, int directory, store_turn *turn, error *e);
void store_turns_end(store_turns *t, store_turn turn);

#endif
