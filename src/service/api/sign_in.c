// SPDX-License-Identifier: Apache-2.0
#include "service/api/sign_in.h"

#include <stdlib.h>
#include <string.h>

#include "service/api/job_json.h"
#include "base/core/memory.h"

static void show(const access_caller *caller, reply *r)
{
    json *document = json_new_object();
    json_put_string(document, "user", *caller->user ? caller->user : NULL);
    json *scopes = json_put_array(document, "scopes");
    for (unsigned scope = SCOPE_READ; scope <= SCOPE_ADMIN; scope <<= 1)
        if (caller->scopes & scope) json_append_string(scopes, scope_name(scope));
    job_json_put_time(document, "ends", caller->session_ends_ms);
    reply_set_json(r, 200, document);
}

static void set_cookie(const http_context *c, const http_request *request, const char *session,
                       int64_t seconds, reply *r)
{
    const char *origin = request->header[HTTP_ORIGIN];
    bool secure = origin && strncmp(origin, "https://", 8) == 0;
    char *cookie =
        mem_printf("%s=%s; Max-Age=%lld; HttpOnly; SameSite=Strict%s", access_session_cookie(c->access),
                   session, (long long)seconds, secure ? "; Secure" : "");
    reply_add_header(r, "Set-Cookie", cookie);
    free(cookie);
}

void sign_in_show(const http_context *c, const http_request *request, reply *r)
{
    (void)c;
    show(request->caller, r);
}

void sign_in_begin(const http_context *c, const http_request *request, reply *r)
{
    error e = {0};
    json *body = json_parse(request->body, request->length, &e);
    json_at root = json_root(body);
    const char *shown = json_string(json_member(&root, "token"), NULL);
    char session[SESSION_SIZE];
    access_caller caller;
    if (!body)
        reply_set_problem(r, "json_invalid", NULL, "%s", e.message);
    else if (!*access_session_cookie(c->access))
        reply_set_problem(
            r, "not_found", NULL,
            "this service has no sessions, because the setting page is 0: send a token with each "
            "request");
    else if (!shown)
        reply_set_problem(r, "request_invalid", NULL, "the body must be {\"token\": \"hexad_...\"}");
    else if (!access_begin_session(c->access, shown, session, &caller))
        reply_set_problem(r, "unauthorized", NULL, ACCESS_TOKEN_UNKNOWN);
    else {
        show(&caller, r);
        set_cookie(c, request, session, (int64_t)c->session_s, r);
    }
    json_free(body);
}

void sign_in_end(const http_context *c, const http_request *request, reply *r)
{
    reply_set_empty(r, 204);
    if (*access_session_cookie(c->access)) set_cookie(c, request, "", 0, r);
}
