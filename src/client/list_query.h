/* list_query: the path and query that request a list of jobs. No state. */
#ifndef HEXAD_CLIENT_LIST_QUERY_H
#define HEXAD_CLIENT_LIST_QUERY_H

#include "client/command.h"

/* The jobs that the options choose, a page of them from the cursor on (NULL: the first); to be freed. */
char *list_query_path(client *c, const command_options *options, const char *cursor);

/* Whether the text may be a time: "90m", "90m ago", or one that begins with a year. The server checks the rest. */
bool list_query_is_moment(const char *given);

#endif
