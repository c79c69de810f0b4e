/* backup: the handler that sends a copy of the database. It makes one copy at a time. */
#ifndef HEXAD_API_BACKUP_H
#define HEXAD_API_BACKUP_H

#include "api/context.h"

http_handler backup_send;

#endif
