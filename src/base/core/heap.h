// SPDX-License-Identifier: Apache-2.0
/* heap: a priority queue of numbered items, a binary heap. One thread. */
#ifndef HEXAD_BASE_CORE_HEAP_H
#define HEXAD_BASE_CORE_HEAP_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/core/error.h"

typedef struct heap_item {
    double key;
    uint32_t item, of;
} heap_item;

/* A zeroed struct is empty. The caller frees `item`. */
typedef struct heap {
    heap_item *item;
    size_t count, room;
} heap;

/* Error: limit_memory; the message contains `what`. */
bool heap_push(heap *h, heap_item added, const char *what, error *e);

/* Removes the item with the least key; among equal keys that with the least `item`, then `of`. h->count > 0. */
heap_item heap_pop(heap *h);

#endif
