/* print: what the commands of hexadctl print, and the exit codes that go with it. One thread. */
#ifndef HEXAD_CLIENT_PRINT_H
#define HEXAD_CLIENT_PRINT_H

#include <stdio.h>

#include "client/client.h"

/* Replaces control characters, since the text of a job may hold any and a terminal would act on them. */
void print_text(FILE *file, const char *text);

int print_failure(const char *format, ...) __attribute__((format(printf, 1, 2))); /* COMMAND_FAILED */
int print_unreachable(const error *e);                                            /* COMMAND_UNREACHABLE */

/* Prints the problem document of a reply that is an error; returns the exit code for its status. */
int print_refused(const client_reply *reply);
/* The same of a spec, which came from the file of this name. */
int print_refused_spec(const client_reply *reply, const char *file);

/* One line: id, state, outcome, the error if there is one, and why the results were not delivered. */
void print_job(json_at job);
/* The same of a job whose results were copied again. */
void print_delivered_job(json_at job);

/* Whether results of the job could not be copied to output.directory. */
bool print_is_undelivered(json_at job);

/* "packing: hex_fraction 0.937 good, edge_cv 0.0559 good" of the notes of a job, behind the title. Nothing without ratings. */
void print_ratings(FILE *file, const char *title, json_at notes);
/* The notes of a job or task, or the warnings and advice of an estimate: a line for each. Nothing without any. */
void print_notes(FILE *file, json_at notes);

void print_document(const json *document);

#endif
