// SPDX-License-Identifier: Apache-2.0
#include "service/api/web_page.h"

#include <dirent.h>
#include <errno.h>
#include <libgen.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "service/api/constant_document.h"
#include "base/core/build_part.h"
#include "base/core/memory.h"
#include "files/file.h"

#define FILE_BYTES_MOST (1 << 20)
/* The Content-Security-Policy: scripts and styles come only from this service, and text cannot become markup
 * or code. */
#define POLICY                                                                                           \
    "default-src 'self'; img-src 'self' blob:; object-src 'none'; base-uri 'none'; form-action 'none'; " \
    "frame-ancestors 'none'; require-trusted-types-for 'script'; trusted-types 'none'"

typedef struct page_file {
    char *name;
    constant_document document;
} page_file;

struct page {
    page_file *file;
    size_t count;
};

/* The media type by the ending of a name; NULL: the file is not part of the page. */
static const char *type_of(const char *name)
{
    static const struct {
        const char *ending, *type;
    } types[] = {
        {".html", "text/html; charset=utf-8"},
        {".js", "text/javascript; charset=utf-8"},
        {".css", "text/css; charset=utf-8"},
        {".svg", "image/svg+xml"},
    };
    const char *ending = strrchr(name, '.');
    for (size_t i = 0; ending && i < sizeof types / sizeof *types; i++)
        if (strcmp(ending, types[i].ending) == 0) return types[i].type;
    return NULL;
}

static const page_file *find(const page *p, const char *name)
{
    for (size_t i = 0; p && i < p->count; i++)
        if (strcmp(p->file[i].name, name) == 0) return &p->file[i];
    return NULL;
}

static bool read_file(page *p, const char *directory, const char *name, error *e)
{
    size_t length = 0;
    const char *type = type_of(name);
    if (!type) return true;
    char *path = mem_printf("%s/%s", directory, name),
         *bytes = store_file_read(path, FILE_BYTES_MOST, &length, e);
    free(path);
    if (!bytes) return false;
    p->file = mem_resize(p->file, (p->count + 1) * sizeof *p->file);
    p->file[p->count++] = (page_file){mem_strdup(name), constant_document_make(type, bytes, length)};
    return true;
}

static page *read_directory(const char *directory, error *e)
{
    page *p = mem_alloc(sizeof *p);
    DIR *listing = opendir(directory);
    bool ok = listing || error_set(e, ERROR_INPUT_MISSING, "%s: %s", directory, strerror(errno));
    for (struct dirent *entry; ok && (entry = readdir(listing));)
        ok = read_file(p, directory, entry->d_name, e);
    if (listing) closedir(listing);
    if (ok && !find(p, "index.html"))
        ok = error_set(e, ERROR_INPUT_MISSING, "%s has no index.html", directory);
    if (ok) return p;
    web_page_close(p);
    return NULL;
}

/* The directory in which the page is installed; to be freed. If `programs` is BINDIR below another root
 * (DESTDIR), the page is below the same root. */
static char *installed_page(const char *programs)
{
    size_t length = strlen(programs), tail = strlen(HEXAD_BINDIR);
    bool staged = length > tail && strcmp(programs + length - tail, HEXAD_BINDIR) == 0;
    return mem_printf("%.*s" HEXAD_PAGEDIR, staged ? (int)(length - tail) : 0, programs);
}

page *web_page_open(error *e)
{
    char own[PATH_MAX];
    error why = {0};
    if (build_part_missing(BUILD_PART_PAGE)) {
        error_set(e, ERROR_NOT_SUPPORTED, "%s", build_part_missing(BUILD_PART_PAGE));
        return NULL;
    }
    ssize_t length = readlink("/proc/self/exe", own, sizeof own - 1);
    own[length > 0 ? length : 0] = '\0';
    const char *programs = dirname(own);
    char *beside = mem_printf("%s/page", programs), *installed = installed_page(programs);
    page *p = read_directory(beside, NULL);
    if (!p) p = read_directory(installed, &why);
    if (!p)
        error_set(
            e, ERROR_INPUT_MISSING,
            "neither %s nor %s holds it (%s): install the page, or run npm ci in the folder page of the source and"
            " make again",
            beside, installed, why.message);
    free(beside);
    free(installed);
    return p;
}

void web_page_close(page *p)
{
    if (!p) return;
    for (size_t i = 0; i < p->count; i++) {
        free(p->file[i].name);
        constant_document_clear(&p->file[i].document);
    }
    free(p->file);
    free(p);
}

static void send_file(const http_context *c, const http_request *request, const char *name, reply *r)
{
    const page_file *f = find(c->page, name);
    if (build_part_missing(BUILD_PART_PAGE)) {
        reply_set_problem(r, "not_supported", NULL, "%s", build_part_missing(BUILD_PART_PAGE));
        return;
    }
    if (!f) {
        reply_set_problem(
            r, "not_found", NULL,
            c->page
                ? "the page has no file %.200s"
                : "this service has no page: the setting page is 0, or its log says which files are missing",
            name);
        return;
    }
    constant_document_answer(&f->document, request, r);
    reply_add_header(r, "Content-Security-Policy", POLICY);
    reply_add_header(r, "Referrer-Policy", "no-referrer");
}

void web_page_show(const http_context *c, const http_request *request, reply *r)
{
    send_file(c, request, "index.html", r);
}

void web_page_send_file(const http_context *c, const http_request *request, reply *r)
{
    send_file(c, request, request->parameter[0], r);
}
