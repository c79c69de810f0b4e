// SPDX-License-Identifier: Apache-2.0
/* The frames of an array whose results are not good: lists of frames by outcome, the notes of the first ones,
 * and each warning once, with its frames. */
#include <ctype.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"
#include "base/core/terminal_text.h"
#include "client/command.h"
#include "client/print.h"

/* A list of frames as text, "3, 7-12". */
typedef struct frame_list {
    const char *outcome, *word;
    FILE *out; /* writes `text` */
    char *text;
    size_t size;
    long first, last; /* the range that is not yet written; first > last: none */
} frame_list;

static void write_range(frame_list *l)
{
    if (l->first > l->last) return;
    terminal_text_print(l->out, "%s%ld", ftell(l->out) > 0 ? ", " : "", l->first);
    if (l->last > l->first) fprintf(l->out, "-%ld", l->last);
}

static void add_frame(frame_list *l, long frame)
{
    if (l->first > l->last || frame != l->last + 1) {
        write_range(l);
        l->first = frame;
    }
    l->last = frame;
}

static void close_frame_list(frame_list *l)
{
    write_range(l);
    fclose(l->out);
}

static void print_frame_list(frame_list *l, FILE *file)
{
    close_frame_list(l);
    if (*l->text) terminal_text_print(file, "%s: frames %s\n", l->word, l->text);
    free(l->text);
}

/* The maximum number of frames whose notes are printed, and of warnings. */
enum { FRAMES_SHOWN = 10, WARNINGS_SHOWN = 10 };

/* A warning of one or more frames. Texts that differ in their numbers only are one warning. */
typedef struct shared_warning {
    char *text; /* of the first frame */
    bool varies;
    frame_list frames;
} shared_warning;

typedef struct shared_warnings {
    shared_warning item[WARNINGS_SHOWN];
    size_t count;
    bool more; /* there are further warnings */
} shared_warnings;

/* The first character that is no part of a number. */
static const char *skip_number(const char *text)
{
    while (isdigit((unsigned char)*text) || (*text == '.' && isdigit((unsigned char)text[1]))) text++;
    return text;
}

/* Whether two texts are the same apart from their numbers. */
static bool is_alike(const char *a, const char *b)
{
    while (*a && *b) {
        if (isdigit((unsigned char)*a) && isdigit((unsigned char)*b)) {
            a = skip_number(a);
            b = skip_number(b);
        } else if (*a++ != *b++) {
            return false;
        }
    }
    return *a == *b;
}

static void add_warning(shared_warnings *w, const char *text, long frame)
{
    size_t i = 0;
    while (i < w->count && !is_alike(w->item[i].text, text)) i++;
    if (i == WARNINGS_SHOWN) {
        w->more = true;
        return;
    }
    shared_warning *shared = &w->item[i];
    if (i == w->count) {
        w->count++;
        *shared = (shared_warning){.text = mem_strdup(text), .frames = {.first = 1, .last = -1}};
        shared->frames.out = open_memstream(&shared->frames.text, &shared->frames.size);
    }
    shared->varies |= strcmp(shared->text, text) != 0;
    if (shared->frames.last != frame) add_frame(&shared->frames, frame); /* a frame may have it twice */
}

static void add_warnings(shared_warnings *w, json_at task)
{
    json_at notes = json_member(&task, "notes"), warnings = json_member(&notes, "warnings");
    const long frame = (long)json_number(json_member(&task, "frame"), 0);
    for (json_at warning = json_first(&warnings); warning.node; warning = json_next(&warning))
        add_warning(w, json_string(warning, "?"), frame);
}

static void print_warnings(shared_warnings *w, FILE *file)
{
    for (size_t i = 0; i < w->count; i++) {
        shared_warning *shared = &w->item[i];
        close_frame_list(&shared->frames);
        terminal_text_print(file, "warning: frame%s %s: ", strpbrk(shared->frames.text, ",-") ? "s" : "",
                            shared->frames.text);
        terminal_text_put(file, shared->text);
        if (shared->varies) fputs(" (the numbers are those of the first frame)", file);
        fputc('\n', file);
        free(shared->text);
        free(shared->frames.text);
    }
    if (w->more) fputs("and more warnings: the reports of the frames have them\n", file);
}

