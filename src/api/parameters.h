/* parameters: the parameters of paths and queries and the headers that the routes take. Constant data; any
 * thread. */
#ifndef HEXAD_API_PARAMETERS_H
#define HEXAD_API_PARAMETERS_H

#include "http/parameter.h"

extern const parameter_table api_parameters;

#endif
