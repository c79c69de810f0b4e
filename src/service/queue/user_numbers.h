// SPDX-License-Identifier: Apache-2.0
/* user_numbers: a number per user, from a setting such as alice:2, bob:1, *:0.5. * stands for all users that
 * are not named. Any thread.
 */
#ifndef HEXAD_SERVICE_QUEUE_USER_NUMBERS_H
#define HEXAD_SERVICE_QUEUE_USER_NUMBERS_H

#include <stddef.h>

#include "base/core/error.h"

typedef struct user_numbers user_numbers;

/* Parses items of the form user:number. The caller frees the result. Error: spec_invalid (an item has another
 * form, its number is outside `low` .. `high`, or a user occurs twice). */
user_numbers *user_numbers_read(const char *const *items, size_t count, double low, double high, error *e);
void user_numbers_free(user_numbers *n); /* accepts NULL */

/* Replaces the numbers of `n` by those of `fresh`, and frees `fresh`. */
void user_numbers_change(user_numbers *n, user_numbers *fresh);

/* The number of this user, otherwise the number of *, otherwise `otherwise`. If `n` is NULL, `otherwise`. */
double user_numbers_of(const user_numbers *n, const char *user, double otherwise);

#endif