/* Appends a text behind a separator. */
static void add_note(FILE *line, const char *text)
{
    fputs("; ", line);
    terminal_text_put(line, text);
}

/* Writes the outcome of a frame, the ratings that are not good, and why it is unresolved or not converged.
 * Returns whether there is more than the outcome converged. */
static bool write_frame(json_at task, FILE *line)
{
    json_at notes = json_member(&task, "notes"), ratings = json_member(&notes, "ratings"),
            reasons = json_member(&notes, "outcome_reasons");
    const char *outcome = json_string(json_member(&task, "outcome"), NULL);
    if (!outcome) return false; /* it failed, or was cancelled */
    fprintf(line, "frame %.0f: ", json_number(json_member(&task, "frame"), 0));
    terminal_text_put(line, outcome);
    const long before = ftell(line);
    for (json_at item = json_first(&ratings); item.node; item = json_next(&item)) {
        const char *rating = json_string(json_member(&item, "rating"), "good");
        if (strcmp(rating, "good") == 0) continue;
        terminal_text_print(line, ", %s %.3g ", item.key, json_number(json_member(&item, "value"), 0));
        terminal_text_put(line, rating);
    }
    for (json_at reason = json_first(&reasons); reason.node; reason = json_next(&reason)) {
        add_note(line, json_string(json_member(&reason, "message"), "?"));
    }
    return ftell(line) > before || strcmp(outcome, "converged") != 0;
}

/* Adds the line of a frame that is not good to the text. */
static void add_frame_line(json_at task, size_t *noted, FILE *text)
{
    char *line = NULL;
    size_t size = 0;
    FILE *out = open_memstream(&line, &size);
    const bool worth = write_frame(task, out);
    fclose(out);
    if (worth && (*noted)++ < FRAMES_SHOWN) terminal_text_print(text, "%s\n", line);
    free(line);
}

int command_print_frame_outcomes(client *c, json_at job, FILE *file)
{
    frame_list lists[] = {{.outcome = "unresolved", .word = "unresolved", .first = 1},
                          {.outcome = "not_converged", .word = "not converged", .first = 1}};
    enum { LISTS = sizeof lists / sizeof *lists };
    char *lines = NULL;
    size_t size = 0, noted = 0;
    shared_warnings warnings = {.count = 0};
    double after = TASKS_FROM_THE_FIRST;
    int code = COMMAND_OK;
    if (!json_bool(json_member(&job, "array"), false) || !command_has_ended(job)) return COMMAND_OK;
    FILE *text = open_memstream(&lines, &size);
    for (int k = 0; k < LISTS; k++) lists[k].out = open_memstream(&lists[k].text, &lists[k].size);
    for (json *page; (page = command_next_tasks(c, json_string(json_member(&job, "id"), ""), &after, &code));
         json_free(page)) {
        json_at root = json_root(page), tasks = json_member(&root, "tasks");
        for (json_at task = json_first(&tasks); task.node; task = json_next(&task)) {
            const char *outcome = json_string(json_member(&task, "outcome"), "");
            for (int k = 0; k < LISTS; k++)
                if (strcmp(outcome, lists[k].outcome) == 0)
                    add_frame(&lists[k], (long)json_number(json_member(&task, "frame"), 0));
            add_frame_line(task, &noted, text);
            add_warnings(&warnings, task);
        }
    }
    for (int k = 0; k < LISTS; k++) print_frame_list(&lists[k], file);
    fclose(text);
    fputs(lines, file);
    if (noted > FRAMES_SHOWN) fprintf(file, "and %zu more frames with notes\n", noted - FRAMES_SHOWN);
    print_warnings(&warnings, file);
    free(lines);
    return code;
}
