// SPDX-License-Identifier: Apache-2.0
#include "service/results/kept_result.h"

#include <stdlib.h>

#include "service/results/result.h"
#include "files/file.h"

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
    queue_task *tasks = NULL;
    size_t count = 0;
    if (!queue_list_tasks(q, id, -1, INT32_MAX, &tasks, &count, NULL)) return;
    for (size_t i = 0; i < count; i++) {
        if (tasks[i].state != QUEUE_CANCELLED || !tasks[i].storage_faults) continue;
        char *directory = result_attempt_directory(work_dir, id, tasks[i].frame, tasks[i].attempt);
        result_remove_leftovers(directory);
        free(directory);
    }
    queue_tasks_free(tasks, count);
}
