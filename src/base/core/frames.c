// SPDX-License-Identifier: Apache-2.0
#include "base/core/frames.h"

#include <assert.h>
#include <ctype.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/compare.h"
#include "base/core/memory.h"
#include "base/core/worker_contract.h"

enum { DIGITS_MOST = 9 };

/* Parses a number and advances *at. False: there is none. */
static bool read_number(const char **at, int *number)
{
    size_t digits = strspn(*at, "0123456789");
    if (digits < 1 || digits > DIGITS_MOST) return false;
    *number = (int)strtol(*at, NULL, 10);
    *at += digits;
    return true;
}

static bool skip(const char **at, char c)
{
    if (**at != c) return false;
    ++*at;
    return true;
}

/* A number that occurs twice, or -1. */
static int find_repeated(const int *numbers, size_t count)
{
    int repeated = -1;
    int *sorted = mem_alloc((count + 1) * sizeof *sorted);
    memcpy(sorted, numbers, count * sizeof *sorted);
    qsort(sorted, count, sizeof *sorted, compare_ints);
    for (size_t i = 1; i < count && repeated < 0; i++)
        if (sorted[i] == sorted[i - 1]) repeated = sorted[i];
    free(sorted);
    return repeated;
}

/* Parses one part between commas. */
static bool read_range(const char **at, int *first, int *last, int *step)
{
    *step = 1;
    if (!read_number(at, first)) return false;
    *last = *first;
    if (!skip(at, '-')) return true;
    return read_number(at, last) && *last >= *first &&
           (!skip(at, 'x') || (read_number(at, step) && *step > 0));
}

int *frames_parse(const char *text, size_t *count, error *e)
{
    int *numbers = mem_alloc(FRAMES_MOST * sizeof *numbers);
    size_t used = 0;
    bool ok = true;
    const char *at = text;
    do {
        int first, last, step;
        ok = read_range(&at, &first, &last, &step) && (!*at || *at == ',');
        if (!ok) {
            error_set(
                e, ERROR_SPEC_INVALID,
                "must be a list such as \"7\", \"1-100\", \"1-100x2\" or \"1-10,20\" (given \"%.100s\")",
                text);
            break;
        }
        for (int64_t n = first; ok && n <= last; n += step) {
            if (used < FRAMES_MOST)
                numbers[used++] = (int)n;
            else
                ok = error_set(e, ERROR_SPEC_INVALID, "a job has at most %d frames: submit several jobs",
                               FRAMES_MOST);
        }
    } while (ok && skip(&at, ','));
    int repeated = ok ? find_repeated(numbers, used) : -1;
    if (repeated >= 0)
        ok = error_set(e, ERROR_SPEC_INVALID, "frame %d is listed twice: remove one", repeated);
    if (!ok) {
        free(numbers);
        return NULL;
    }
    *count = used;
    return numbers;
}

/* The number of numbers from `numbers` on that have equal steps. */
static size_t count_steps(const int *numbers, size_t count)
{
    size_t used = count < 2 ? count : 2;
    while (used < count && numbers[used] - numbers[used - 1] == numbers[1] - numbers[0]) used++;
    return used;
}

char *frames_print(const int *numbers, size_t count)
{
    char *text = NULL;
    size_t size = 0;
    FILE *out = open_memstream(&text, &size);
    for (size_t i = 0, used; i < count; i += used) {
        used = count_steps(numbers + i, count - i);
        int step = used > 1 ? numbers[i + 1] - numbers[i] : 1;
        if (used == 2 && step > 1) used = 1;
        fprintf(out, "%s%d", i ? "," : "", numbers[i]);
        if (used > 1) fprintf(out, "-%d", numbers[i + used - 1]);
        if (step > 1 && used > 1) fprintf(out, "x%d", step);
    }
    fclose(out);
    return text;
}

/* The length of "%04d" or "%d" at the start of the text, and the minimum number of digits; 0: it is
 * something else. */
