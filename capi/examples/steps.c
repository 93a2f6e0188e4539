/* Draws the time steps of a simulation while it runs, on an unstructured grid whose values change: steps FILE
 * The file receives the picture of each of three steps (4 bytes a pixel), then the columns of the last (doubles). */
#include <stdio.h>
#include <stdlib.h>

#include "ewa_splat.h"

enum { N = 9, NODES = N * N * N, CELLS = (N - 1) * (N - 1) * (N - 1), WIDTH = 80, HEIGHT = 60 };

static float x[NODES], y[NODES], z[NODES], values[NODES];
static uint8_t types[CELLS];
static int64_t offsets[CELLS + 1], nodes[8 * CELLS];
static uint8_t picture[4 * WIDTH * HEIGHT];
static double columns[WIDTH * HEIGHT];

static void check(ewa_status status) {
    if (status != EWA_OK) {
        fprintf(stderr, "ewa_splat: %s\n", ewa_last_error());
        exit(1);
    }
}

/* The stage that is at work. Several threads may call at the same time. */
static void progress(const char *stage, double done, void *user) {
    (void)stage, (void)done;
    *(volatile int *)user = 1;
}

static void simulate(int step) {
    for (int i = 0; i < NODES; i++)
        values[i] = (float)((i % N + step) * (i / N % N)) / 16;
}

int main(int argc, char **argv) {
    FILE *file = argc == 2 ? fopen(argv[1], "wb") : NULL;
    if (!file) {
        fprintf(stderr, "usage: steps FILE\n");
        return 1;
    }
    for (int i = 0; i < NODES; i++) {
        x[i] = (float)(i % N);
        y[i] = (float)(i / N % N);
        z[i] = (float)(i / N / N) + x[i] / 16;
    }
    for (int cell = 0, k = 0; k < N - 1; k++)
        for (int j = 0; j < N - 1; j++)
            for (int i = 0; i < N - 1; i++, cell++) {
                /* A hexahedron (12): its lower face around, then its upper. */
                const int corner = (k * N + j) * N + i;
                const int around[8] = {0, 1, N + 1, N, N * N, N * N + 1, N * N + N + 1, N * N + N};
                for (int n = 0; n < 8; n++)
                    nodes[8 * cell + n] = corner + around[n];
                types[cell] = 12;
                offsets[cell + 1] = 8 * (cell + 1);
            }
    simulate(0);
    const ewa_points points = {.x = x, .y = y, .z = z, .count = NODES, .type = EWA_F32};
    const ewa_array kinds = {.data = types, .count = CELLS, .type = EWA_U8};
    const ewa_array starts = {.data = offsets, .count = CELLS + 1, .type = EWA_I64};
    const ewa_array corners = {.data = nodes, .count = 8 * CELLS, .type = EWA_I64};
    const ewa_array field = {.name = "load", .data = values, .count = NODES, .type = EWA_F32};
    ewa_scene *scene;
    check(ewa_scene_cells(&points, &kinds, &starts, &corners, &field, EWA_NODES, NULL, &scene));
    const ewa_scene *scenes[] = {scene};
    ewa_renderer *renderer;
    check(ewa_renderer_new(scenes, 1, "{\"backend\": \"cpu\", \"keep-shapes\": true}", &renderer));
    ewa_scene_free(scene); /* the renderer keeps its data */
    ewa_transfer *colours;
    check(ewa_transfer_colour_map("viridis", 0, 6, 1, &colours));
    check(ewa_renderer_set_transfer(renderer, colours));
    ewa_transfer_free(colours);
    int seen = 0;
    ewa_task *task;
    check(ewa_task_new(progress, &seen, &task));
    const ewa_buffers buffers = {.rgba8 = picture, .rgba8_count = sizeof picture};
    for (int step = 0; step < 3; step++) {
        simulate(step);
        check(ewa_renderer_set_values(renderer, 0, &field, task));
        check(ewa_render(renderer, NULL, NULL, WIDTH, HEIGHT, task, &buffers));
        fwrite(picture, sizeof picture, 1, file);
    }
    double pixel_area;
    check(ewa_columns(renderer, NULL, "{\"of\": \"load\"}", WIDTH, HEIGHT, task, EWA_F64, columns,
                      WIDTH * HEIGHT, &pixel_area));
    ewa_task_free(task);
    ewa_renderer_free(renderer);
    fwrite(columns, sizeof columns, 1, file);
    return fclose(file) || !seen || !(pixel_area > 0);
}
