/* say: what the commands of hexadctl print, and the exit codes that go with it. One thread. */
#ifndef HEXAD_CLIENT_SAY_H
#define HEXAD_CLIENT_SAY_H

#include <stdio.h>

#include "client/client.h"

/* Text from a job may hold anything; a terminal must not obey it. */
void say_text(FILE *file, const char *text);

int say_complaint(const char *what); /* COMMAND_FAILED */
int say_unreachable(const error *e); /* COMMAND_UNREACHABLE */

/* Prints the problem document of a reply that is no success. */
int say_refused(const client_reply *reply);

void say_document(const json *document);

/* A path below /v1/jobs for an id that a user typed, to be freed; NULL, and a complaint, when that cannot be one. */
char *say_job_path(const char *id, const char *rest);

#endif
