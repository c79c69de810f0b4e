/* xml_tags: the tags of an XML document, one after the other, with their attributes. Text between tags, comments,
 * declarations and CDATA are passed over; entities are not replaced; that tags are closed in order is not checked.
 * Threads: none.
 */
#ifndef HEXAD_IO_MESHES_XML_TAGS_H
#define HEXAD_IO_MESHES_XML_TAGS_H

#include <stdbool.h>
#include <stddef.h>

enum { XML_ATTRIBUTES_MOST = 16 };

typedef struct xml_word {
    const char *at;
    size_t length;
} xml_word;

typedef struct xml_tag {
    xml_word name;     /* without its prefix */
    bool is_end;       /* </name> */
    bool is_empty;     /* <name/> */
    size_t attributes; /* at most XML_ATTRIBUTES_MOST; others are skipped */
    xml_word key[XML_ATTRIBUTES_MOST], value[XML_ATTRIBUTES_MOST]; /* keys with their prefixes */
} xml_tag;

/* Reads the next tag at or behind *at, which is moved behind it. False: there is none; *at is then at the document's
 * end, or within a tag that is damaged. The document ends with a byte 0. */
bool xml_next_tag(const char **at, xml_tag *out);

bool xml_is(xml_word word, const char *text);

/* The value of the attribute with this key. A key that begins with ':' matches an attribute with any prefix. The
 * member `at` of the result is NULL if there is no such attribute. */
xml_word xml_attribute(const xml_tag *tag, const char *key);

#endif
