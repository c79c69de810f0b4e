// SPDX-License-Identifier: Apache-2.0
/* web_page: the handlers of the web page, and its files.
 *
 * The files are read once, when the service starts. They contain no data of the service and need no
 * authorisation: the page requests its data over the other routes, like every client. A page is constant; any
 * thread.
 */
#ifndef HEXAD_SERVICE_API_WEB_PAGE_H
#define HEXAD_SERVICE_API_WEB_PAGE_H

#include "service/api/context.h"

typedef struct page page;

/* Reads the page from the directory `page` beside the running program (in a build directory), otherwise from
 * the installed directory, which may be below another root (DESTDIR). NULL on failure. Errors: input_missing:
 * neither directory has it; not_supported: the page is not built. */
page *web_page_open(error *e);
void web_page_close(page *p); /* accepts NULL */

http_handler web_page_show;      /* index.html */
http_handler web_page_send_file; /* its other files */

#endif
