// SPDX-License-Identifier: Apache-2.0
/* replay: runs a target over files, and over the files of folders, named as arguments; for builds without
 * libFuzzer. */
#include <dirent.h>
#include <errno.h>
#include <stdbool.h>
#include <string.h>
#include <sys/stat.h>

#include "base/core/memory.h"
#include "fuzz/target.h"

static bool run_file(const char *path, size_t *count)
{
    struct stat st;
    FILE *file = fopen(path, "rb");
    if (!file || fstat(fileno(file), &st) != 0) {
        fprintf(stderr, "%s: %s\n", path, strerror(errno));
        if (file) fclose(file);
        return false;
    }
    /* malloc, and no byte more than there are: a sanitizer sees a read beyond them */
    uint8_t *bytes = malloc((size_t)st.st_size);
    bool ok = bytes && fread(bytes, 1, (size_t)st.st_size, file) == (size_t)st.st_size;
    fclose(file);
    if (ok) {
        fprintf(stderr, "%s\n", path); /* what a crash is of */
        LLVMFuzzerTestOneInput(bytes, (size_t)st.st_size);
        ++*count;
    }
    free(bytes);
    return ok;
}

static bool run(const char *path, size_t *count)
{
    struct stat st;
    DIR *folder = stat(path, &st) == 0 && S_ISDIR(st.st_mode) ? opendir(path) : NULL;
    if (!folder) return run_file(path, count);
    bool ok = true;
    for (struct dirent *entry; ok && (entry = readdir(folder));) {
        if (entry->d_name[0] == '.') continue;
        char *inside = mem_printf("%s/%s", path, entry->d_name);
        ok = run(inside, count);
        free(inside);
    }
    closedir(folder);
    return ok;
}

int main(int argc, char **argv)
{
    size_t count = 0;
    for (int n = 1; n < argc; n++)
        if (!run(argv[n], &count)) return 1;
    printf("%zu files\n", count);
    return 0;
}
