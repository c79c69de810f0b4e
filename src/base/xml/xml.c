// SPDX-License-Identifier: Apache-2.0
#include "base/xml/xml.h"

#include <string.h>

#include <expat.h>

/* expat takes an int as the length. */
static const size_t most_at_once = 1 << 30;

unsigned long xml_line(const xml *x)
{
    return (unsigned long)XML_GetCurrentLineNumber(x->parser);
}

size_t xml_tag_begin(const xml *x)
{
    return (size_t)XML_GetCurrentByteIndex(x->parser);
}

size_t xml_tag_end(const xml *x)
{
    return xml_tag_begin(x) + (size_t)XML_GetCurrentByteCount(x->parser);
}

const char *xml_local_name(const char *name)
{
    const char *colon = strrchr(name, ':');
    return colon ? colon + 1 : name;
}

const char *xml_attribute(const char **attributes, const char *name)
{
    const size_t length = strlen(name);
    for (; *attributes; attributes += 2) {
        const size_t own = strlen(attributes[0]);
        if (*name == ':' ? own > length && strcmp(attributes[0] + own - length, name) == 0
                         : strcmp(attributes[0], name) == 0)
            return attributes[1];
    }
    return NULL;
}

static void stop(xml *x, xml_result result)
{
    x->result = result;
    XML_StopParser(x->parser, XML_FALSE);
}

static void XMLCALL begin_element(void *context, const char *name, const char **attributes)
{
    xml *x = context;
    if (!x->begin(x->context, name, attributes)) stop(x, XML_RESULT_STOPPED);
}

static void XMLCALL end_element(void *context, const char *name)
{
    const xml *x = context;
    if (x->end) x->end(x->context, name);
}

static void XMLCALL take_text(void *context, const char *text, int length)
{
    const xml *x = context;
    if (x->text) x->text(x->context, text, length);
}

static void XMLCALL check_doctype(void *context, const char *name, const char *system, const char *public,
                                  int has_declarations)
{
    xml *x = context;
    (void)name, (void)system, (void)public;
    if (has_declarations || !x->allows_doctype) stop(x, XML_RESULT_DECLARATIONS);
}

xml_result xml_read(xml *x)
{
    enum XML_Status status = XML_STATUS_OK;
    x->result = XML_RESULT_READ;
    if (!(x->parser = XML_ParserCreate("UTF-8"))) return x->result = XML_RESULT_NO_MEMORY;
    XML_SetUserData(x->parser, x);
    XML_SetElementHandler(x->parser, begin_element, end_element);
    XML_SetCharacterDataHandler(x->parser, take_text);
    XML_SetStartDoctypeDeclHandler(x->parser, check_doctype);
    size_t at = 0;
    do {
        const size_t some = x->size - at < most_at_once ? x->size - at : most_at_once;
        status = XML_Parse(x->parser, x->data + at, (int)some, at + some == x->size);
        at += some;
    } while (status == XML_STATUS_OK && at < x->size);
    if (status != XML_STATUS_OK && x->result == XML_RESULT_READ) {
        const enum XML_Error fault = XML_GetErrorCode(x->parser);
        x->result = fault == XML_ERROR_NO_MEMORY ? XML_RESULT_NO_MEMORY : XML_RESULT_INVALID;
        x->line = xml_line(x);
        x->why = XML_ErrorString(fault);
    }
    XML_ParserFree(x->parser);
    x->parser = NULL;
    return x->result;
}
