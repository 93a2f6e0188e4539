/* Data that ranks hold in parts: the picture of all in one process, and errors of one rank that are those of every rank.
 * mpirun -n 3 ranks */
#include <mpi.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "ewa_splat.h"

enum { COUNT = 900, WIDTH = 40, HEIGHT = 30, PIXELS = WIDTH * HEIGHT };

static int rank, failures = 0;

/* Checks a call: the code on the rank that is at fault, the code on the others, and a part of the text on all. */
static void gives(int line, ewa_status found, int is_own, ewa_status own, ewa_status others, const char *part) {
    ewa_status expected = is_own ? own : others;
    if (found != expected || !strstr(ewa_last_error(), part)) {
        printf("line %d, rank %d: expected %d \"%s\", found %d \"%s\"\n", line, rank, expected, part, found, ewa_last_error());
        failures++;
    }
}
#define FAILS_ON(r, call, own, part) gives(__LINE__, call, rank == (r), own, EWA_OTHER_RANK, part)
#define FAILS(call, part) gives(__LINE__, call, 1, EWA_INVALID, EWA_INVALID, part)
#define GOOD(call) gives(__LINE__, call, 1, EWA_OK, EWA_OK, "")
#define TRUE(is)                                                       \
    do {                                                               \
        if (!(is)) {                                                   \
            printf("line %d, rank %d: not so\n", __LINE__, rank);      \
            failures++;                                                \
        }                                                              \
    } while (0)

static double places[COUNT][3], radii[COUNT];
static float values[COUNT];

/* Makes a scene of some of all points. */
static ewa_scene *of(int first, int end, const char *name, const char *options) {
    size_t n = (size_t)(end - first);
    ewa_points points = {
        .x = &places[first][0], .y = &places[first][1], .z = &places[first][2],
        .count = n, .stride = sizeof places[0], .type = EWA_F64,
    };
    ewa_array columns[] = {
        {.name = "radius", .data = radii + first, .count = n, .type = EWA_F64},
        {.name = name, .data = values + first, .count = n, .type = EWA_F32},
    };
    ewa_scene *scene = NULL;
    GOOD(ewa_scene_points(&points, columns, 2, options, &scene));
    return scene;
}

static int progress = 0;

static void observe(const char *stage, double done, void *user) {
    (void)user;
    progress += *stage && done >= 0;
}

