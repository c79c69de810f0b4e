/* crew: threads that do what would keep the serving thread waiting: what ends on a disk.
 *
 * So many of them that concurrent submissions share one flush of the queue (its group commit), and the
 * serving thread never waits for one. Work is begun in the order of its coming. Any thread may give work.
 */
#ifndef HEXAD_HTTP_CREW_H
#define HEXAD_HTTP_CREW_H

#include "base/error.h"

typedef struct crew crew;

/* A piece of work, a member of what it is about; the giver's until `run` is called. */
typedef struct crew_work {
    void (*run)(struct crew_work *work);
    struct crew_work *next;
} crew_work;

crew *crew_start(unsigned threads, error *e);

/* Does what was given before, and ends. Accepts NULL. */
void crew_stop(crew *c);

void crew_give(crew *c, crew_work *work);

#endif
