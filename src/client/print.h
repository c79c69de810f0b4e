// SPDX-License-Identifier: Apache-2.0
/* print: prints answers, failures and notes for the commands of hexadctl, and returns the matching exit
 * codes. Texts of others are escaped by base/core/terminal_text; documents are printed as they are. One
 * thread.
 */
#ifndef HEXAD_CLIENT_PRINT_H
#define HEXAD_CLIENT_PRINT_H

#include <stdio.h>

#include "client/client.h"

int print_failure(const char *format, ...) __attribute__((format(printf, 1, 2))); /* COMMAND_FAILED */
int print_unreachable(const error *e);                                            /* COMMAND_UNREACHABLE */

/* Prints the problem document of an error reply. Returns the exit code for its status. */
int print_refused(const client_reply *reply);
/* As print_refused, for a spec that was read from this file. */
int print_refused_spec(const client_reply *reply, const char *file);

/* Prints one line: id, state, outcome, the error if there is one, and the reason why the results were not
 * delivered. */
void print_job(json_at job);
/* As print_job, for a job whose results were copied again. */
void print_delivered_job(json_at job);

/* Whether results of the job could not be copied to output.directory. */
bool print_is_undelivered(json_at job);

/* Prints the number of points and their spacing after the title, such as "5738 points, spacing 0.0503". Prints nothing
 * if the notes lack them. */
void print_size(FILE *file, const char *title, json_at notes);
/* Prints the ratings of the notes of a job after the title, such as "packing: hex_fraction 0.937 good,
 * edge_cv 0.0559 good". Prints nothing if there are no ratings. */
void print_ratings(FILE *file, const char *title, json_at notes);
/* Prints the notes of a job or task, or the warnings and advice of an estimate, one line each. */
void print_notes(FILE *file, json_at notes);

/* Prints a text of several lines. */
void print_page(const char *text);

void print_document(const json *document);

#endif
