#include "volume/mesh_file.h"

#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <signal.h>
#include <spawn.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "base/memory.h"
#include "volume/mesh_reader.h"

/* Processor time of the reading process: measured at 10 MB a second and more for text; a tenth of that is
 * granted. */
static const unsigned seconds_at_least = 60;
static const off_t bytes_per_second = 1 << 20;

/* Squares of what is larger overflow long before the surface does anybody any good. */
static const double largest_coordinate = 1e30;

typedef struct answer {
    FILE *stream;
    mesh_reader_header header;
    char text[MESH_READER_TEXT_MAX + 1];
} answer;

/* The ending of the file's name in lower case, if it looks like one. */
static void ending_of(const char *path, char out[16])
{
    const char *dot = strrchr(path, '.');
    size_t n = 0;
    if (dot && !strchr(dot, '/'))
        for (const char *p = dot + 1; *p && n < 15; p++) {
            char c = *p >= 'A' && *p <= 'Z' ? (char)(*p + 'a' - 'A') : *p;
            if (!((c >= 'a' && c <= 'z') || (c >= '0' && c <= '9'))) break;
            out[n++] = c;
        }
    out[n] = '\0';
}

static bool check_head(int fd, off_t *size, error *e)
{
    static const char lfs[] = "version https://git-lfs";
    struct stat st;
    char head[sizeof lfs] = {0};
    if (fstat(fd, &st) != 0 || !S_ISREG(st.st_mode))
        return error_set(e, ERROR_INPUT_DAMAGED, "is not a regular file");
    if (st.st_size == 0) return error_set(e, ERROR_INPUT_DAMAGED, "is empty (0 bytes)");
    if (pread(fd, head, sizeof lfs - 1, 0) < 0)
        return error_set(e, ERROR_INPUT_DAMAGED, "cannot be read: %s", strerror(errno));
    if (strcmp(head, lfs) == 0)
        return error_set(e, ERROR_INPUT_DAMAGED,
                         "is a Git-LFS pointer, not the mesh itself: run `git lfs pull` where it came from");
    *size = st.st_size;
    return true;
}

/* Starts the process with the file as its input; *out reads what it writes. */
static bool start(const mesh_file *file, off_t size, pid_t *pid, FILE **out, error *e)
{
    static char program[] = "hexad-worker", command[] = MESH_READER_COMMAND, *environment[] = {NULL};
    char ending[16], memory[32], seconds[32];
    ending_of(file->path, ending);
    snprintf(memory, sizeof memory, "%zu", file->memory_limit);
    snprintf(seconds, sizeof seconds, "%lld", (long long)(seconds_at_least + size / bytes_per_second));
    char *arguments[] = {program, command, ending, memory, seconds, NULL};
    int ends[2];
    if (pipe2(ends, O_CLOEXEC) != 0)
        return error_set(e, ERROR_INTERNAL, "no pipe to read the mesh through: %s", strerror(errno));
    posix_spawn_file_actions_t actions;
    posix_spawn_file_actions_init(&actions);
    posix_spawn_file_actions_adddup2(&actions, ends[1], STDOUT_FILENO);
    posix_spawn_file_actions_adddup2(&actions, file->fd, STDIN_FILENO);
    posix_spawn_file_actions_addopen(&actions, STDERR_FILENO, "/dev/null", O_WRONLY, 0);
    posix_spawn_file_actions_addclosefrom_np(&actions, STDERR_FILENO + 1);
    int why = posix_spawn(pid, file->program ? file->program : "/proc/self/exe", &actions, NULL, arguments,
                          environment);
    posix_spawn_file_actions_destroy(&actions);
    close(ends[1]);
    if (why == 0 && (*out = fdopen(ends[0], "rb"))) return true;
    close(ends[0]);
    return error_set(e, ERROR_INTERNAL, "the process that reads meshes could not be started: %s",
                     strerror(why ? why : errno));
}

static bool read_all(FILE *stream, void *to, size_t size, size_t count, error *e)
{
    if (fread(to, size, count, stream) == count) return true;
    return error_set(e, ERROR_INPUT_DAMAGED, "could not be read to its end");
}

static bool read_header(answer *a, error *e)
{
    mesh_reader_header *h = &a->header;
    if (!read_all(a->stream, h, sizeof *h, 1, e)) return false;
    if (h->magic != MESH_READER_MAGIC || h->code >= ERROR_CODE_COUNT || h->text_length > MESH_READER_TEXT_MAX)
        return error_set(e, ERROR_INPUT_DAMAGED, "made its reader answer nonsense");
    if (h->text_length && !read_all(a->stream, a->text, 1, h->text_length, e)) return false;
    for (char *p = a->text; *p; p++)
        if ((unsigned char)*p < ' ') *p = ' ';
    return h->code == ERROR_NONE || error_set(e, (error_code)h->code, "%s", a->text);
}

