// SPDX-License-Identifier: Apache-2.0
#include "job/phases/progress.h"

#include <errno.h>
#include <math.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/core/clock.h"
#include "base/core/elementary.h"
#include "base/core/terminal_text.h"
#include "base/json/json.h"

const char *const progress_phase_names[PROGRESS_PHASES] = {PROGRESS_LIST(WORDS_TEXT, )};

static const int64_t INTERVAL_MS = 100;

/* End of each phase as a fraction of the job. Only the solver reports its own progress. Within PACE_S seconds
 * another phase covers two thirds of its range, asymptotically, so that progress is visible from the first
 * second. */
static const double phase_end[PROGRESS_PHASES] = {0.3, 0.4, 0.92, 0.95, 0.96, 0.97, 1};
static const double PACE_S = 4;

void progress_begin(progress *p, int fd, bool bar, progress_listener listener)
{
    int64_t now = clock_monotonic_ms();
    *p = (progress){
        .fd = fd, .bar = bar, .listener = listener, .start_ms = now, .entered_ms = now, .phase = -1};
    pthread_mutex_init(&p->lock, NULL);
}

/* The completed fraction of the job, 0 .. 1; never decreases. */
static double whole_fraction(const progress *p, const progress_numbers *n, int64_t now)
{
    double spent = clock_seconds(now - p->entered_ms);
    double inner =
        p->phase == PROGRESS_RELAX ? fmin(fmax(n->fraction, 0), 1) : 1 - elementary_exp(-spent / PACE_S);
    return fmax(p->fraction, p->entered + (phase_end[p->phase] - p->entered) * inner);
}

/* A line is shorter than PIPE_BUF: it is written completely or not at all. */
static void write_line(int fd, const char *text)
{
    struct pollfd ready = {fd, POLLOUT, 0};
    if (poll(&ready, 1, 0) != 1 || !(ready.revents & POLLOUT)) return;
    while (write(fd, text, strlen(text)) < 0 && errno == EINTR) continue;
}

static void draw_bar(const progress *p, const progress_numbers *n, double elapsed_s)
{
    enum { WIDTH = 30 };
    char bar[WIDTH + 1];
    int filled = (int)(WIDTH * p->fraction);
    memset(bar, '.', WIDTH);
    memset(bar, '#', (size_t)filled);
    bar[WIDTH] = '\0';
    fputs("\r\033[K", stderr);
    terminal_text_print(stderr, "%-7s [%s] %3.0f %%", progress_phase_names[p->phase], bar, 100 * p->fraction);
    if (n->sweep > 0)
        fprintf(stderr, "  sweep %zu  energy %+.3f %%  step %.1e h", n->sweep, 100 * n->energy_excess,
                n->rms_step);
    fprintf(stderr, "  %.1f s", elapsed_s);
    fflush(stderr);
}

/* Steps of a reported fraction: more digits would be noise. */
#define FRACTION_STEPS 10000

static void report(progress *p, const progress_numbers *n)
{
    int64_t now = clock_monotonic_ms();
    double elapsed = clock_seconds(now - p->start_ms);
    p->written_ms = now;
    p->fraction = whole_fraction(p, n, now);
    if (p->bar) draw_bar(p, n, elapsed);
    if (p->listener.hear) p->listener.hear(p->listener.context, (progress_phase)p->phase, p->fraction, n);
    if (p->fd < 0) return;
    json *line = json_new_object();
    json_put_string(line, "phase", progress_phase_names[p->phase]);
    json_put_number(line, "fraction", round(FRACTION_STEPS * p->fraction) / FRACTION_STEPS);
    if (n->sweep > 0) {
        json_put_integer(line, "round", (int64_t)n->round);
        json_put_integer(line, "sweep", (int64_t)n->sweep);
        json_put_integer(line, "count", (int64_t)n->count);
        json_put_number(line, "energy_excess", n->energy_excess);
        json_put_number(line, "rms_step", n->rms_step);
        json_put_number(line, "mean_log10_lambda", n->mean_log10_lambda);
        double spent = clock_seconds(now - p->entered_ms);
        if (n->fraction > 0.02)
            json_put_number(line, "eta_s", clock_seconds(llround(1000 * spent * (1 / n->fraction - 1))));
    }
    json_put_number(line, "elapsed_s", elapsed);
    char *text = json_print(line), *with_end = NULL;
    if (asprintf(&with_end, "%s\n", text) > 0) write_line(p->fd, with_end);
    free(with_end);
    free(text);
    json_free(line);
}

static void leave(progress *p, int64_t now)
{
    if (p->phase >= 0) p->phase_ms[p->phase] += now - p->entered_ms;
    p->entered_ms = now;
}

void progress_enter(progress *p, progress_phase phase)
{
    pthread_mutex_lock(&p->lock);
    leave(p, clock_monotonic_ms());
    p->phase = (int)phase;
    /* a relaxation that converges early is complete; the fraction that a short loading leaves is divided
     * among later phases */
    p->entered = phase > PROGRESS_RELAX ? fmax(p->fraction, phase_end[phase - 1]) : p->fraction;
    p->last = (progress_numbers){0};
    report(p, &p->last);
    pthread_mutex_unlock(&p->lock);
}

static void report_if_due(progress *p)
{
    if ((p->fd >= 0 || p->bar || p->listener.hear) && p->phase >= 0 &&
        clock_monotonic_ms() - p->written_ms >= INTERVAL_MS)
        report(p, &p->last);
}

void progress_update(progress *p, const progress_numbers *numbers)
{
    pthread_mutex_lock(&p->lock);
    p->last = *numbers;
    report_if_due(p);
    pthread_mutex_unlock(&p->lock);
}

int64_t progress_tick(progress *p)
{
    pthread_mutex_lock(&p->lock);
    report_if_due(p);
    int64_t rest = p->written_ms + INTERVAL_MS - clock_monotonic_ms();
    pthread_mutex_unlock(&p->lock);
    return rest > 0 ? rest : INTERVAL_MS; /* no reader, or no line yet */
}

void progress_end(progress *p)
{
    pthread_mutex_lock(&p->lock);
    leave(p, clock_monotonic_ms());
    p->phase = -1;
    if (p->bar) fputs("\r\033[K", stderr);
    pthread_mutex_unlock(&p->lock);
}
