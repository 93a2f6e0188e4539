/* Draws particles with radii and values to a buffer, with their depths: points FILE
 * The file receives the pixels (4 floats each), the depths (1 each) and the pixels with a wall, rows from the top. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "ewa_splat.h"

enum { COUNT = 500, WIDTH = 96, HEIGHT = 72, PIXELS = WIDTH * HEIGHT };

static float rgba[4 * PIXELS], depth[PIXELS];

static void check(ewa_status status) {
    if (status != EWA_OK) {
        fprintf(stderr, "ewa_splat: %s\n", ewa_last_error());
        exit(1);
    }
}

int main(int argc, char **argv) {
    double places[COUNT][3], radii[COUNT];
    float values[COUNT];
    for (int i = 0; i < COUNT; i++) {
        places[i][0] = (i * 7919 % 1000) / 1000.0;
        places[i][1] = (i * 104729 % 997) / 997.0;
        places[i][2] = (i * 1299709LL % 991) / 991.0;
        radii[i] = 0.02 + (i % 5) / 100.0;
        values[i] = (float)(i % 32);
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
    ewa_buffers buffers = {
        .rgba = rgba, .rgba_count = 4 * PIXELS, .depth = depth, .depth_count = PIXELS,
    };
    check(ewa_render(renderer, camera, "{\"tolerance\": 0.01}", WIDTH, HEIGHT, NULL, &buffers));

    /* The same in front of a red wall, which another renderer drew in the left half. */
    static float wall[4 * PIXELS], wall_depth[PIXELS], over[4 * PIXELS];
    for (int i = 0; i < PIXELS; i++) {
        int is_wall = i % WIDTH < WIDTH / 2;
        wall_depth[i] = is_wall ? 3.2f : INFINITY;
        wall[4 * i] = wall[4 * i + 3] = (float)is_wall;
    }
    const ewa_background behind = {
        .depth = wall_depth, .depth_count = PIXELS, .rgba = wall, .rgba_count = 4 * PIXELS,
    };
    buffers = (ewa_buffers){.rgba = over, .rgba_count = 4 * PIXELS};
    check(ewa_render_over(renderer, camera, "{\"tolerance\": 0.01}", WIDTH, HEIGHT, &behind, NULL, &buffers));
    ewa_camera_free(camera);
    ewa_renderer_free(renderer);
    ewa_scene_free(scene);

    FILE *file = argc == 2 ? fopen(argv[1], "wb") : NULL;
    if (!file || fwrite(rgba, sizeof rgba, 1, file) != 1 || fwrite(depth, sizeof depth, 1, file) != 1 ||
        fwrite(over, sizeof over, 1, file) != 1 || fclose(file)) {
        fprintf(stderr, "usage: points FILE\n");
        return 1;
    }
    return 0;
}
