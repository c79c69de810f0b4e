// SPDX-License-Identifier: Apache-2.0
/* hexad-node: runs attempts of a service on a node of its farm. A Slurm job of the service starts it. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "config.h"

#include "base/core/terminal_text.h"
#include "service/slurm/node.h"

/* Reads the names on standard input, one or more per line. The part of this task is `lines` lines. */
static void read_names(node_task *task, size_t lines)
{
    char *line = NULL;
    size_t capacity = 0, first = (size_t)task->self.task * lines;
    for (size_t i = 0; getline(&line, &capacity, stdin) > 1; i++) {
        size_t before = task->names.count;
        char *rest = NULL;
        for (char *name = strtok_r(line, " \n", &rest); name; name = strtok_r(NULL, " \n", &rest))
            attempt_files_add_name(&task->names, name, strlen(name));
        if (i == first) task->first = before;
        if (i >= first && i < first + lines) task->own += task->names.count - before;
    }
    free(line);
}

int main(int argc, char **argv)
{
    error e = {0};
    if (argc == 2 && strcmp(argv[1], "--version") == 0) {
        puts(PACKAGE_STRING);
        return 0;
    }
    const bool help = argc >= 2 && strcmp(argv[1], "--help") == 0;
    if (help || argc != 7 || argv[1][0] != '/') {
        fprintf(help ? stdout : stderr,
                "usage: hexad-node WORK_DIR/farm JOB TASK OWN SECONDS LIST\n"
                "Runs attempts that hexad has written there; their names are on standard input. This "
                "task of\nthe Slurm job runs those of OWN lines, from line TASK * OWN on. For SECONDS it "
                "also runs attempts of\nother tasks, and those in LIST. Slurm starts this program; see "
                "doc/farm.md.\n");
        return help ? 0 : 2;
    }
    umask(0077); /* jobs and results are private to the service */
    node_task task = {.more_s = strtod(argv[5], NULL), .list = argv[6]};
    snprintf(task.self.name, sizeof task.self.name, "%s", argv[2]);
    task.self.task = atoi(argv[3]);
    read_names(&task, strtoul(argv[4], NULL, 10));
    bool ok = node_run(argv[1], &task, &e);
    if (!ok) terminal_text_print(stderr, "hexad-node: %s\n", e.message);
    attempt_files_clear_names(&task.names);
    return ok ? 0 : 1;
}
