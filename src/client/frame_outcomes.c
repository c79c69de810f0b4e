// SPDX-License-Identifier: Apache-2.0
/* The frames of an array whose results are not good: lists of frames by outcome, and the notes of the
 * first ones. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

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

static void print_frame_list(frame_list *l, FILE *file)
{
    write_range(l);
    fclose(l->out);
    if (*l->text) terminal_text_print(file, "%s: frames %s\n", l->word, l->text);
    free(l->text);
}

/* The maximum number of frames whose notes are printed. */
enum { FRAMES_SHOWN = 10 };

/* Appends a text behind a separator. */
static void add_note(FILE *line, const char *text)
{
    fputs("; ", line);
    terminal_text_put(line, text);
}

/* Writes the outcome of a frame, the ratings that are not good, why it is unresolved or not converged, and
 * its warnings. Returns whether there is more than the outcome converged. */
static bool write_frame(json_at task, FILE *line)
{
    json_at notes = json_member(&task, "notes"), ratings = json_member(&notes, "ratings"),
            reasons = json_member(&notes, "outcome_reasons"), warnings = json_member(&notes, "warnings");
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
    for (json_at warning = json_first(&warnings); warning.node; warning = json_next(&warning))
        add_note(line, json_string(warning, "?"));
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
        }
    }
    for (int k = 0; k < LISTS; k++) print_frame_list(&lists[k], file);
    fclose(text);
    fputs(lines, file);
    if (noted > FRAMES_SHOWN) fprintf(file, "and %zu more frames with notes\n", noted - FRAMES_SHOWN);
    free(lines);
    return code;
}
