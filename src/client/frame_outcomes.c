/* frame_outcomes: prints the frames of an array whose results are unresolved or not converged. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

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
    fprintf(l->out, "%s%ld", ftell(l->out) > 0 ? ", " : "", l->first);
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
    if (*l->text) fprintf(file, "%s: frames %s\n", l->word, l->text);
    free(l->text);
}

int command_print_frame_outcomes(client *c, json_at job, FILE *file)
{
    frame_list lists[] = {{.outcome = "unresolved", .word = "unresolved", .first = 1},
                          {.outcome = "not_converged", .word = "not converged", .first = 1}};
    enum { LISTS = sizeof lists / sizeof *lists };
    const bool good = strcmp(json_string(json_member(&job, "outcome"), ""), "converged") == 0;
    double after = TASKS_FROM_THE_FIRST;
    int code = COMMAND_OK;
    if (!json_bool(json_member(&job, "array"), false) || !command_has_ended(job) || good) return COMMAND_OK;
    for (int k = 0; k < LISTS; k++) lists[k].out = open_memstream(&lists[k].text, &lists[k].size);
    for (json *page; (page = command_next_tasks(c, json_string(json_member(&job, "id"), ""), &after, &code));
         json_free(page)) {
        json_at root = json_root(page), tasks = json_member(&root, "tasks");
        for (size_t i = 0; i < json_size(tasks); i++) {
            json_at task = json_element(&tasks, i);
            const char *outcome = json_string(json_member(&task, "outcome"), "");
            for (int k = 0; k < LISTS; k++)
                if (strcmp(outcome, lists[k].outcome) == 0)
                    add_frame(&lists[k], (long)json_number(json_member(&task, "frame"), 0));
        }
    }
    for (int k = 0; k < LISTS; k++) print_frame_list(&lists[k], file);
    return code;
}
