// SPDX-License-Identifier: Apache-2.0
#include "base/core/error.h"

#include <errno.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

static const char *const names[] = {ERROR_LIST(WORDS_TEXT, )};

/* Removes an incomplete UTF-8 sequence at the end of a truncated message, and replaces line breaks, since
 * messages are written in lines of JSON and log records. */
static void tidy(char *text)
{
    size_t length = strlen(text);
    size_t tail = length;
    while (tail > 0 && length - tail < 3 && ((unsigned char)text[tail - 1] & 0xC0) == 0x80) tail--;
    if (tail > 0) {
        unsigned char lead = (unsigned char)text[tail - 1];
        size_t want = lead >= 0xF0 ? 4 : lead >= 0xE0 ? 3 : lead >= 0xC0 ? 2 : 1;
        if (lead >= 0xC0 && length - (tail - 1) < want) text[tail - 1] = '\0';
    }
    for (char *c = text; *c; c++)
        if ((unsigned char)*c < 0x20) *c = ' ';
}

bool error_set(error *e, error_code code, const char *format, ...)
{
    if (!e) return false;
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(e->message, sizeof e->message, format, arguments);
    va_end(arguments);
    tidy(e->message);
    e->code = code;
    return false;
}

bool error_prefix(error *e, const char *format, ...)
{
    if (!e || e->code == ERROR_NONE) return false;
    char context[sizeof e->message / 2];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(context, sizeof context, format, arguments);
    va_end(arguments);
    char whole[sizeof e->message + sizeof context + 3];
    snprintf(whole, sizeof whole, "%s: %s", context, e->message);
    memcpy(e->message, whole, sizeof e->message - 1);
    e->message[sizeof e->message - 1] = '\0';
    tidy(e->message);
    return false;
}

const char *error_code_name(error_code code)
{
    return (unsigned)code < ERROR_CODE_COUNT ? names[code] : names[ERROR_INTERNAL];
}

error_code error_code_from_name(const char *name)
{
    for (int code = 0; code < ERROR_CODE_COUNT; code++)
        if (strcmp(names[code], name) == 0) return (error_code)code;
    return ERROR_INTERNAL;
}

error_code error_code_of_errno(int why)
{
    if (why == ENOSPC || why == EDQUOT) return ERROR_STORAGE_FULL;
    if (why == EFBIG) return ERROR_LIMIT_FILE;
    return why == EIO ? ERROR_STORAGE_FAILED : ERROR_INTERNAL;
}

bool error_is_of_storage(error_code code)
{
    return code == ERROR_STORAGE_FULL || code == ERROR_STORAGE_FAILED;
}
