/* body_bytes: counts the memory of bodies of requests, or of answers, in total and for each user. The serving thread
 * calls all functions.
 */
#ifndef HEXAD_SERVICE_HTTP_BODY_BYTES_H
#define HEXAD_SERVICE_HTTP_BODY_BYTES_H

#include <stddef.h>

typedef struct body_bytes body_bytes;

typedef enum body_decision { BODY_FITS, BODY_TOO_MUCH_OF_USER, BODY_TOO_MUCH } body_decision;

/* Limits in bytes: `total` for all users, `of_user` for one user. Each user may take `of_each`, even if the total is
 * reached. */
body_bytes *body_bytes_new(size_t total, size_t of_user, size_t of_each);
void body_bytes_free(body_bytes *b); /* accepts NULL */

/* Counts `bytes` more for this user if the result is BODY_FITS. */
body_decision body_bytes_take(body_bytes *b, const char *user, size_t bytes);
void body_bytes_give_back(body_bytes *b, const char *user, size_t bytes);

#endif
