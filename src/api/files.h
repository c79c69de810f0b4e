/* files: the handler that lists the entries of directories below the input roots. Requires the scope `submit`. */
#ifndef HEXAD_API_FILES_H
#define HEXAD_API_FILES_H

#include "api/context.h"

http_handler files_list;

#endif
