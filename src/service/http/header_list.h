// SPDX-License-Identifier: Apache-2.0
/* header_list: headers whose values are lists (RFC 9110, 5.6.1). Several headers of one name are one list. */
#ifndef HEXAD_SERVICE_HTTP_HEADER_LIST_H
#define HEXAD_SERVICE_HTTP_HEADER_LIST_H

struct MHD_Connection;

/* The values of all headers `name` of a request, separated by ", ", if there are several; the caller frees it. NULL:
 * there is at most one. The serving thread calls it. */
char *header_list_join(struct MHD_Connection *connection, const char *name);

/* The first element of the list that begins with this token, such as a preference or a media range, in any case. Returns
 * the text behind the token and its blanks; NULL: there is none, or `list` is NULL. */
const char *header_list_find(const char *list, const char *token);

#endif
