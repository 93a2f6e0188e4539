/* Draws a deep image of particles, and puts another renderer's wall into it at several depths: deep FILE.exr FILE
 * The first file is OpenEXR's. The second one receives the number of samples of each pixel (size_t), their fronts and backs
 * (a float each) and colours (4 floats), the pixels before the wall, what a depth lets through, and depths of four kinds. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "ewa_splat.h"

enum { COUNT = 500, WIDTH = 48, HEIGHT = 36, PIXELS = WIDTH * HEIGHT };

static void check(ewa_status status) {
    if (status != EWA_OK) {
        fprintf(stderr, "ewa_splat: %s\n", ewa_last_error());
        exit(1);
    }
}

int main(int argc, char **argv) {
    static double places[COUNT][3], radii[COUNT];
    static float values[COUNT];
    for (int i = 0; i < COUNT; i++) {
        places[i][0] = (i * 7919 % 1000) / 1000.0;
        places[i][1] = (i * 104729 % 997) / 997.0;
        places[i][2] = (i * 1299709LL % 991) / 991.0;
        radii[i] = 0.02 + (i % 5) / 100.0;
        values[i] = (float)(i % 32);
    }
    FILE *file = argc == 3 ? fopen(argv[2], "wb") : NULL;
    if (!file) {
        fprintf(stderr, "usage: deep FILE.exr FILE\n");
        return 1;
    }
    ewa_points points = {
        .x = &places[0][0], .y = &places[0][1], .z = &places[0][2],
        .count = COUNT, .stride = sizeof places[0], .type = EWA_F64,
    };
    ewa_array columns[] = {
        {.name = "radius", .data = radii, .count = COUNT, .type = EWA_F64},
        {.name = "pressure", .data = values, .count = COUNT, .type = EWA_F32},
    };
    ewa_scene *scene;
    check(ewa_scene_points(&points, columns, 2, "{\"field\": \"pressure\"}", &scene));
    const ewa_scene *scenes[] = {scene};
    ewa_renderer *renderer;
    check(ewa_renderer_new(scenes, 1, "{\"backend\": \"cpu\"}", &renderer));
    const double eye[] = {2, -3, 2}, target[] = {.5, .5, .5};
    ewa_camera *camera;
    check(ewa_camera_perspective(eye, target, NULL, 35, &camera));
    ewa_deep *deep;
    check(ewa_render_deep(renderer, camera, "{\"tolerance\": 0.01}", WIDTH, HEIGHT, NULL, &deep));
    ewa_camera_free(camera);
    ewa_renderer_free(renderer);
    ewa_scene_free(scene);

    size_t n;
    check(ewa_deep_count(deep, &n));
    static size_t counts[PIXELS];
    float *samples = malloc(6 * n * sizeof *samples);
    if (!samples)
        return 1;
    check(ewa_deep_samples(deep, counts, samples, samples + n, samples + 2 * n, n));
    int written = fwrite(counts, sizeof counts, 1, file) == 1 && fwrite(samples, sizeof *samples, 6 * n, file) == 6 * n;
    free(samples);

    static float wall[PIXELS], rgba[4 * PIXELS], numbers[PIXELS];
    for (int i = 0; i < PIXELS; i++)
        wall[i] = i % WIDTH < WIDTH / 2 ? 3.2f : INFINITY;
    check(ewa_deep_before(deep, wall, rgba, PIXELS));
    written = written && fwrite(rgba, sizeof rgba, 1, file) == 1;
    check(ewa_deep_transmittance(deep, 3.5f, numbers, PIXELS));
    written = written && fwrite(numbers, sizeof numbers, 1, file) == 1;
    const char *kinds[] = {"half", "entry", "exit", "mean"};
    for (int i = 0; i < 4; i++) {
        check(ewa_deep_depth(deep, kinds[i], numbers, PIXELS));
        written = written && fwrite(numbers, sizeof numbers, 1, file) == 1;
    }
    check(ewa_deep_write(deep, argv[1]));
    ewa_deep_free(deep);
    if (!written || fclose(file)) {
        fprintf(stderr, "deep: the file cannot be written\n");
        return 1;
    }
    return 0;
}
