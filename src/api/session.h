/* session: the handlers that sign a browser in and out, and tell who asks.
 *
 * The cookie of a session has no Path, so browsers send it to what lies beside this route (/v1) and nowhere else, also
 * behind a proxy that adds a prefix. It is Secure when the page that signs in came by https, as its Origin says.
 */
#ifndef HEXAD_API_SESSION_H
#define HEXAD_API_SESSION_H

#include "api/context.h"

http_handler session_sign_in, session_sign_out, session_show;

#endif
