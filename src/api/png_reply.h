/* png_reply: a picture as the body of a reply. */
#ifndef HEXAD_API_PNG_REPLY_H
#define HEXAD_API_PNG_REPLY_H

#include "formats/canvas.h"
#include "http/reply.h"

/* Sets a reply of status 200: the picture as a PNG file in memory. Errors: internal; the reply is then unchanged. */
bool png_reply_set(reply *r, const canvas *picture, error *e);

#endif
