// SPDX-License-Identifier: Apache-2.0
#include "programs/systemd_units.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/memory.h"
#include "base/core/terminal_text.h"

#define UNITS "/etc/systemd/system"

/* Runs systemctl with these words. Returns its output and error output, which the caller frees. */
static char *call_systemctl(const char *words, bool *ok)
{
    char *command = mem_printf("systemctl %s 2>&1", words), *text = NULL;
    size_t size = 0;
    fflush(stdout);
    FILE *from = popen(command, "re");
    if (!from || getdelim(&text, &size, '\0', from) < 0) {
        free(text);
        text = mem_strdup("");
    }
    *ok = from && pclose(from) == 0;
    free(command);
    return text;
}

char *systemd_units_show(const char *words)
{
    bool ok;
    char *text = call_systemctl(words, &ok);
    if (!ok) *text = '\0';
    return text;
}

bool systemd_units_are_unread(void)
{
    char *text = systemd_units_show("show --value --property NeedDaemonReload hexad.socket");
    const bool are_unread = strncmp(text, "yes", 3) == 0;
    free(text);
    return are_unread;
}

void systemd_units_obey(const char *words, char **failed)
{
    bool ok;
    char *text = call_systemctl(words, &ok), *rest = text;
    for (char *line; (line = strsep(&rest, "\n"));)
        if (*line) terminal_text_print(ok ? stdout : stderr, "systemctl %s: %s\n", words, line);
    free(text);
    if (ok) {
        terminal_text_print(stdout, "systemctl %s: done\n", words);
        return;
    }
    char *all = mem_printf("%s%s`systemctl %s`", *failed, **failed ? ", " : "", words);
    free(*failed);
    *failed = all;
}

char *systemd_units_directory(void)
{
    const char *path = getenv("SYSTEMD_UNIT_PATH");
    size_t length = path ? strcspn(path, ":") : 0;
    return length ? mem_strndup(path, length) : mem_strdup(UNITS);
}
