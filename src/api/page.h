/* page: the handlers of the web page, and its files.
 *
 * The files are read once, when the service starts. They hold no data of the service and are open to
 * all; what the page shows it asks for over the other routes, as every client does.
 */
#ifndef HEXAD_API_PAGE_H
#define HEXAD_API_PAGE_H

#include "api/context.h"

typedef struct page page;

/* Reads the page: from the directory `page` beside the running program, as in the tree of the build, otherwise from
 * where it was installed, also below another root (DESTDIR). Error input_missing: it is at neither place. */
page *page_open(error *e);
void page_close(page *p); /* accepts NULL */

http_handler page_show;      /* index.html */
http_handler page_send_file; /* what it is made of */

#endif
