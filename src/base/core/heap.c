// SPDX-License-Identifier: Apache-2.0
#include "base/core/heap.h"

#include "base/core/memory.h"

static bool comes_before(const heap_item *a, const heap_item *b)
{
    if (a->key != b->key) return a->key < b->key;
    return a->item != b->item ? a->item < b->item : a->of < b->of;
}

bool heap_push(heap *h, heap_item added, const char *what, error *e)
{
    if (!MEM_GROW(h->item, h->count, &h->room, what, e)) return false;
    size_t at = h->count++;
    for (size_t up; at > 0 && comes_before(&added, &h->item[up = (at - 1) / 2]); at = up)
        h->item[at] = h->item[up];
    h->item[at] = added;
    return true;
}

heap_item heap_pop(heap *h)
{
    const heap_item top = h->item[0], last = h->item[--h->count];
    size_t at = 0;
    for (size_t next; (next = 2 * at + 1) < h->count; at = next) {
        if (next + 1 < h->count && comes_before(&h->item[next + 1], &h->item[next])) next++;
        if (!comes_before(&h->item[next], &last)) break;
        h->item[at] = h->item[next];
    }
    h->item[at] = last;
    return top;
}
