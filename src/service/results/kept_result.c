// SPDX-License-Identifier: Apache-2.0
#include "service/results/kept_result.h"

#include <stdlib.h>

#include "service/results/result.h"
#include "files/file.h"

/* Tasks that one query reads. */
#define PAGE 1000

bool kept_result_take(const char *work_dir, const queue_claimed *claimed, const char *directory)
{
    const queue_task *task = &claimed->task;
    bool found = false;
    for (int before = task->attempt - 1; task->storage_faults && before > 0 && !found; before--) {
        result r = {0};
        char *kept = result_attempt_directory(work_dir, claimed->job.id, task->frame, before);
        found = result_read(kept, &r, NULL) && store_rename(kept, directory, NULL);
        result_clear(&r);
        free(kept);
    }
    return found;
}

void kept_result_remove(queue *q, const char *work_dir, const char *id)
{
    size_t count = PAGE;
    for (int after = -1; count == PAGE;) {
        queue_task *tasks = NULL;
        if (!queue_list_tasks(q, id, after, PAGE, &tasks, &count, NULL)) return;
        for (size_t i = 0; i < count; i++) {
            after = tasks[i].number;
            if (tasks[i].state != QUEUE_CANCELLED || !tasks[i].storage_faults) continue;
            char *directory = result_attempt_directory(work_dir, id, tasks[i].frame, tasks[i].attempt);
            result_remove_leftovers(directory);
            free(directory);
        }
        queue_tasks_free(tasks, count);
    }
}