static size_t match_conversion(const char *at, int *digits)
{
    bool wide = at[1] == '0' && at[2] >= '1' && at[2] <= '9';
    if (at[wide ? 3 : 1] != 'd') return 0;
    *digits = wide ? at[2] - '0' : 1;
    return wide ? 4 : 2;
}

/* Likewise for Houdini's "$F4" or "$F", but not for its other variables ("$FF", "$FPS", "$FSTART"). */
static size_t match_variable(const char *at, int *digits)
{
    if (at[1] != 'F') return 0;
    bool wide = at[2] >= '1' && at[2] <= '9';
    size_t length = wide ? 3 : 2;
    if (isalnum((unsigned char)at[length])) return 0;
    *digits = wide ? at[2] - '0' : 1;
    return length;
}

/* The position of the number in the path, and its minimum number of digits; NULL: there is none. */
static const char *find_pattern(const char *path, size_t *length, int *digits)
{
    for (const char *at = path; *at; at++) {
        size_t marks = strspn(at, "#");
        if (marks) {
            *length = marks;
            *digits = (int)marks;
            return at;
        }
        *length = *at == '%' ? match_conversion(at, digits) : *at == '$' ? match_variable(at, digits) : 0;
        if (*length) return at;
    }
    return NULL;
}

/* The next place of the same notation, for the same number; NULL: there is none. */
static const char *find_same(const char *path, const char *notation, size_t length)
{
    size_t own;
    int digits;
    const char *at = find_pattern(path, &own, &digits);
    while (at && (own != length || memcmp(at, notation, length) != 0))
        at = find_pattern(at + own, &own, &digits);
    return at;
}

bool frames_is_pattern(const char *path)
{
    size_t length;
    int digits;
    return find_pattern(path, &length, &digits) != NULL;
}

char *frames_path(const char *path, int frame)
{
    size_t length = 0;
    int digits = 0;
    const char *at = find_pattern(path, &length, &digits);
    char *out = mem_printf("%.*s", at ? (int)(at - path) : (int)strlen(path), path);
    while (at) {
        const char *rest = at + length, *next = find_same(rest, at, length);
        char *longer =
            mem_printf("%s%0*d%.*s", out, digits, frame, next ? (int)(next - rest) : (int)strlen(rest), rest);
        free(out);
        out = longer;
        at = next;
    }
    return out;
}

char **frames_paths(const char *pattern, const int *numbers, size_t count)
{
    assert(frames_is_pattern(pattern));
    char **paths = mem_alloc((count + 1) * sizeof *paths);
    for (size_t k = 0; k < count; k++) paths[k] = frames_path(pattern, numbers[k]);
    return paths;
}

size_t frames_prefix(const char *pattern)
{
    size_t length;
    int digits;
    const char *at = find_pattern(pattern, &length, &digits);
    assert(at);
    return (size_t)(at - pattern);
}

size_t frames_shared(const char *pattern)
{
    size_t length = frames_prefix(pattern);
    while (length > 0 && pattern[length - 1] != '/') length--;
    return length;
}

char *frames_above(const char *pattern)
{
    size_t length = frames_is_pattern(pattern) ? frames_shared(pattern) : 0;
    return length > 1 ? mem_strndup(pattern, length - 1) : NULL;
}

bool frames_is_stage(const char *name)
{
    size_t length = strlen(name), ending = strlen(WORKER_STAGE_ENDING);
    return length > ending && strcmp(name + length - ending, WORKER_STAGE_ENDING) == 0;
}

bool frames_match(const char *pattern, const char *path, int *frame)
{
    int number;
    size_t prefix = frames_prefix(pattern);
    if (strncmp(pattern, path, prefix) != 0) return false;
    const char *at = path + prefix;
    if (!read_number(&at, &number)) return false;
    char *own = frames_path(pattern, number);
    bool same = strcmp(own, path) == 0;
    free(own);
    if (same) *frame = number;
    return same;
}
