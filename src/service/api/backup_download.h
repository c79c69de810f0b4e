// SPDX-License-Identifier: Apache-2.0
/* backup_download: the handler that sends a copy of the database. While a copy is being made, further
 * requests are refused. */
#ifndef HEXAD_SERVICE_API_BACKUP_DOWNLOAD_H
#define HEXAD_SERVICE_API_BACKUP_DOWNLOAD_H

#include "service/api/context.h"

http_handler backup_download_send;

#endif
