// SPDX-License-Identifier: Apache-2.0
#include "service/config/config_table.h"

#include "base/core/worker_contract.h"
#include "service/config/config.h"

#define SETTING(member, type_, rank_, ...)   \
    {.key = #member,                         \
     .offset = offsetof(config, member),     \
     .size = sizeof((config *)NULL)->member, \
     .type = CONFIG_##type_,                 \
     .rank = OPTION_##rank_,                 \
     __VA_ARGS__},

const config_row config_table[] = {
#include "service/config/settings.h"
};

const size_t config_table_size = sizeof config_table / sizeof *config_table;