int main(int argc, char **argv) {
    int level, size;
    ewa_renderer *none = (ewa_renderer *)1, *renderer = NULL;
    /* Before MPI runs, there is no communicator. */
    FAILS(ewa_renderer_new_mpi(NULL, 0, 0, NULL, &none), "MPI");
    TRUE(!none);
    MPI_Init_thread(&argc, &argv, MPI_THREAD_SERIALIZED, &level);
    MPI_Comm_rank(MPI_COMM_WORLD, &rank);
    MPI_Comm_size(MPI_COMM_WORLD, &size);
    int32_t world = (int32_t)MPI_Comm_c2f(MPI_COMM_WORLD);
    FAILS(ewa_renderer_new_mpi(NULL, 0, (int32_t)MPI_Comm_c2f(MPI_COMM_NULL), NULL, &none), "communicator");
    FAILS(ewa_renderer_new_mpi(NULL, 0, -7, NULL, &none), "communicator");

    for (int i = 0; i < COUNT; i++) {
        places[i][0] = (i * 7919LL % 1000) / 1000.0;
        places[i][1] = (i * 104729LL % 997) / 997.0;
        places[i][2] = (i * 1299709LL % 991) / 991.0;
        radii[i] = 0.04 + (i % 5) / 100.0;
        values[i] = (float)(i % 32);
    }
    /* The second rank holds nothing. */
    int ends[] = {0, COUNT / 3, COUNT / 3, COUNT};
    const char *shown = "{\"field\": \"v\"}";
    ewa_scene *scene = of(ends[rank], ends[rank + 1], "v", shown), *whole = of(0, COUNT, "v", shown);
    ewa_scene *other = of(ends[rank], ends[rank + 1], rank == 2 ? "w" : "v", NULL);
    const ewa_scene *scenes[] = {scene}, *wholes[] = {whole}, *others[] = {other};
    const ewa_scene *nothing[] = {NULL};

    /* Arguments that do not fit on one rank, or on all. */
    FAILS_ON(1, ewa_renderer_new_mpi(rank == 1 ? nothing : scenes, 1, world, NULL, &none), EWA_INVALID, "scenes");
    FAILS_ON(2, ewa_renderer_new_mpi(rank == 2 ? NULL : scenes, 1, world, NULL, &none), EWA_INVALID, "scenes");
    FAILS_ON(0, ewa_renderer_new_mpi(scenes, 1, world, NULL, rank == 0 ? NULL : &none), EWA_INVALID, "out");
    FAILS_ON(1, ewa_renderer_new_mpi(scenes, 1, world, rank == 1 ? "{\"backend\": \"gpu\"}" : NULL, &none), EWA_INVALID, "backend");
    FAILS_ON(1, ewa_renderer_new_mpi(scenes, 1, world, rank == 1 ? "{" : NULL, &none), EWA_INVALID, "JSON");
    FAILS(ewa_renderer_new_mpi(scenes, 1, world, "{\"keep_shapes\": true}", &none), "keep_shapes");
    FAILS(ewa_renderer_new_mpi(scenes, 0, world, NULL, &none), "scenes");
    TRUE(!none);

    /* The picture, the depths and the columns of all in one process, bit for bit. */
    static float rgba[2][4 * PIXELS], depth[2][PIXELS], column[2][PIXELS];
    ewa_task *task = NULL;
    GOOD(ewa_task_new(observe, NULL, &task));
    ewa_buffers buffers = {.rgba = rgba[0], .rgba_count = 4 * PIXELS, .depth = depth[0], .depth_count = PIXELS};
    GOOD(ewa_renderer_new_mpi(scenes, 1, world, NULL, &renderer));
    GOOD(ewa_render(renderer, NULL, NULL, WIDTH, HEIGHT, task, &buffers));
    TRUE(progress);
    GOOD(ewa_columns(renderer, NULL, "{\"of\": \"v\"}", WIDTH, HEIGHT, NULL, EWA_F32, column[0], PIXELS, NULL));
    if (rank == 0) {
        ewa_renderer *alone = NULL;
        ewa_buffers here = {.rgba = rgba[1], .rgba_count = 4 * PIXELS, .depth = depth[1], .depth_count = PIXELS};
        GOOD(ewa_renderer_new(wholes, 1, "{\"backend\": \"cpu\"}", &alone));
        GOOD(ewa_render(alone, NULL, NULL, WIDTH, HEIGHT, NULL, &here));
        GOOD(ewa_columns(alone, NULL, "{\"of\": \"v\"}", WIDTH, HEIGHT, NULL, EWA_F32, column[1], PIXELS, NULL));
        TRUE(rgba[1][4 * (HEIGHT / 2 * WIDTH + WIDTH / 2) + 3] > 0);
        TRUE(!memcmp(rgba[0], rgba[1], sizeof rgba[0]) && !memcmp(depth[0], depth[1], sizeof depth[0]));
        TRUE(!memcmp(column[0], column[1], sizeof column[0]));
        ewa_renderer_free(alone);
    } else {
        /* Buffers of others keep their contents. */
        for (int i = 0; i < PIXELS; i++)
            TRUE(rgba[0][4 * i] == 0 && depth[0][i] == 0 && column[0][i] == 0);
    }

    /* What is wrong on one rank is an error of all, and the renderer goes on. */
    const ewa_buffers *own = rank == 0 ? &buffers : NULL;
    FAILS_ON(2, ewa_render(renderer, NULL, rank == 2 ? "{\"tolerance\": 7}" : NULL, WIDTH, HEIGHT, NULL, own), EWA_INVALID, "tolerance");
    FAILS_ON(0, ewa_render(renderer, NULL, NULL, WIDTH, HEIGHT, NULL, NULL), EWA_INVALID, "buffers");
    FAILS(ewa_render(renderer, NULL, rank == 1 ? "{\"tolerance\": 0.1}" : NULL, WIDTH, HEIGHT, NULL, own), "rank 1");
    FAILS(ewa_render(renderer, NULL, NULL, WIDTH + (size_t)rank / 2, HEIGHT, NULL, own), "rank 2");
    FAILS(rank == 1 ? ewa_columns(renderer, NULL, NULL, WIDTH, HEIGHT, NULL, EWA_F32, NULL, 0, NULL)
                    : ewa_render(renderer, NULL, NULL, WIDTH, HEIGHT, NULL, own), "ewa_columns on rank 1");
    FAILS_ON(1, ewa_columns(renderer, NULL, NULL, WIDTH, HEIGHT, NULL, rank == 1 ? 9 : EWA_F32, column[0], PIXELS, NULL), EWA_INVALID, "type");
    FAILS(ewa_columns(renderer, NULL, "{\"mean\": \"v\"}", WIDTH, HEIGHT, NULL, EWA_F32, column[0], PIXELS, NULL), "one process");
    ewa_deep *deep = (ewa_deep *)1;
    FAILS(ewa_render_deep(renderer, NULL, NULL, WIDTH, HEIGHT, NULL, &deep), "one process");
    TRUE(!deep);
    ewa_array some = {.name = "v", .data = values, .count = (size_t)(ends[rank + 1] - ends[rank]), .type = EWA_F32};
    ewa_array few = some;
    few.count -= rank == 2;
    FAILS_ON(2, ewa_renderer_set_values(renderer, 0, &few, NULL), EWA_INVALID, "values");
    GOOD(ewa_renderer_set_values(renderer, 0, &some, NULL));
    if (rank == 1)
        ewa_task_cancel(task);
    FAILS_ON(1, ewa_render(renderer, NULL, NULL, WIDTH, HEIGHT, task, own), EWA_CANCELLED, "cancelled");
    GOOD(ewa_render(renderer, NULL, NULL, WIDTH, HEIGHT, NULL, own));
    ewa_renderer_free(renderer);
    /* Other fields on one rank. */
    GOOD(ewa_renderer_new_mpi(others, 1, world, NULL, &renderer));
    FAILS(ewa_render(renderer, NULL, NULL, WIDTH, HEIGHT, NULL, own), "rank 2");

    ewa_task_free(task);
    ewa_scene_free(scene);
    ewa_scene_free(whole);
    ewa_scene_free(other);
    int all = 0;
    MPI_Allreduce(&failures, &all, 1, MPI_INT, MPI_SUM, MPI_COMM_WORLD);
    if (rank == 0)
        printf("%d failures on %d ranks\n", all, size);
    MPI_Finalize();
    /* Late, but no fault. */
    ewa_renderer_free(renderer);
    return all != 0;
}
