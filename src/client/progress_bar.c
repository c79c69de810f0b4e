#include "client/progress_bar.h"

#include <math.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

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

/* " sweep 12", where the job's progress has the member. */
static void print_member(json_at progress, const char *key, const char *format)
{
    double value = json_number(json_member(&progress, key), NAN);
    if (isfinite(value)) fprintf(stderr, format, value);
}

static void draw(json_at progress, const char *state, const char *phase)
{
    double fraction = json_number(json_member(&progress, "fraction"), 0);
    if (!(fraction >= 0)) fraction = 0;
    if (fraction > 1) fraction = 1;
    int full = (int)(fraction * BAR_WIDTH);
    fputs("\r\033[K[", stderr);
    for (int i = 0; i < BAR_WIDTH; i++) fputc(i < full ? '#' : '-', stderr);
    fprintf(stderr, "] %3.0f%% %s", fraction * 100, *phase ? phase : state);
    print_member(progress, "sweep", "  sweep %.0f");
    print_member(progress, "energy_excess", "  excess %.2g");
    print_member(progress, "eta_s", "  %.0f s left");
    fflush(stderr);
}

void progress_bar_show(progress_bar *b, json_at job)
{
    json_at progress = json_member(&job, "progress");
    const char *state = json_string(json_member(&job, "state"), "");
    const char *phase = json_string(json_member(&progress, "phase"), "");
    char now[sizeof b->last];
    snprintf(now, sizeof now, "%.20s%s%.20s", state, *phase ? ": " : "", phase);
    for (char *c = now; *c; c++)
        if ((unsigned char)*c < 0x20 || *c == 0x7F) *c = '?';
    if (b->terminal) {
        draw(progress, state, now + (*phase ? strlen(state) + 2 : 0));
        b->drawn = true;
    } else if (strcmp(now, b->last) != 0) {
        fprintf(stderr, "%s\n", now);
        strcpy(b->last, now);
    }
}
