// SPDX-License-Identifier: Apache-2.0
/* list_query: makes the path and the query of a request for a list of jobs. No state. */
#ifndef HEXAD_CLIENT_LIST_QUERY_H
#define HEXAD_CLIENT_LIST_QUERY_H

#include "client/command.h"

/* The path of a page of the jobs that the options select; the caller frees it. `cursor` is the start of the
 * page; NULL: the first page. */
char *list_query_path(client *c, const command_options *options, const char *cursor);

/* Reads all pages of the jobs that the options select, the newest first. Returns an exit code; on success *jobs is an
 * array of their documents, which the caller frees. */
int list_query_read_all(client *c, const command_options *options, json **jobs);

/* Whether the text may be a time: "90m", "90m ago", or a text that begins with a year. The server checks
 * the rest. */
bool list_query_is_moment(const char *given);

#endif
