// SPDX-License-Identifier: Apache-2.0
#include "client/progress_bar.h"

#include <math.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "base/core/terminal_text.h"
#include "client/print.h"

#define BAR_WIDTH 24

void progress_bar_init(progress_bar *b)
{
    *b = (progress_bar){.terminal = isatty(STDERR_FILENO) == 1};
}

void progress_bar_clear(progress_bar *b)
{
    if (b->drawn) fputs("\r\033[K", stderr);
    b->drawn = false;
}

/* Prints a member of the job's progress, such as " sweep 12", if it exists. */
static void print_member(json_at progress, const char *key, const char *format)
{
    double value = json_number(json_member(&progress, key), NAN);
    if (isfinite(value)) fprintf(stderr, format, value);
}

static void draw_bar(progress_bar *b, double fraction)
{
    if (!(fraction >= 0)) fraction = 0;
    if (fraction > 1) fraction = 1;
    int full = (int)(fraction * BAR_WIDTH);
    fputs("\r\033[K[", stderr);
    for (int i = 0; i < BAR_WIDTH; i++) fputc(i < full ? '#' : '-', stderr);
    fprintf(stderr, "] %3.0f%% ", floor(fraction * 100));
    b->drawn = true;
}

void progress_bar_show_text(progress_bar *b, const char *text)
{
    if (!b->terminal) return;
    fputs("\r\033[K", stderr);
    terminal_text_put(stderr, text);
    fflush(stderr);
    b->drawn = true;
}

void progress_bar_show_count(progress_bar *b, int done, int frames)
{
    if (!b->terminal) return;
    draw_bar(b, frames > 0 ? (double)done / frames : 0);
    fprintf(stderr, "%d of %d frames", done, frames);
    fflush(stderr);
}

/* Prints the number of ended frames of an array. Returns the completed share, including the running frame
 * whose progress is known. */
static double describe_array(json_at job, char *text, size_t size)
{
    json_at tasks = json_member(&job, "tasks"), progress = json_member(&job, "progress");
    double all = json_number(json_member(&tasks, "all"), 1),
           running = json_number(json_member(&tasks, "running"), 0),
           ended = all - running - json_number(json_member(&tasks, "waiting"), 0),
           good = json_number(json_member(&tasks, "succeeded"), 0);
    int used = snprintf(text, size, "%s: %.0f of %.0f frames", json_string(json_member(&job, "state"), ""),
                        ended, all);
    if (ended > good && used > 0 && (size_t)used < size)
        snprintf(text + used, size - (size_t)used, ", %.0f without success", ended - good);
    return (ended + json_number(json_member(&progress, "fraction"), 0)) / all;
}

static double describe_single(json_at job, char *text, size_t size)
{
    json_at progress = json_member(&job, "progress");
    const char *phase = json_string(json_member(&progress, "phase"), "");
    snprintf(text, size, "%.20s%s%.20s", json_string(json_member(&job, "state"), ""), *phase ? ": " : "",
             phase);
    return json_number(json_member(&progress, "fraction"), 0);
}

/* Prints the id of the job, and its name if it has one. */
static void print_identity(json_at job)
{
    const char *name = json_string(json_member(&job, "name"), "");
    terminal_text_put(stderr, json_string(json_member(&job, "id"), "?"));
    if (*name) {
        fputs(" (", stderr);
        terminal_text_put(stderr, name);
        fputc(')', stderr);
    }
    fputs(": ", stderr);
}

void progress_bar_show(progress_bar *b, json_at job)
{
    json_at progress = json_member(&job, "progress");
    char now[sizeof b->last];
    bool array = json_bool(json_member(&job, "array"), false);
    double fraction = array ? describe_array(job, now, sizeof now) : describe_single(job, now, sizeof now);
    if (b->terminal) {
        draw_bar(b, fraction);
        if (b->identify) print_identity(job);
        terminal_text_put(stderr, now);
        if (!array) {
            print_member(progress, "sweep", "  sweep %.0f");
            print_member(progress, "energy_excess", "  excess %.2g");
            print_member(progress, "eta_s", "  %.0f s left");
        }
        fflush(stderr);
    } else if (strcmp(now, b->last) != 0) {
        if (b->identify) print_identity(job);
        terminal_text_print(stderr, "%s\n", now);
        strcpy(b->last, now);
    }
}
