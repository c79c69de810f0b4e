// SPDX-License-Identifier: Apache-2.0
/* spec_text: the spec of a quartic with additional members. Include after cmocka. */
#ifndef HEXAD_TESTS_SPEC_TEXT_H
#define HEXAD_TESTS_SPEC_TEXT_H

#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"
#include "spec/spec.h"

/* `members` begins with a comma, or is empty. Result and errors: spec_parse. */
static inline spec *spec_of_text(const char *members, spec_faults *faults, error *e)
{
    char *text = mem_printf("{\"version\":1,\"surface\":{\"analytic\":{\"shape\":\"quartic\"}},"
                            "\"sampling\":{\"count\":100}%s}",
                            members);
    json *document = json_parse(text, strlen(text), e);
    if (!document) fail_msg("%s", e->message);
    spec *s = spec_parse(document, faults, e);
    json_free(document);
    free(text);
    return s;
}

#endif
