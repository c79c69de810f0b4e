/* files: the handler that lists the files of the input roots, for those who may submit jobs that read them. */
#ifndef HEXAD_API_FILES_H
#define HEXAD_API_FILES_H

#include "api/context.h"

http_handler files_list;

#endif
