/* hexad-node: runs attempts of a service on a node of its farm; a Slurm job of the service calls it. */
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>

#include "config.h"

#include "slurm/node.h"

int main(int argc, char **argv)
{
    error e = {0};
    if (argc == 2 && strcmp(argv[1], "--version") == 0) {
        puts(PACKAGE_STRING);
        return 0;
    }
    if (argc < 3 || argv[1][0] != '/') {
        fprintf(stderr,
                "usage: hexad-node WORK_DIR/farm NAME...\n"
                "Runs the attempts that hexad has written there. Slurm starts it; see doc/farm.md.\n");
        return 2;
    }
    umask(0077); /* jobs and results are the service's own */
    if (node_run(argv[1], argv + 2, (size_t)argc - 2, &e)) return 0;
    fprintf(stderr, "hexad-node: %s\n", e.message);
    return 1;
}
