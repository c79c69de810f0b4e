/* tuned_schedule: the schedules of the worker, with numbers scaled by the environment: HEXAD_SCHEDULE="omega=2,stage_step.1=0.5" doubles
 * one number of all schedules and halves another. Linked into a worker of its own for tools/sensitivity.py. */
#define SCHEDULE_STORAGE
#include "solver/schedule.c" /* NOLINT: the same tables, not constant */

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

typedef struct number {
    const char *name;
    size_t offset;
    bool is_integer;
} number;

#define REAL(member, name)                      \
    {                                           \
        name, offsetof(schedule, member), false \
    }
#define WHOLE(member, name)                    \
    {                                          \
        name, offsetof(schedule, member), true \
    }

static const number NUMBERS[] = {
    REAL(gain[0], "gain.0"),
    REAL(gain[1], "gain.1"),
    REAL(gain[2], "gain.2"),
    WHOLE(patience[0], "patience.0"),
    WHOLE(patience[1], "patience.1"),
    WHOLE(patience[2], "patience.2"),
    WHOLE(patience_more, "patience_more"),
    WHOLE(patience_last, "patience_last"),
    REAL(coarsest_gain, "coarsest_gain"),
    REAL(omega, "omega"),
    REAL(omega_shake, "omega_shake"),
    REAL(omega_shake_sized, "omega_shake_sized"),
    REAL(omega_least, "omega_least"),
    REAL(longest_step, "longest_step"),
    WHOLE(shake_sweeps, "shake_sweeps"),
    REAL(sweeps, "sweeps"),
    REAL(sweeps_count, "sweeps_count"),
    REAL(sweeps_fall, "sweeps_fall"),
    REAL(sweeps_least, "sweeps_least"),
    REAL(sweeps_most, "sweeps_most"),
    REAL(defects_count, "defects_count"),
    REAL(defects_sweeps[0], "defects_sweeps.0"),
    REAL(defects_sweeps[1], "defects_sweeps.1"),
    REAL(defects_share[0][0], "defects_share.0.0"),
    REAL(defects_share[0][1], "defects_share.0.1"),
    REAL(defects_share[1][0], "defects_share.1.0"),
    REAL(defects_share[1][1], "defects_share.1.1"),
    REAL(finest_rest, "finest_rest"),
    REAL(rest_lambda, "rest_lambda"),
    REAL(level_step, "level_step"),
    REAL(stage_step[0], "stage_step.0"),
    REAL(stage_step[1], "stage_step.1"),
    REAL(stage_step[2], "stage_step.2"),
    WHOLE(level_sweeps, "level_sweeps"),
    WHOLE(stage_sweeps_most, "stage_sweeps_most"),
    REAL(size_settled, "size_settled"),
    WHOLE(resizes_most, "resizes_most"),
    REAL(limited_share, "limited_share"),
    REAL(limited_share_coarse, "limited_share_coarse"),
    WHOLE(limited_wait, "limited_wait"),
    REAL(skin_wide, "skin_wide"),
    REAL(skin_narrow, "skin_narrow"),
    REAL(skin_steps, "skin_steps"),
    REAL(divergent_share, "divergent_share"),
    WHOLE(new_part_sweeps, "new_part_sweeps"),
};

/* Scales a number of one schedule. Schedules that do not use it hold 0 or infinity, which stay. */
static void scale(schedule *s, const number *n, double factor)
{
    char *at = (char *)s + n->offset;
    if (n->is_integer)
        *(int *)(void *)at = (int)round(*(int *)(void *)at * factor);
    else
        *(double *)(void *)at *= factor;
}

static void scale_all(const char *name, double factor)
{
    for (size_t k = 0; k < sizeof NUMBERS / sizeof *NUMBERS; k++) {
        if (strcmp(NUMBERS[k].name, name) != 0) continue;
        schedule *all[] = {&schedule_paper, &schedule_packed, &schedule_multilevel, &schedule_continued};
        for (size_t i = 0; i < sizeof all / sizeof *all; i++) scale(all[i], &NUMBERS[k], factor);
        return;
    }
    fprintf(stderr, "HEXAD_SCHEDULE: there is no number %s\n", name);
    exit(2);
}

__attribute__((constructor)) static void read_environment(void)
{
    char *text = getenv("HEXAD_SCHEDULE"), *state = NULL;
    for (char *part = text ? strtok_r(text, ",", &state) : NULL; part; part = strtok_r(NULL, ",", &state)) {
        char *value = strchr(part, '=');
        if (!value) {
            fprintf(stderr, "HEXAD_SCHEDULE: %s lacks a factor\n", part);
            exit(2);
        }
        *value = '\0';
        scale_all(part, atof(value + 1));
    }
}
