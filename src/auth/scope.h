/* scope: what a caller may do.
 *
 *     read    see jobs, their results and the service
 *     submit  submit jobs and upload inputs
 *     cancel  cancel, pause, resume, retry, change and delete jobs
 *     admin   all of that for the jobs of all users, and administer the service
 *
 * Constant data; any thread.
 */
#ifndef HEXAD_AUTH_SCOPE_H
#define HEXAD_AUTH_SCOPE_H

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

/* "read", ... of a single scope. */
const char *scope_name(unsigned scope);

/* Reads "read,submit"; false, and *scopes untouched, for an empty list, an unknown or a repeated name. Admin
 * includes the others. */
bool scope_parse(const char *text, unsigned *scopes);

/* The list as scope_parse reads it; writes into `text` and returns it. */
char *scope_print(unsigned scopes, char text[SCOPE_TEXT_SIZE]);

#endif
