/* The list of jobs. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "client/command.h"
#include "client/list_query.h"
#include "client/print.h"

static void print_row(json_at job)
{
    printf("%-26s  ", json_string(json_member(&job, "id"), "?"));
    printf("%-10s  ", json_string(json_member(&job, "state"), "?"));
    printf("%-13s  ", json_string(json_member(&job, "outcome"), "-"));
    printf("%8.0f  ", json_number(json_member(&job, "priority"), 0));
    printf("%-24s  ", json_string(json_member(&job, "created"), "?"));
    print_text(stdout, json_string(json_member(&job, "name"), "-"));
    putchar('\n');
}

int command_list(client *c, const char *argument, const command_options *options)
{
    (void)argument;
    json *document = NULL;
    if (options->label_count > 1) {
        print_failure("list: --label can be given once");
        return COMMAND_USAGE;
    }
    char *path = list_query_path(c, options, NULL);
    int code = command_ask(c, "GET", path, NULL, &document);
    if (code == COMMAND_OK && options->json) {
        print_document(document);
    } else if (code == COMMAND_OK) {
        json_at root = json_root(document), jobs = json_member(&root, "jobs");
        printf("%-26s  %-10s  %-13s  %8s  %-24s  %s\n", "ID", "STATE", "OUTCOME", "PRIORITY", "CREATED",
               "NAME");
        for (size_t i = 0; i < json_size(jobs); i++) print_row(json_element(&jobs, i));
        if (json_type_of(json_member(&root, "next")) == JSON_STRING)
            fputs("hexadctl: there are more jobs; see --limit\n", stderr);
    }
    json_free(document);
    free(path);
    return code;
}

int command_show(client *c, const char *argument, const command_options *options)
{
    json *document = NULL;
    char *path = command_job_path(argument, "");
    int code = path ? command_ask(c, "GET", path, NULL, &document) : COMMAND_USAGE;
    if (code == COMMAND_OK && options->json)
        print_document(document);
    else if (code == COMMAND_OK)
        print_job(json_root(document));
    json_free(document);
    free(path);
    return code;
}
