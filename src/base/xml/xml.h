// SPDX-License-Identifier: Apache-2.0
/* xml: the elements of an XML document, in their order, by expat. The only user of expat.
 *
 * A document type is refused, because its declarations can expand to any length. Threads: one for each
 * document.
 */
#ifndef HEXAD_BASE_XML_XML_H
#define HEXAD_BASE_XML_XML_H

#include <stdbool.h>
#include <stddef.h>

typedef enum xml_result {
    XML_RESULT_READ,    /* read to its end */
    XML_RESULT_STOPPED, /* `begin` stopped it */
    XML_RESULT_NO_MEMORY,
    XML_RESULT_DECLARATIONS, /* it has a document type that is not permitted */
    XML_RESULT_INVALID       /* it is not XML: see `line` and `why` */
} xml_result;

/* A document. The caller sets the first group of members before xml_read. */
typedef struct xml {
    const char *data;
    size_t size;
    void *context;
    /* `name` and the names of attributes have their prefixes. `attributes`: names and values in turn, and
     * NULL. False: reading stops. */
    bool (*begin)(void *context, const char *name, const char **attributes);
    void (*end)(void *context, const char *name);              /* may be NULL */
    void (*text)(void *context, const char *text, int length); /* may be NULL; text comes in pieces */
    bool allows_doctype;                                       /* a document type without declarations */

    xml_result result;
    unsigned long line; /* of the fault */
    const char *why;    /* static storage */
    void *parser;       /* while the document is read: expat's */
} xml;

/* Reads the document as UTF-8. */
xml_result xml_read(xml *x);

/* A copy in UTF-8 of a document in UTF-16, ISO-8859-1 or windows-1252, by its first bytes or its declaration; a byte 0
 * follows. Data from the tag AppendedData of VTK on are copied as they are. The caller frees it. NULL: no copy is needed,
 * or there is no memory; *size is unchanged. */
char *xml_in_utf8(const char *data, size_t *size);

/* In `begin` and `end`: the line of the tag, and where it begins and ends in the data. */
unsigned long xml_line(const xml *x);
size_t xml_tag_begin(const xml *x);
size_t xml_tag_end(const xml *x);

/* The value of an attribute; NULL: there is none. A name that begins with ':' matches any prefix. */
const char *xml_attribute(const char **attributes, const char *name);

/* A name without its prefix. */
const char *xml_local_name(const char *name);

#endif
