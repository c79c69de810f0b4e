// SPDX-License-Identifier: Apache-2.0
/* Evenly packed points on an octahedron: cc sample.c $(pkg-config --cflags --libs hexad) */
#include <hexad.h>
#include <stdio.h>
#include <string.h>

static const float vertices[6][3] = {{1, 0, 0}, {-1, 0, 0}, {0, 1, 0}, {0, -1, 0}, {0, 0, 1}, {0, 0, -1}};
static const int faces[8][3] = {{0, 2, 4}, {2, 1, 4}, {1, 3, 4}, {3, 0, 4},
                                {2, 0, 5}, {1, 2, 5}, {3, 1, 5}, {0, 3, 5}};

static const char spec[] =
    "{\"surface\": {\"mesh\": {\"path\": \"octahedron\"}}, \"sampling\": {\"count\": 2048}}";

int main(void)
{
    const hexad_array v = hexad_array_2d(vertices, HEXAD_FLOAT32, 6, 3),
                      f = hexad_array_2d(faces, HEXAD_INT32, 8, 3);
    hexad_error error;
    hexad_array position;
    hexad_job *job = hexad_job_new(spec);
    int failed = hexad_job_add_mesh(job, "octahedron", &v, &f, NULL, &error) || hexad_job_run(job, &error) ||
                 hexad_job_array(job, "position", &position);
    if (failed) {
        fprintf(stderr, "%s: %s\n", error.code, error.message);
    } else {
        const double *p = (const double *)position.data;
        const int converged = strstr(hexad_job_report(job), "\"outcome\":\"converged\"") != NULL;
        printf("%d points, %s; the first at %g %g %g\n", (int)position.size[0],
               converged ? "converged" : "not converged", p[0], p[1], p[2]);
    }
    hexad_job_free(job);
    return failed;
}
