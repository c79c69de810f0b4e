/* book: what the queue keeps of a job and changes: the counts of its tasks, what was asked of it, and
 * the state that follows.
 *
 * Private to src/queue; every function runs inside a change. Whoever changes tasks loads the book,
 * counts them over, and saves: state, times, events, the owner's counts and the jobs that depend on this one
 * follow there and nowhere else.
 */
#ifndef HEXAD_QUEUE_BOOK_H
#define HEXAD_QUEUE_BOOK_H

#include "queue/database.h"
#include "queue/queue.h"

typedef struct book {
    int64_t seq, revision;
    queue_state state; /* as stored; book_save brings it up to date */
    bool array, ordered, paused, cancelled;
    int pending; /* jobs that it waits for */
    int tasks, ready, delayed, running, succeeded, failed, cancelled_tasks, timed_out, not_converged;
    int attempts;
    int64_t started_ms, finished_ms, retention_s;
} book;

/* *found false: no such job. */
bool book_load(database *d, const char *id, book *b, bool *found, error *e);
bool book_load_row(database *d, int64_t seq, book *b, error *e); /* of a job that is there */

/* The state that follows from the rest. */
queue_state book_state(const book *b);

/* Of a job whose row was inserted just now, and which waits: its first event, its owner's count. */
bool book_enter(database *d, const book *b, int64_t now, error *e);

/* Stores it under the next revision; `before` is what was loaded. */
bool book_save(database *d, const book *before, book *b, int64_t now, error *e);

/* Whatever waits ends in a final state, for a reason that may be NULL. */
bool book_end_waiting(database *d, book *b, queue_state state, const char *code, const char *message,
                      int64_t now, error *e);

/* Whatever waits fails, because of the end of a job that it depends on. */
bool book_lose_need(database *d, book *b, const char *need, queue_state how, int64_t now, error *e);

/* `frame` may be QUEUE_NO_FRAME and `attempt` 0: none. */
bool book_note(database *d, int64_t seq, queue_event_type type, queue_state state, queue_outcome outcome,
               int frame, int attempt, int64_t now, error *e);

/* That the directories of all its tasks are to be removed, in the transaction that forgets it. */
bool book_note_removals(database *d, const book *b, error *e);

/* The count of tasks that ended in this state. */
int *book_count_of(book *b, queue_state final);

#endif
