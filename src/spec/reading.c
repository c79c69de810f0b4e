// SPDX-License-Identifier: Apache-2.0
#include "spec/reading.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"

void reading_open(reading *r, spec *s, const spec *known)
{
    *r = (reading){.partial = (partial_spec *)s,
                   .known = known,
                   .surface = (partial_surface *)&s->surface,
                   .methods = ~0u};
}

void reading_close(reading *r)
{
    free(r->absent);
    r->absent = NULL;
    r->absent_count = 0;
}

spec *reading_whole(const reading *r)
{
    return r->complete && r->total == 0 ? (spec *)r->partial : NULL;
}

void *reading_target(reading *r, size_t offset)
{
    size_t first = offsetof(spec, surface);
    if (offset >= first && offset < first + sizeof(spec_surface))
        return (char *)r->surface + (offset - first);
    return (char *)r->partial + offset;
}

void reading_add_absent(reading *r, const spec_row *row, json *normal)
{
    r->absent = mem_resize(r->absent, (r->absent_count + 1) * sizeof *r->absent);
    r->absent[r->absent_count++] = (absent_member){row, r->surface, normal};
    json_put_null(normal, spec_row_key(row));
}

/* Adds a fault at this place; the caller sets its text. NULL: there are too many. */
static spec_fault *add(reading *r, const json_at *at)
{
    r->total++;
    if (r->faults.count == SPEC_MAX_FAULTS) return NULL;
    spec_fault *fault = &r->faults.item[r->faults.count++];
    json_pointer(at, fault->pointer, sizeof fault->pointer);
    fault->code = ERROR_SPEC_INVALID;
    return fault;
}

void reading_add_fault(reading *r, const json_at *at, const char *format, ...)
{
    spec_fault *fault = add(r, at);
    va_list arguments;
    va_start(arguments, format);
    if (fault) vsnprintf(fault->detail, sizeof fault->detail, format, arguments);
    va_end(arguments);
}

void reading_add_missing_part(reading *r, const json_at *at, const char *why)
{
    const size_t before = r->faults.count;
    reading_add_fault(r, at, "is not supported: %s", why);
    if (r->faults.count > before) r->faults.item[before].code = ERROR_NOT_SUPPORTED;
}

void reading_shorten(const char *text, char out[READING_SHOWN_MAX + 4])
{
    size_t n = strlen(text);
    if (n <= READING_SHOWN_MAX) {
        memcpy(out, text, n + 1);
        return;
    }
    n = READING_SHOWN_MAX;
    while (n > 0 && ((unsigned char)text[n] & 0xC0) == 0x80) n--;
    memcpy(out, text, n);
    memcpy(out + n, "...", 4);
}

/* The value in a message: "7", "\"abc\"", "an object". */
static void describe(json_at at, char out[READING_SHOWN_MAX + 8])
{
    char *text;
    switch (json_type_of(at)) {
    case JSON_OBJECT:
        strcpy(out, "an object");
        return;
    case JSON_ARRAY:
        snprintf(out, READING_SHOWN_MAX + 8, "an array of %zu", json_size(at));
        return;
    default:
        text = json_print(at.node);
        reading_shorten(text, out);
        free(text);
    }
}

void reading_add_mismatch(reading *r, const json_at *at, const char *format, ...)
{
    char given[READING_SHOWN_MAX + 8];
    spec_fault *fault = add(r, at);
    if (!fault) return;
    va_list arguments;
    va_start(arguments, format);
    const int begin = snprintf(fault->detail, sizeof fault->detail, "%s", at->node ? "" : "is required and ");
    vsnprintf(fault->detail + begin, sizeof fault->detail - (size_t)begin, format, arguments);
    va_end(arguments);
    if (!at->node) return;
    const size_t length = strlen(fault->detail);
    describe(*at, given);
    snprintf(fault->detail + length, sizeof fault->detail - length, " (given %s)", given);
}

static void describe_range(const spec_row *row, char *out, size_t size)
{
    if (row->low == row->high)
        snprintf(out, size, "%.16g", row->low);
    else if (row->flags & SPEC_LOW_OPEN)
        snprintf(out, size, "above %.16g and at most %.16g", row->low, row->high);
    else
        snprintf(out, size, "%sfrom %.16g to %.16g", row->flags & SPEC_OR_ZERO ? "0 or " : "", row->low,
                 row->high);
}

/* Whether the unit is stated after a number: not units of the world or of a file. */
static bool is_measure(const char *unit)
{
    return !strstr(unit, "world") && strncmp(unit, "the ", 4) != 0 && strcmp(unit, "time") != 0;
}

void reading_add_wrong_value(reading *r, const json_at *at, const spec_row *row, const char *kind)
{
    char range[96];
    const bool has_unit = row->unit && is_measure(row->unit);
    describe_range(row, range, sizeof range);
    if (row->low == row->high)
        reading_add_mismatch(r, at, "must be %s", range);
    else
        reading_add_mismatch(r, at, "must be %s %s%s%s", kind, range, has_unit ? " " : "",
                             has_unit ? row->unit : "");
}
