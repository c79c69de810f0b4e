// SPDX-License-Identifier: Apache-2.0
/* user_name: the name of a user, for messages. */
#ifndef HEXAD_BASE_CORE_USER_NAME_H
#define HEXAD_BASE_CORE_USER_NAME_H

#include <sys/types.h>

enum { USER_NAME_SIZE = 64 };

/* The name, or the number of a user without one. A longer name is cut off. Any thread; it may wait for the
 * network. */
void user_name_of(uid_t uid, char name[USER_NAME_SIZE]);

#endif
