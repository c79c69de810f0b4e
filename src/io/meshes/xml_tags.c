#include "io/meshes/xml_tags.h"

#include <string.h>

static const char blanks[] = " \t\r\n";

bool xml_is(xml_word word, const char *text)
{
    return word.at && strlen(text) == word.length && memcmp(word.at, text, word.length) == 0;
}

/* Behind the text that ends what begins at `at`; at the document's end without one. */
static const char *skip_past(const char *at, const char *end)
{
    const char *found = strstr(at, end);
    return found ? found + strlen(end) : at + strlen(at);
}

/* To the next '<' of a tag. */
static const char *find_tag(const char *at)
{
    while ((at += strcspn(at, "<"), *at)) {
        if (strncmp(at, "<!--", 4) == 0)
            at = skip_past(at, "-->");
        else if (strncmp(at, "<![CDATA[", 9) == 0)
            at = skip_past(at, "]]>");
        else if (at[1] == '?')
            at = skip_past(at, "?>");
        else if (at[1] == '!')
            at = skip_past(at, ">");
        else
            break;
    }
    return at;
}

static bool read_attribute(const char **at, xml_word *key, xml_word *value)
{
    key->at = *at;
    key->length = strcspn(*at, " \t\r\n=<>/'\"");
    *at += key->length;
    *at += strspn(*at, blanks);
    if (key->length == 0 || **at != '=') return false;
    ++*at;
    *at += strspn(*at, blanks);
    const char quote[2] = {**at, 0};
    if (*quote != '"' && *quote != '\'') return false;
    value->at = ++*at;
    value->length = strcspn(*at, quote);
    *at += value->length;
    if (**at != *quote) return false;
    ++*at;
    return true;
}

bool xml_next_tag(const char **at, xml_tag *out)
{
    const char *p = *at = find_tag(*at);
    if (!*p) return false;
    out->attributes = 0;
    out->is_end = *++p == '/';
    p += out->is_end;
    const size_t length = strcspn(p, " \t\r\n<>/");
    const char *colon = memchr(p, ':', length);
    out->name = colon ? (xml_word){colon + 1, length - (size_t)(colon + 1 - p)} : (xml_word){p, length};
    p += length;
    for (p += strspn(p, blanks); *p != '>' && *p != '/'; p += strspn(p, blanks)) {
        xml_word key, value;
        if (!read_attribute(&p, &key, &value)) return false;
        if (out->attributes == XML_ATTRIBUTES_MOST) continue;
        out->key[out->attributes] = key;
        out->value[out->attributes++] = value;
    }
    out->is_empty = *p == '/';
    p += out->is_empty;
    if (*p != '>') return false;
    *at = p + 1;
    return true;
}

xml_word xml_attribute(const xml_tag *tag, const char *key)
{
    const size_t length = strlen(key);
    for (size_t k = 0; k < tag->attributes; k++) {
        const xml_word found = tag->key[k];
        if (*key == ':' ? found.length > length && memcmp(found.at + found.length - length, key, length) == 0
                        : xml_is(found, key))
            return tag->value[k];
    }
    return (xml_word){NULL, 0};
}
