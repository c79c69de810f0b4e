/* hosts: whom this service may tell that jobs have ended.
 *
 * An address is read by the same parser (libcurl's) that later goes there, so that both mean the same host.
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

/* Whether a webhook may have this address: an error (spec_invalid) unless it is one of http or https,
 * without a user or password, of a host and port that are listed. `hosts` NULL: none is. */
bool webhook_hosts_admit(const webhook_hosts *hosts, const char *url, error *e);

/* An address that was admitted, in the form in which those of one host begin alike: SCHEME://HOST:PORT/... with
 * the port always and the host in lower case. To be freed; NULL when it is no address. */
char *webhook_address(const char *url);
/* That beginning, with the slash at its end, of what webhook_address returned. To be freed. */
char *webhook_host_of(const char *address);

#endif
