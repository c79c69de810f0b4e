#include "service/http/body_bytes.h"

#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"

/* The bytes of one user; freed when they are 0. */
typedef struct share {
    char *user;
    size_t bytes;
    struct share *next;
} share;

struct body_bytes {
    size_t total, of_user, of_each; /* limits */
    size_t taken;
    share *shares;
};

body_bytes *body_bytes_new(size_t total, size_t of_user, size_t of_each)
{
    body_bytes *b = mem_alloc(sizeof *b);
    b->total = total;
    b->of_user = of_user;
    b->of_each = of_each;
    return b;
}

void body_bytes_free(body_bytes *b)
{
    if (!b) return;
    for (share *s = b->shares, *next; s; s = next) {
        next = s->next;
        free(s->user);
        free(s);
    }
    free(b);
}

/* The link to the entry of a user, or the end of the list. */
static share **find(body_bytes *b, const char *user)
{
    share **at = &b->shares;
    while (*at && strcmp((*at)->user, user) != 0) at = &(*at)->next;
    return at;
}

body_decision body_bytes_take(body_bytes *b, const char *user, size_t bytes)
{
    share **at = find(b, user);
    size_t has = *at ? (*at)->bytes : 0;
    if (bytes > b->of_user - has) return BODY_TOO_MUCH_OF_USER;
    if (b->taken + bytes > b->total && has + bytes > b->of_each) return BODY_TOO_MUCH;
    if (!*at) {
        *at = mem_alloc(sizeof **at);
        (*at)->user = mem_strdup(user);
    }
    (*at)->bytes += bytes;
    b->taken += bytes;
    return BODY_FITS;
}

void body_bytes_give_back(body_bytes *b, const char *user, size_t bytes)
{
    share **at = find(b, user);
    if (!bytes) return;
    b->taken -= bytes;
    (*at)->bytes -= bytes;
    if ((*at)->bytes) return;
    share *gone = *at;
    *at = gone->next;
    free(gone->user);
    free(gone);
}
