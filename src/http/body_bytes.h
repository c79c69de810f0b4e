/* body_bytes: the memory that bodies of requests or of answers take, of all together and of each user. The serving
 * thread calls all functions. */
#ifndef HEXAD_HTTP_BODY_BYTES_H
#define HEXAD_HTTP_BODY_BYTES_H

#include <stddef.h>

typedef struct body_bytes body_bytes;

typedef enum body_decision { BODY_FITS, BODY_TOO_MUCH_OF_USER, BODY_TOO_MUCH } body_decision;

/* Each user may take `of_each`, also when the total is used up. */
body_bytes *body_bytes_new(size_t total, size_t of_user, size_t of_each);
void body_bytes_free(body_bytes *b); /* accepts NULL */

/* Takes room for `bytes` more of this user, on BODY_FITS. */
body_decision body_bytes_take(body_bytes *b, const char *user, size_t bytes);
void body_bytes_give_back(body_bytes *b, const char *user, size_t bytes);

#endif
