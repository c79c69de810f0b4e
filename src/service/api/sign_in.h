// SPDX-License-Identifier: Apache-2.0
/* sign_in: the handlers that sign a browser in and out, and show the identity and scopes of the caller.
 *
 * The cookie of a session has no attribute Path, so browsers send it only to routes below the parent of this
 * route (/v1), also behind a proxy that adds a prefix. It is Secure if the Origin of the page that signs in
 * has the scheme https.
 */
#ifndef HEXAD_SERVICE_API_SIGN_IN_H
#define HEXAD_SERVICE_API_SIGN_IN_H

#include "service/api/context.h"

http_handler sign_in_begin, sign_in_end, sign_in_show;

#endif
