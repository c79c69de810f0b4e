// SPDX-License-Identifier: Apache-2.0
#include "service/http/forwarded.h"

#include <stdio.h>
#include <string.h>
#include <strings.h>

#include "service/http/head.h"

/* Maximum number of consecutive proxies. A header with more is ignored. */
#define MOST_HOPS 32
#define WORD_SIZE 128

typedef struct hops {
    address from[MOST_HOPS]; /* version 0: unknown */
    size_t count;
} hops;

static void skip_blanks(const char **at)
{
    *at += strspn(*at, " \t");
}

static bool read_token(const char **at, char word[WORD_SIZE])
{
    size_t length = 0;
    while (head_is_token_byte((*at)[length])) length++;
    if (length == 0 || length >= WORD_SIZE) return false;
    snprintf(word, WORD_SIZE, "%.*s", (int)length, *at);
    *at += length;
    return true;
}

static bool read_quoted(const char **at, char word[WORD_SIZE])
{
    const char *from = *at + 1;
    size_t length = 0;
    for (; *from && *from != '"'; from++) {
        if (*from == '\\' && !*++from) return false;
        if (length + 1 >= WORD_SIZE) return false;
        word[length++] = *from;
    }
    word[length] = '\0';
    *at = from + 1;
    return *from == '"';
}

/* An empty text, or ":" and a port, which may be an obfuscated name. */
static bool is_port(const char *text)
{
    if (!*text) return true;
    if (*text++ != ':' || !*text) return false;
    size_t length = strlen(text);
    return (length <= 5 && strspn(text, "0123456789") == length) || *text == '_';
}

/* Parses a node: "192.0.2.1", "192.0.2.1:80", "[2001:db8::1]", "[2001:db8::1]:80". Version 0 for other
 * texts. */
static address read_node(const char *text)
{
    char host[ADDRESS_TEXT_SIZE];
    address a = {0};
    bool in_brackets = *text == '[';
    const char *start = text + in_brackets,
               *end = in_brackets ? strchr(start, ']') : start + strcspn(start, ":");
    if (!end || (size_t)(end - start) >= sizeof host || !is_port(end + in_brackets)) return a;
    snprintf(host, sizeof host, "%.*s", (int)(end - start), start);
    if ((strchr(host, ':') != NULL) == in_brackets) address_parse(host, &a);
    return a;
}

/* Parses "for=..." or another parameter. An element has at most one "for". */
static bool read_pair(const char **at, address *from, bool *has_for)
{
    char name[WORD_SIZE], value[WORD_SIZE];
    if (!read_token(at, name) || *(*at)++ != '=') return false;
    if (!(**at == '"' ? read_quoted(at, value) : read_token(at, value))) return false;
    if (strcasecmp(name, "for") != 0) return true;
    if (*has_for) return false;
    *has_for = true;
    *from = read_node(value);
    return true;
}

/* Parses the element of one proxy: pairs separated by semicolons. */
static bool read_element(const char **at, hops *h)
{
    bool has_for = false;
    address from = {0};
    if (h->count == MOST_HOPS) return false;
    do {
        *at += **at == ';';
        if (!read_pair(at, &from, &has_for)) return false;
    } while (**at == ';');
    h->from[h->count++] = from;
    return true;
}

static bool read_value(const char *at, hops *h)
{
    skip_blanks(&at);
    while (*at) {
        if (*at != ',' && !read_element(&at, h)) return false;
        skip_blanks(&at);
        if (*at && *at++ != ',') return false;
        skip_blanks(&at);
    }
    return true;
}

address forwarded_client(const address *peer, const address_ranges *trusted, const char *const *values,
                         size_t count)
{
    hops h = {.count = 0};
    address client = *peer;
    if (!address_ranges_hold(trusted, peer)) return client;
    for (size_t i = 0; i < count; i++)
        if (!read_value(values[i], &h)) return client;
    while (h.count && h.from[h.count - 1].version && address_ranges_hold(trusted, &client))
        client = h.from[--h.count];
    return client;
}
