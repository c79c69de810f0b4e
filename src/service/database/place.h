// SPDX-License-Identifier: Apache-2.0
/* place: whether the state directory that is open is still the one at its path.
 *
 * A process that keeps running after its state directory was removed, renamed, replaced or mounted over would
 * store changes in files that the next start does not find. The device and inode of the directory, the
 * database, its log and the lock are therefore compared with what is at their paths: one stat each, some
 * microseconds together. All of them are open, so that no other file can get their inodes. Any thread.
 */
#ifndef HEXAD_SERVICE_DATABASE_PLACE_H
#define HEXAD_SERVICE_DATABASE_PLACE_H

#include <stdbool.h>

#include "base/core/error.h"

typedef struct place place;

/* Notes what is at the paths now. The database must be open, and its log must exist. NULL on failure. */
place *place_note(const char *state_dir, error *e);
void place_free(place *p); /* accepts NULL */

/* Compares. False: something is lost; the error (state_lost) says what, and what to do. A loss is logged
 * once, and so is its end. True for NULL, a database without a state directory. */
bool place_check(place *p, error *e);

#endif
