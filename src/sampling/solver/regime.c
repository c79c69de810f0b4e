// SPDX-License-Identifier: Apache-2.0
#include "sampling/solver/regime.h"

static const regime under_resolved = {.name = "under_resolved",
                                      .schedule = &schedule_multilevel,
                                      .fast_kernel = true,
                                      .is_under_resolved = true,
                                      .spreads_points = true};
static const regime continued_under_resolved = {.name = "continued_under_resolved",
                                                .schedule = &schedule_continued,
                                                .fast_kernel = true,
                                                .is_continued = true,
                                                .is_under_resolved = true,
                                                .goes_on_after_projection = true};
static const regime continued_with_longer_steps = {.name = "continued_with_longer_steps",
                                                   .schedule = &schedule_eased,
                                                   .fast_kernel = true,
                                                   .is_continued = true,
                                                   .goes_on_after_projection = true};
static const regime paper = {
    .name = "paper", .schedule = &schedule_paper, .fills_gaps = true, .goes_on_after_projection = true};
static const regime multilevel = {.name = "multilevel",
                                  .schedule = &schedule_multilevel,
                                  .fast_kernel = true,
                                  .repairs_defects = true,
                                  .fills_gaps = true,
                                  .goes_on_after_projection = true,
                                  .under_resolved = &under_resolved};
static const regime continued = {.name = "continued",
                                 .schedule = &schedule_continued,
                                 .fast_kernel = true,
                                 .is_continued = true,
                                 .goes_on_after_projection = true,
                                 .under_resolved = &continued_under_resolved,
                                 .with_longer_steps = &continued_with_longer_steps};
static const regime continued_paper = {.name = "continued_paper",
                                       .schedule = &schedule_packed,
                                       .is_continued = true,
                                       .goes_on_after_projection = true};
static const regime blue_noise = {.name = "blue_noise", .schedule = &schedule_paper};
static const regime witkin_heckbert = {.name = "witkin_heckbert", .schedule = &schedule_paper};

const regime *regime_for(const solver_params *params)
{
    const bool is_continued = params->start == SOLVER_START_GIVEN,
               is_cotangent = !params->energy || params->energy == &energy_cotangent,
               fast = params->coarse_to_fine && is_cotangent && !params->gradient;
    if (params->witkin_heckbert) return &witkin_heckbert;
    if (params->blue_noise) return &blue_noise;
    if (is_continued) return fast ? &continued : &continued_paper;
    return fast ? &multilevel : &paper;
}
