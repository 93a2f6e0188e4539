/* Bad input, cancelled work and every function of the header: errors with texts, and no crash. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "ewa_splat.h"

_Static_assert(sizeof(ewa_array) == 40 && offsetof(ewa_array, type) == 32, "layout");
_Static_assert(sizeof(ewa_points) == 48 && offsetof(ewa_points, type) == 40, "layout");
_Static_assert(sizeof(ewa_buffers) == 64 && offsetof(ewa_buffers, normals) == 48, "layout");

static int failures = 0;

/* Checks that a call fails with this code and this part of its text. */
static void fails(int line, ewa_status found, ewa_status expected, const char *part) {
    if (found != expected || !strstr(ewa_last_error(), part)) {
        printf("line %d: expected %d \"%s\", found %d \"%s\"\n", line, expected, part, found, ewa_last_error());
        failures++;
    }
}
#define FAILS(call, status, part) fails(__LINE__, call, status, part)
#define INVALID(call, part) FAILS(call, EWA_INVALID, part)
#define GOOD(call) fails(__LINE__, call, EWA_OK, "")

/* Cancels its own work. */
static void stop(const char *stage, double done, void *user) {
    if (*stage && done >= 0)
        ewa_task_cancel(*(ewa_task **)user);
}

int main(void) {
    float places[] = {0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1}, values[] = {1, 2, 3, 4};
    const size_t row = 3 * sizeof(float), far = (size_t)-1;
    const ewa_points points = {places, places + 1, places + 2, 4, row, EWA_F32};
    const ewa_array field = {"v", values, 4, 0, EWA_F32};
    double corner[3];
    ewa_scene *scene = NULL, *none = (ewa_scene *)1;

    GOOD(ewa_abi_version() == EWA_ABI_VERSION ? EWA_OK : EWA_INVALID);
    GOOD(strcmp(ewa_version(), "0.1.0") ? EWA_INVALID : EWA_OK);
    INVALID(ewa_scene_points(NULL, NULL, 0, NULL, &none), "points");
    GOOD(none ? EWA_INVALID : EWA_OK);
    INVALID(ewa_scene_points(&points, NULL, 0, NULL, NULL), "out");
    INVALID(ewa_scene_points(&points, NULL, 1, NULL, &none), "columns");
    const ewa_points no_data = {NULL, places, places, 4, row, EWA_F32};
    INVALID(ewa_scene_points(&no_data, NULL, 0, NULL, &none), "x: expected a pointer");
    const ewa_points no_type = {places, places, places, 4, row, 77};
    INVALID(ewa_scene_points(&no_type, NULL, 0, NULL, &none), "type from 0 to 6");
    const ewa_points whole = {places, places, places, 1, 0, EWA_I32};
    INVALID(ewa_scene_points(&whole, NULL, 0, NULL, &none), "EWA_F32 or EWA_F64");
    const ewa_points endless = {places, places, places, far, row, EWA_F32};
    FAILS(ewa_scene_points(&endless, NULL, 0, NULL, &none), EWA_OUT_OF_MEMORY, "memory");
    const ewa_array few = {"v", values, 3, 0, EWA_F32};
    INVALID(ewa_scene_points(&points, &few, 1, NULL, &none), "3");
    const ewa_array twice[] = {field, field};
    INVALID(ewa_scene_points(&points, twice, 2, NULL, &none), "two");
    INVALID(ewa_scene_points(&points, &field, 1, "{\"kernel_widht\": 1}", &none), "did you mean kernel_width?");
    INVALID(ewa_scene_points(&points, &field, 1, "{\"up\": 1, \"up\": 2}", &none), "twice");
    INVALID(ewa_scene_points(&points, &field, 1, "[]", &none), "JSON");
    INVALID(ewa_scene_points(&points, &field, 1, "{\"up\": \"z\"}", &none), "array of 3 numbers");
    INVALID(ewa_scene_points(&points, &field, 1, "\xff", &none), "UTF-8");

    const size_t dims[] = {2, 2, 1}, big[] = {far, far, 2};
    INVALID(ewa_scene_grid(NULL, NULL, NULL, NULL, &field, EWA_NODES, NULL, &none), "dims");
    INVALID(ewa_scene_grid(big, NULL, NULL, NULL, &field, EWA_NODES, NULL, &none), "dims");
    INVALID(ewa_scene_grid(dims, NULL, NULL, NULL, &field, 9, NULL, &none), "EWA_CELLS");
    INVALID(ewa_scene_grid(dims, NULL, NULL, NULL, &field, EWA_NODES, "{\"field\": \"u\"}", &none), "found u");
    const int64_t numbers[4] = {0};
    const ewa_array long_values = {"v", numbers, 4, 0, EWA_I64};
    INVALID(ewa_scene_grid(dims, NULL, NULL, NULL, &long_values, EWA_NODES, NULL, &none), "EWA_I64");
    INVALID(ewa_scene_rectilinear(&field, &field, NULL, &field, EWA_NODES, NULL, &none), "z");
    INVALID(ewa_scene_structured(dims, NULL, &field, EWA_NODES, NULL, &none), "points");

    const uint8_t kinds[] = {10};
    int32_t starts[] = {0, 4}, corners[] = {0, 1, 2, 3};
    const ewa_array types = {NULL, kinds, 1, 0, EWA_U8}, offsets = {NULL, starts, 2, 0, EWA_I32};
    const ewa_array connectivity = {NULL, corners, 4, 0, EWA_I32};
    INVALID(ewa_scene_cells(&points, &types, &types, &connectivity, &field, EWA_NODES, NULL, &none), "EWA_I32");
    INVALID(ewa_scene_cells(&points, &types, &connectivity, &connectivity, &field, EWA_NODES, NULL, &none), "offsets");
    starts[1] = -4;
    INVALID(ewa_scene_cells(&points, &types, &offsets, &connectivity, &field, EWA_NODES, NULL, &none), "rise");
    starts[1] = 4, corners[3] = 7;
    FAILS(ewa_scene_cells(&points, &types, &offsets, &connectivity, &field, EWA_NODES, NULL, &none), EWA_FORMAT, "7");
    corners[3] = 3;
    GOOD(ewa_scene_cells(&points, &types, &offsets, &connectivity, &field, EWA_NODES, NULL, &scene));
    ewa_scene_free(scene);

    /* What holds nothing, as on some ranks, is a scene; alone it cannot be drawn. */
    const ewa_points no_points = {NULL, NULL, NULL, 0, 0, EWA_F64};
    const ewa_array nothing = {"v", NULL, 0, 0, EWA_F32}, no_types = {NULL, NULL, 0, 0, EWA_U8};
    const ewa_array no_offsets = {NULL, starts, 1, 0, EWA_I32}, no_corners = {NULL, NULL, 0, 0, EWA_I32};
    const size_t no_dims[] = {0, 0, 0};
    ewa_scene *empty_scenes[4] = {NULL};
    GOOD(ewa_scene_points(&no_points, &nothing, 1, NULL, &empty_scenes[0]));
    GOOD(ewa_scene_cells(&no_points, &no_types, &no_offsets, &no_corners, &nothing, EWA_NODES, NULL, &empty_scenes[1]));
    GOOD(ewa_scene_grid(no_dims, NULL, NULL, NULL, &nothing, EWA_NODES, NULL, &empty_scenes[2]));
    GOOD(ewa_scene_structured(no_dims, &no_points, &nothing, EWA_CELLS, NULL, &empty_scenes[3]));
    for (int i = 0; i < 4; i++) {
        const ewa_scene *alone[] = {empty_scenes[i]};
        ewa_renderer *of_nothing = NULL;
        float pixel[4];
        const ewa_buffers small_ones = {.rgba = pixel, .rgba_count = 4};
        GOOD(ewa_renderer_new(alone, 1, "{\"backend\": \"cpu\"}", &of_nothing));
        FAILS(ewa_render(of_nothing, NULL, NULL, 1, 1, NULL, &small_ones), EWA_FORMAT, "");
        INVALID(ewa_scene_bounds(alone[0], corner, corner), "none");
        ewa_renderer_free(of_nothing);
        ewa_scene_free(empty_scenes[i]);
    }

    INVALID(ewa_scene_mesh(&points, &connectivity, NULL, NULL, 0, NULL, &none), "three");
    const ewa_array triangle = {NULL, corners, 3, 0, EWA_I32};
    INVALID(ewa_scene_mesh(&points, &triangle, &field, NULL, 0, NULL, &none), "16 numbers");
    FAILS(ewa_scene_file("/nowhere/at.all", NULL, &none), EWA_IO, "/nowhere/at.all");
    INVALID(ewa_scene_file(NULL, NULL, &none), "path");
    INVALID(ewa_scene_bounds(NULL, NULL, NULL), "scene");

    ewa_transfer *transfer = NULL;
    FAILS(ewa_transfer_json("{}", &transfer), EWA_FORMAT, "points");
    INVALID(ewa_transfer_colour_map("parula", 0, 1, 0, &transfer), "viridis");
    INVALID(ewa_transfer_colour_map("viridis", 1, 0, 0, &transfer), "range");
    GOOD(ewa_transfer_colour_map("viridis", 0, 1, 0, &transfer));

    const double eye[] = {0, -5, 0}, target[] = {0, 0, 0}, unit[] = {1, 0, 0, 0, 0, -1, 0, 1, 0}, focal[] = {40, 40};
    ewa_camera *camera = NULL, *odd = NULL;
    INVALID(ewa_camera_perspective(eye, NULL, NULL, 30, &camera), "target");
    INVALID(ewa_camera_perspective(eye, target, NULL, 180, &camera), "fov_deg");
    INVALID(ewa_camera_orthographic(eye, target, NULL, -1, &camera), "height");
    INVALID(ewa_camera_along("w", NULL, 0, &camera), "axis");
    INVALID(ewa_camera_calibrated(eye, unit, focal, NULL, 0, 8, 0, &camera), "size");
    GOOD(ewa_camera_calibrated(eye, unit, focal, NULL, 8, 8, 0, &camera));
    INVALID(ewa_camera_perspective(eye, eye, NULL, 30, &odd), "two different points");
    const double not[] = {NAN, 0, 0}, zeros[9] = {0};
    INVALID(ewa_camera_orthographic(not, target, NULL, 1, &odd), "finite");
    GOOD(ewa_camera_calibrated(eye, zeros, focal, NULL, 8, 8, 0, &odd));

    ewa_renderer *renderer = NULL;
    GOOD(ewa_scene_points(&points, &field, 1, "{\"field\": \"v\"}", &scene));
    double low[3], high[3];
    GOOD(ewa_scene_bounds(scene, low, high));
    GOOD(low[0] == 0 && high[2] == 1 ? EWA_OK : EWA_INVALID);
    const ewa_scene *scenes[] = {scene, NULL};
    INVALID(ewa_renderer_new(scenes, 0, NULL, &renderer), "scenes");
    INVALID(ewa_renderer_new(scenes, 2, NULL, &renderer), "scenes");
    INVALID(ewa_renderer_new(scenes, 1, "{\"backend\": \"tpu\"}", &renderer), "auto, gpu, cpu");
    GOOD(ewa_renderer_new(scenes, 1, "{\"backend\": \"cpu\"}", &renderer));
    ewa_scene_free(scene);

    float rgba[4 * 64], depth[64];
    const ewa_buffers good = {.rgba = rgba, .rgba_count = 4 * 64}, empty = {0};
    const ewa_buffers small = {.rgba = rgba, .rgba_count = 4 * 63}, missing = {.depth_count = 64};
    INVALID(ewa_render(NULL, NULL, NULL, 8, 8, NULL, &good), "renderer");
    INVALID(ewa_render(renderer, NULL, NULL, 8, 8, NULL, NULL), "buffers");
    INVALID(ewa_render(renderer, NULL, NULL, 8, 8, NULL, &empty), "buffers");
    INVALID(ewa_render(renderer, NULL, NULL, 8, 8, NULL, &small), "256 numbers, found 252");
    INVALID(ewa_render(renderer, NULL, NULL, 8, 8, NULL, &missing), "depth");
    const ewa_buffers no_pixel = {.rgba = rgba};
    INVALID(ewa_render(renderer, NULL, NULL, 0, 8, NULL, &no_pixel), "size");
    INVALID(ewa_render(renderer, NULL, NULL, far, far, NULL, &good), "rgba");
    INVALID(ewa_render(renderer, NULL, "{\"composit\": \"over\"}", 8, 8, NULL, &good), "did you mean composite?");
    INVALID(ewa_render(renderer, NULL, "{\"composite\": \"under\"}", 8, 8, NULL, &good), "slabs");
    INVALID(ewa_render(renderer, NULL, "{\"tolerance\": 2}", 8, 8, NULL, &good), "tolerance");
    INVALID(ewa_render(renderer, NULL, "{\"depth\": true}", 8, 8, NULL, &good), "depth");
    INVALID(ewa_render(renderer, odd, NULL, 8, 8, NULL, &good), "camera");
    float no_depth[64];
    for (int i = 0; i < 64; i++) no_depth[i] = 0.0f / 0.0f;
    const ewa_background short_of = {no_depth, 63, NULL, 0}, not_there = {NULL, 64, NULL, 0}, nan = {no_depth, 64, NULL, 0};
    INVALID(ewa_render_over(renderer, camera, NULL, 8, 8, &short_of, NULL, &good), "64 numbers, found 63");
    INVALID(ewa_render_over(renderer, camera, NULL, 8, 8, &not_there, NULL, &good), "depth of the background");
    INVALID(ewa_render_over(renderer, camera, NULL, 8, 8, &nan, NULL, &good), "NaN");
    INVALID(ewa_render(renderer, camera, "{\"background_depth_is\": \"distance\"}", 8, 8, NULL, &good), "backdrop");
    INVALID(ewa_render(renderer, camera, "{\"background_depth_is\": \"opengl\"}", 8, 8, NULL, &good), "near");
    GOOD(ewa_render(renderer, camera, NULL, 8, 8, NULL, &good));
    GOOD(*ewa_last_error() ? EWA_INVALID : EWA_OK);

    INVALID(ewa_columns(renderer, NULL, NULL, 8, 8, NULL, EWA_U8, depth, 64, NULL), "type");
    INVALID(ewa_columns(renderer, NULL, NULL, 8, 8, NULL, EWA_F32, NULL, 0, NULL), "values");
    INVALID(ewa_columns(renderer, NULL, NULL, 8, 8, NULL, EWA_F32, depth, 63, NULL), "64");
    INVALID(ewa_columns(renderer, NULL, "{\"lit\": true}", 8, 8, NULL, EWA_F32, depth, 64, NULL), "lit");
    FAILS(ewa_columns(renderer, NULL, "{\"of\": \"w\"}", 8, 8, NULL, EWA_F32, depth, 64, NULL), EWA_FORMAT, "`w`");
    GOOD(ewa_columns(renderer, NULL, "{\"of\": \"v\"}", 8, 8, NULL, EWA_F32, depth, 64, NULL));

    INVALID(ewa_renderer_set_values(renderer, 1, &field, NULL), "scene");
    INVALID(ewa_renderer_set_values(renderer, 0, &few, NULL), "4");
    GOOD(ewa_renderer_set_values(renderer, 0, &field, NULL));
    GOOD(ewa_renderer_set_transfer(renderer, transfer));
    GOOD(ewa_render(renderer, camera, NULL, 8, 8, NULL, &good));
    char name[8];
    GOOD(ewa_renderer_adapter(renderer, name, sizeof name));
    INVALID(ewa_renderer_adapter(renderer, name, 0), "1 bytes");

    ewa_task *task = NULL;
    GOOD(ewa_task_new(stop, &task, &task));
    GOOD(ewa_renderer_set_transfer(renderer, NULL));
    GOOD(ewa_renderer_set_values(renderer, 0, &field, NULL));
    FAILS(ewa_render(renderer, camera, NULL, 8, 8, task, &good), EWA_CANCELLED, "cancelled");
    GOOD(ewa_render(renderer, camera, NULL, 8, 8, NULL, &good));
    INVALID(ewa_task_cancel(NULL), "task");

    ewa_deep *deep = NULL, *no_deep = (ewa_deep *)1;
    size_t sample_count = 0;
    float pixels[4 * 64];
    INVALID(ewa_render_deep(NULL, NULL, NULL, 8, 8, NULL, &no_deep), "renderer");
    GOOD(no_deep ? EWA_INVALID : EWA_OK);
    INVALID(ewa_render_deep(renderer, camera, NULL, 8, 8, NULL, NULL), "out");
    INVALID(ewa_render_deep(renderer, camera, NULL, 0, 8, NULL, &no_deep), "size");
    INVALID(ewa_render_deep(renderer, camera, "{\"legend\": true}", 8, 8, NULL, &no_deep), "deep images");
    INVALID(ewa_render_deep(renderer, camera, "{\"composite\": \"maximum\"}", 8, 8, NULL, &no_deep), "maximum");
    FAILS(ewa_render_deep(renderer, camera, NULL, 8, 8, task, &no_deep), EWA_CANCELLED, "cancelled");
    GOOD(ewa_render_deep(renderer, camera, NULL, 8, 8, NULL, &deep));
    INVALID(ewa_deep_count(NULL, &sample_count), "deep");
    INVALID(ewa_deep_count(deep, NULL), "count");
    GOOD(ewa_deep_count(deep, &sample_count));
    INVALID(ewa_deep_samples(deep, NULL, NULL, NULL, NULL, sample_count + 1), "count");
    GOOD(ewa_deep_samples(deep, NULL, NULL, NULL, NULL, sample_count));
    INVALID(ewa_deep_before(deep, NULL, pixels, 63), "expected 64");
    INVALID(ewa_deep_before(deep, NULL, NULL, 64), "rgba");
    GOOD(ewa_deep_before(deep, NULL, pixels, 64));
    INVALID(ewa_deep_transmittance(deep, 1, pixels, 65), "expected 64");
    GOOD(ewa_deep_transmittance(deep, NAN, pixels, 64));
    INVALID(ewa_deep_depth(deep, "middle", pixels, 64), "median");
    INVALID(ewa_deep_depth(deep, NULL, pixels, 64), "kind");
    GOOD(ewa_deep_depth(deep, "median", pixels, 64));
    INVALID(ewa_deep_write(deep, NULL), "path");
    FAILS(ewa_deep_write(deep, "/nowhere/deep.exr"), EWA_FORMAT, "/nowhere");
    FAILS(ewa_deep_write(deep, "deep.png"), EWA_FORMAT, "exr");
    ewa_deep_free(deep);
    ewa_deep_free(NULL);
    ewa_renderer *shared = (ewa_renderer *)1;
    FAILS(ewa_renderer_new_mpi(NULL, 0, 0, NULL, &shared), EWA_UNSUPPORTED, "--features mpi");
    GOOD(shared ? EWA_INVALID : EWA_OK);

    ewa_task_free(task);
    ewa_renderer_free(renderer);
    ewa_camera_free(camera);
    ewa_camera_free(odd);
    ewa_transfer_free(transfer);
    ewa_scene_free(NULL);
    ewa_renderer_free(NULL);
    printf("%d failures\n", failures);
    return failures != 0;
}
