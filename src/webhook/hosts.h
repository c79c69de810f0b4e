/* hosts: the hosts whose webhooks this service may call.
 *
 * libcurl parses a URL both here and for the call, so that both mean the same host.
 * Immutable once read; any thread.
 */
#ifndef HEXAD_WEBHOOK_HOSTS_H
#define HEXAD_WEBHOOK_HOSTS_H

#include <stddef.h>

#include "base/error.h"

typedef struct webhook_hosts webhook_hosts;

/* Reads `HOST` (its ports 80 for http and 443 for https) or `HOST:PORT` from each text. NULL and an error
 * (spec_invalid) when one is not that. The caller releases with webhook_hosts_free, which accepts NULL. */
webhook_hosts *webhook_hosts_read(const char *const *texts, size_t count, error *e);
void webhook_hosts_free(webhook_hosts *hosts);

/* Whether a webhook may have this URL. Error spec_invalid: it is not http or https, it has a user or
 * password, or its host and port are not listed. `hosts` NULL: none is listed. */
bool webhook_hosts_admit(const webhook_hosts *hosts, const char *url, error *e);

/* The normal form of a URL, in which all URLs of a host begin alike: SCHEME://HOST:PORT/... with the port
 * always and the host in lower case. To be freed; NULL when it is not a URL. */
char *webhook_address(const char *url);
/* The beginning of a normal form, up to and with the slash after the port. To be freed. */
char *webhook_host_of(const char *address);

#endif
