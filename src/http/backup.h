/* backup: the handler that sends a copy of the database. One copy at a time. */
#ifndef HEXAD_HTTP_BACKUP_H
#define HEXAD_HTTP_BACKUP_H

#include "http/handler.h"

http_handler backup_send;

#endif
