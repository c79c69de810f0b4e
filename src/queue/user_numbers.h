/* user_numbers: a number for each user, as a setting gives them: alice:2, bob:1, *:0.5, where * stands for all others.
 *
 * Any thread.
 */
#ifndef HEXAD_QUEUE_USER_NUMBERS_H
#define HEXAD_QUEUE_USER_NUMBERS_H

#include <stddef.h>

#include "base/error.h"

typedef struct user_numbers user_numbers;

/* Reads items of the form user:number. Error spec_invalid: an item has another form, its number is below `low` or above
 * `high`, or a user is named twice. */
user_numbers *user_numbers_read(const char *const *items, size_t count, double low, double high, error *e);
void user_numbers_free(user_numbers *n); /* accepts NULL */

/* Gives `n` the numbers of `fresh`, and frees that. */
void user_numbers_change(user_numbers *n, user_numbers *fresh);

/* The number of this user: his own, else that of *, else `otherwise`. Accepts NULL, which names nobody. */
double user_numbers_of(const user_numbers *n, const char *user, double otherwise);

#endif
