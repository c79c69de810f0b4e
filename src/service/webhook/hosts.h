// SPDX-License-Identifier: Apache-2.0
/* hosts: the hosts whose webhooks this service may call.
 *
 * libcurl parses a URL both for this check and for the call, so both use the same host. Immutable after it
 * was read; any thread.
 */
#ifndef HEXAD_SERVICE_WEBHOOK_HOSTS_H
#define HEXAD_SERVICE_WEBHOOK_HOSTS_H

#include <stddef.h>

#include "base/core/error.h"

typedef struct webhook_hosts webhook_hosts;

/* Parses `HOST` or `HOST:PORT` from each text. `HOST` permits the ports 80 for http and 443 for https.
 * Returns NULL and the error spec_invalid if a text has another form. The caller releases the hosts with
 * webhook_hosts_free, which accepts NULL. */
webhook_hosts *webhook_hosts_read(const char *const *texts, size_t count, error *e);
void webhook_hosts_free(webhook_hosts *hosts);

/* Whether a webhook may have this URL. Error spec_invalid: the scheme is not http or https, the URL has a
 * user or password, or its host and port are not listed. If `hosts` is NULL, no host is listed. */
bool webhook_hosts_admit(const webhook_hosts *hosts, const char *url, error *e);

/* The normal form of a URL, SCHEME://HOST:PORT/..., always with the port and with the host in lower case. All
 * URLs of a host then have the same beginning. The caller frees it. NULL if the text is not a URL. */
char *webhook_address(const char *url);
/* The beginning of a normal form, up to the slash after the port, inclusive. The caller frees it. */
char *webhook_host_of(const char *address);

#endif
