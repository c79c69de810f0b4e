// SPDX-License-Identifier: Apache-2.0
#include "base/core/numeric_state.h"

#include <stdlib.h>

#include "base/core/memory.h"

void numeric_state_enter(numeric_state *before)
{
    fegetenv(&before->arithmetic);
    fesetenv(FE_DFL_ENV);
    before->locale = uselocale(newlocale(LC_ALL_MASK, "C", (locale_t)0)); /* static: never freed */
}

void numeric_state_leave(const numeric_state *before)
{
    uselocale(before->locale);
    fesetenv(&before->arithmetic);
}

typedef struct beginning {
    void *(*run)(void *argument);
    void *argument;
} beginning;

static void *begin(void *context)
{
    const beginning b = *(const beginning *)context;
    numeric_state unused;
    free(context);
    numeric_state_enter(&unused);
    return b.run(b.argument);
}

int numeric_state_start_thread(pthread_t *thread, const pthread_attr_t *attributes,
                               void *(*run)(void *argument), void *argument)
{
    beginning *b = mem_alloc(sizeof *b);
    *b = (beginning){run, argument};
    const int fault = pthread_create(thread, attributes, begin, b);
    if (fault) free(b);
    return fault;
}
