/* Draws particles that the ranks of an MPI job hold in parts: mpirun -n 3 ranks FILE
 * The first rank writes the pixels (4 floats each), the depths (1 each), a column density (1 double each), and the pixels of
 * a further time step, rows from the top. They are the same for any number of ranks. */
#include <mpi.h>
#include <stdio.h>
#include <stdlib.h>

#include "ewa_splat.h"

enum { COUNT = 3000, WIDTH = 96, HEIGHT = 72, PIXELS = WIDTH * HEIGHT };

static float rgba[4 * PIXELS], depth[PIXELS], later[4 * PIXELS];
static double density[PIXELS];

/* Every rank gets the error of any rank, so all end. */
static void check(ewa_status status) {
    if (status != EWA_OK) {
        fprintf(stderr, "ewa_splat: %s\n", ewa_last_error());
        MPI_Abort(MPI_COMM_WORLD, 1);
    }
}

int main(int argc, char **argv) {
    int level, rank, size;
    MPI_Init_thread(&argc, &argv, MPI_THREAD_SERIALIZED, &level);
    MPI_Comm_rank(MPI_COMM_WORLD, &rank);
    MPI_Comm_size(MPI_COMM_WORLD, &size);

    /* Rank 1 holds nothing; the others hold one run each, in their order. */
    int holders = size > 1 ? size - 1 : 1, holder = rank > 1 ? rank - 1 : rank;
    int first = COUNT * holder / holders, end = COUNT * (holder + 1) / holders;
    size_t n = rank == 1 ? 0 : (size_t)(end - first);
    double (*places)[3] = malloc(COUNT * sizeof *places), *radii = malloc(COUNT * sizeof *radii);
    float *values = malloc(COUNT * sizeof *values), *masses = malloc(COUNT * sizeof *masses);
    for (size_t k = 0; k < n; k++) {
        int i = first + (int)k;
        places[k][0] = (i * 7919LL % 1000) / 1000.0;
        places[k][1] = (i * 104729LL % 997) / 997.0;
        places[k][2] = (i * 1299709LL % 991) / 991.0;
        radii[k] = 0.02 + (i % 5) / 100.0;
        values[k] = (float)(i % 32);
        masses[k] = 1e-6f * (float)(1 + i % 7);
    }
    ewa_points points = {
        .x = &places[0][0], .y = &places[0][1], .z = &places[0][2],
        .count = n, .stride = sizeof places[0], .type = EWA_F64,
    };
    ewa_array columns[] = {
        {.name = "radius", .data = radii, .count = n, .type = EWA_F64},
        {.name = "pressure", .data = values, .count = n, .type = EWA_F32},
    };
    ewa_scene *gas, *stars;
    check(ewa_scene_points(&points, columns, 2, "{\"field\": \"pressure\"}", &gas));
    columns[1] = (ewa_array){.name = "mass", .data = masses, .count = n, .type = EWA_F32};
    check(ewa_scene_points(&points, columns, 2, NULL, &stars));

    int32_t communicator = (int32_t)MPI_Comm_c2f(MPI_COMM_WORLD);
    const ewa_scene *scenes[] = {gas, stars};
    ewa_renderer *renderer, *of_stars;
    check(ewa_renderer_new_mpi(scenes, 1, communicator, NULL, &renderer));
    check(ewa_renderer_new_mpi(scenes + 1, 1, communicator, NULL, &of_stars));
    /* Every rank draws; the first one gets the picture. */
    ewa_buffers buffers = {.rgba = rgba, .rgba_count = 4 * PIXELS, .depth = depth, .depth_count = PIXELS};
    const ewa_buffers *own = rank == 0 ? &buffers : NULL;
    check(ewa_render(renderer, NULL, "{\"tolerance\": 0.01}", WIDTH, HEIGHT, NULL, own));
    check(ewa_columns(of_stars, NULL, "{\"of\": \"mass\"}", WIDTH, HEIGHT, NULL, EWA_F64, rank == 0 ? density : NULL, PIXELS, NULL));

    /* Another time step: every rank gives the values of its part. */
    for (size_t k = 0; k < n; k++)
        values[k] = (float)((first + (int)k) % 11);
    ewa_array step = {.name = "pressure", .data = values, .count = n, .type = EWA_F32};
    check(ewa_renderer_set_values(renderer, 0, &step, NULL));
    buffers = (ewa_buffers){.rgba = later, .rgba_count = 4 * PIXELS};
    check(ewa_render(renderer, NULL, NULL, WIDTH, HEIGHT, NULL, own));

    ewa_renderer_free(renderer);
    ewa_renderer_free(of_stars);
    ewa_scene_free(gas);
    ewa_scene_free(stars);
    free(places);
    free(radii);
    free(values);
    free(masses);
    int failed = 0;
    if (rank == 0) {
        FILE *file = argc == 2 ? fopen(argv[1], "wb") : NULL;
        failed = !file || fwrite(rgba, sizeof rgba, 1, file) != 1 || fwrite(depth, sizeof depth, 1, file) != 1 ||
                 fwrite(density, sizeof density, 1, file) != 1 || fwrite(later, sizeof later, 1, file) != 1 || fclose(file);
        if (failed)
            fprintf(stderr, "usage: ranks FILE\n");
    }
    MPI_Finalize();
    return failed;
}
