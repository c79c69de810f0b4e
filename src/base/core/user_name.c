// SPDX-License-Identifier: Apache-2.0
#include "base/core/user_name.h"

#include <pwd.h>
#include <stdio.h>

enum { RECORD_BYTES = 16384 };

void user_name_of(uid_t uid, char name[USER_NAME_SIZE])
{
    char buffer[RECORD_BYTES];
    struct passwd record, *found = NULL;
    if (getpwuid_r(uid, &record, buffer, sizeof buffer, &found) == 0 && found)
        snprintf(name, USER_NAME_SIZE, "%s", found->pw_name);
    else
        snprintf(name, USER_NAME_SIZE, "%u", (unsigned)uid);
}
