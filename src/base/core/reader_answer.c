// SPDX-License-Identifier: Apache-2.0
/* The functions of reader.h that receive what the process answers. */
#include "base/core/reader.h"

#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"

bool reader_invalid(error *e)
{
    return error_set(e, ERROR_INPUT_DAMAGED,
                     "the file made its reader return an invalid answer: save it in another format");
}

bool reader_get(reader *r, void *to, size_t size, size_t count, error *e)
{
    return fread(to, size, count, r->stream) == count ||
           error_set(e, ERROR_INPUT_DAMAGED,
                     "the file ended while it was read: check the disk and copy it again");
}

void reader_blank(char *text, const char *kept)
{
    for (char *p = text; *p; p++)
        if (((unsigned char)*p < ' ' || *p == 127) && !strchr(kept, *p)) *p = ' ';
}

static bool refuse(reader *r, error_code code, char *message, error *e)
{
    r->refused = true;
    reader_blank(message, "");
    return *message ? error_set(e, code, "%s", message)
                    : error_set(e, ERROR_INPUT_DAMAGED,
                                "the reader refused the file without a reason: save it in another format");
}

bool reader_get_answer(reader *r, void *answer, size_t size, char **text, size_t most, error *e)
{
    reader_head head;
    if (!reader_get(r, &head, sizeof head, 1, e)) return false;
    const bool is_error = head.code != ERROR_NONE;
    if (head.magic != READER_MAGIC || head.code >= ERROR_CODE_COUNT || head.size != (is_error ? 0 : size) ||
        head.text_length > (is_error ? READER_MESSAGE_MAX : most))
        return reader_invalid(e);
    r->begun = true;
    char *found = mem_alloc((size_t)head.text_length + 1);
    found[head.text_length] = 0;
    const bool ok = reader_get(r, found, 1, head.text_length, e) &&
                    (!is_error || refuse(r, (error_code)head.code, found, e)) &&
                    reader_get(r, answer, 1, size, e);
    if (ok && text)
        *text = found;
    else
        free(found);
    return ok;
}

bool reader_settle(reader *r, bool ok, error *e)
{
    if (!ok && !r->refused) reader_end(r, false, e);
    return ok;
}

void reader_close(reader *r)
{
    error unused = {0};
    if (r->stream) reader_end(r, true, &unused);
}
