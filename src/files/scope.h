// SPDX-License-Identifier: Apache-2.0
/* scope: the permissions of a caller.
 *
 *     read    see jobs, their results and the service
 *     submit  submit jobs and upload inputs
 *     cancel  cancel, pause, resume, retry, change and delete jobs
 *     admin   the three above for the jobs of all users, and administration of the service
 *
 * Constant data; any thread.
 */
#ifndef HEXAD_FILES_SCOPE_H
#define HEXAD_FILES_SCOPE_H

#include <stdbool.h>

enum {
    SCOPE_READ = 1,
    SCOPE_SUBMIT = 2,
    SCOPE_CANCEL = 4,
    SCOPE_ADMIN = 8,
    SCOPE_USER = SCOPE_READ | SCOPE_SUBMIT | SCOPE_CANCEL,
    SCOPE_ALL = SCOPE_USER | SCOPE_ADMIN
};

#define SCOPE_TEXT_SIZE 32

/* The name of a single scope, such as "read". */
const char *scope_name(unsigned scope);

/* Parses a list such as "read,submit". admin includes the other scopes. False, with *scopes unchanged, if the
 * list is empty or a name is unknown or repeated. */
bool scope_parse(const char *text, unsigned *scopes);

/* Prints the list in the form that scope_parse reads; writes to `text` and returns it. */
char *scope_print(unsigned scopes, char text[SCOPE_TEXT_SIZE]);

#endif
