// SPDX-License-Identifier: Apache-2.0
/* png_reply: sends a picture as a PNG file. No state; any thread. */
#ifndef HEXAD_SERVICE_API_PNG_REPLY_H
#define HEXAD_SERVICE_API_PNG_REPLY_H

#include "io/pictures/canvas.h"
#include "service/http/reply.h"

/* Encodes the picture in memory and sets a reply of status 200. Error: internal; the reply is then
 * unchanged. */
bool png_reply_set(reply *r, const canvas *picture, error *e);

#endif
