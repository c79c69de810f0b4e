/* parameters: the parameters of paths and queries and the headers that the routes take. Any thread. */
#ifndef HEXAD_API_PARAMETERS_H
#define HEXAD_API_PARAMETERS_H

#include "http/parameter.h"
#include "queue/queue.h"

extern const parameter_table api_parameters;

/* The order that the checked parameter `sort` names, or that of a list without it. */
void parameters_read_order(const http_request *request, queue_order *order, bool *rising);

#endif