static bool check_counts(const mesh_reader_header *h, size_t limit, error *e)
{
    if (h->triangles == 0)
        return error_set(e, ERROR_NO_SURFACE, "holds no triangle (%llu vertices, %llu points or lines)",
                         (unsigned long long)h->vertices, (unsigned long long)h->others);
    if (h->vertices >= UINT32_MAX || h->triangles >= UINT32_MAX / 3)
        return error_set(e, ERROR_INPUT_UNSUPPORTED,
                         "has %llu vertices and %llu triangles, too many for 32 bits",
                         (unsigned long long)h->vertices, (unsigned long long)h->triangles);
    size_t needed = mesh_bytes(h->vertices, h->triangles);
    if (needed <= limit) return true;
    return error_set(e, ERROR_LIMIT_MEMORY,
                     "its %llu triangles need %zu MB and the limit is %zu MB: raise limits.memory_mb",
                     (unsigned long long)h->triangles, (needed >> 20) + 1, limit >> 20);
}

static bool read_vertices(FILE *stream, mesh *m, error *e)
{
    for (size_t n = 0; n < m->vertex_count; n++) {
        float at[3];
        if (!read_all(stream, at, sizeof at, 1, e)) return false;
        for (int k = 0; k < 3; k++)
            if (!(fabs((double)at[k]) <= largest_coordinate))
                return error_set(e, ERROR_INPUT_DAMAGED,
                                 "has a vertex, number %zu, whose coordinates are not finite or beyond %g", n,
                                 largest_coordinate);
        m->vertex[n] = (vec3){(double)at[0], (double)at[1], (double)at[2]};
    }
    return true;
}

static bool read_triangles(FILE *stream, mesh *m, error *e)
{
    if (!read_all(stream, m->triangle, sizeof m->triangle[0], m->triangle_count, e)) return false;
    for (size_t n = 0; n < m->triangle_count; n++)
        for (int k = 0; k < 3; k++)
            if (m->triangle[n][k] >= m->vertex_count)
                return error_set(e, ERROR_INPUT_DAMAGED,
                                 "has a triangle, number %zu, with a corner that is none of its %zu vertices",
                                 n, m->vertex_count);
    return true;
}

static bool read_answer(answer *a, size_t limit, mesh *m, error *e)
{
    if (!read_header(a, e) || !check_counts(&a->header, limit, e)) return false;
    m->vertex_count = a->header.vertices;
    m->triangle_count = a->header.triangles;
    m->vertex = mem_array(m->vertex_count, sizeof *m->vertex, "the mesh", e);
    m->triangle = m->vertex ? mem_array(m->triangle_count, sizeof *m->triangle, "the mesh", e) : NULL;
    if (!m->triangle || !read_vertices(a->stream, m, e) || !read_triangles(a->stream, m, e)) return false;
    return fgetc(a->stream) == EOF ||
           error_set(e, ERROR_INPUT_DAMAGED, "made its reader answer more than it announced");
}

/* Waits for the process. One that a signal ended explains more than the answer that it could not finish;
 * one that has begun to answer and is not wanted any more is ended here. */
static bool end(pid_t pid, bool begun, bool ok, error *e)
{
    int status;
    pid_t ended;
    if (!ok && begun) kill(pid, SIGKILL);
    do ended = waitpid(pid, &status, 0);
    while (ended < 0 && errno == EINTR);
    if (ended != pid) return error_set(e, ERROR_INTERNAL, "the process that reads meshes was lost");
    if (!ok && begun) return false;
    if (WIFSIGNALED(status) && WTERMSIG(status) == SIGXCPU)
        return error_set(e, ERROR_INPUT_DAMAGED, "takes too long to be read: its reader was ended");
    if (WIFSIGNALED(status))
        return error_set(e, ERROR_INPUT_DAMAGED, "made its reader crash (%s): it is damaged",
                         strsignal(WTERMSIG(status)));
    return ok &&
           (WEXITSTATUS(status) == 0 || error_set(e, ERROR_INPUT_DAMAGED, "could not be read to its end"));
}

bool mesh_file_read(const mesh_file *file, mesh *out, mesh_notes *notes, error *e)
{
    mesh m = {0};
    answer a = {0};
    off_t size = 0;
    pid_t pid;
    if (!check_head(file->fd, &size, e) || !start(file, size, &pid, &a.stream, e)) return false;
    bool ok = read_answer(&a, file->memory_limit, &m, e);
    fclose(a.stream);
    ok = end(pid, a.header.magic == MESH_READER_MAGIC, ok, e);
    if (ok && a.header.others)
        mesh_note(notes, "the mesh has %llu points or lines beside its triangles: left out",
                  (unsigned long long)a.header.others);
    if (ok)
        *out = m;
    else
        mesh_free(&m);
    return ok;
}
