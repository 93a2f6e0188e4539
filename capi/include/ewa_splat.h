/* ewa_splat.h: draws point volumes, grids, cells and meshes into the caller's buffers.
 *
 * Link with libewa_splat (docs/c.md). Written by hand; tests compare it with the library.
 *
 * Errors
 *   Functions that return an ewa_status return EWA_OK (0) or the code of an error. ewa_last_error() returns the text of
 *   the calling thread's last such call, empty after EWA_OK. Null pointers, wrong counts, unknown names and broken
 *   files are errors. No panic of the library crosses this interface: it is EWA_INTERNAL.
 *
 * Memory
 *   A function that ends in `out` stores a handle there, and NULL if it fails. The caller frees the handle by the
 *   function of its type; NULL may be freed. Arrays and texts are copied during the call. A renderer keeps the data of its
 *   scenes, so scenes, cameras, transfer functions and tasks may be freed in any order once a call has returned.
 *   Nothing else may be freed or kept: ewa_last_error()'s text lasts until the thread's next call.
 *
 * Threads
 *   Every function may be called from any thread. A handle may be used by several threads at the same time, but it may be freed
 *   only when no call uses it. Calls on one renderer wait for one another. Work runs on a pool of threads that the
 *   process shares (RAYON_NUM_THREADS sets their number). The GPU cannot be used in a process that was forked from one that
 *   has drawn.
 *
 * Ranks
 *   Processes of an MPI job may hold one set of data in parts (ewa_renderer_new_mpi). All ranks call the functions that
 *   take such a renderer, but for ewa_renderer_adapter, in the same order with the same settings, and free it together. The
 *   first rank alone gets pictures. An error on one rank is an error on all: EWA_OTHER_RANK, with the text and the number of
 *   the rank, where the fault is not. Other ranks may be left waiting by EWA_INTERNAL, a NULL
 *   renderer, and a communicator that one rank refuses: end the job then, by MPI_Abort.
 *
 * Settings
 *   Settings and options are JSON objects in UTF-8: {"tolerance": 0.01, "composite": "slabs"}. NULL and "" are none.
 *   Names are the command line's; `-` and `_` are the same. A name that is unknown is an error, which names the nearest.
 *
 * Numbers
 *   World units are the caller's. The world is right-handed. Pictures have rows from the top; colours are linear and
 *   premultiplied by alpha (RGBA of float), or sRGB-encoded and not premultiplied (RGBA of bytes).
 */
#ifndef EWA_SPLAT_H
#define EWA_SPLAT_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* The version of this interface; it rises when compiled callers must be compiled again. */
#define EWA_ABI_VERSION 1

typedef int32_t ewa_status;
enum {
    EWA_OK = 0,
    EWA_INVALID = 1,       /* an argument or a setting that does not fit */
    EWA_IO = 2,            /* a file that cannot be read */
    EWA_FORMAT = 3,        /* contents of data or of a file that cannot be used, or lack a field */
    EWA_NO_ADAPTER = 4,    /* no GPU, or one that does not open */
    EWA_OUT_OF_MEMORY = 5,
    EWA_DEVICE_LOST = 6,   /* the GPU no longer answers */
    EWA_UNSUPPORTED = 7,   /* the GPU cannot draw this; the CPU can */
    EWA_CANCELLED = 8,     /* the task was cancelled */
    EWA_INTERNAL = 9,      /* a fault of the library */
    EWA_OTHER_RANK = 10    /* another rank of an MPI job has failed */
};

/* Types of numbers. */
typedef int32_t ewa_type;
enum { EWA_F64 = 0, EWA_F32 = 1, EWA_U8 = 2, EWA_I16 = 3, EWA_U16 = 4, EWA_I32 = 5, EWA_I64 = 6 };

/* The places that values belong to. */
typedef int32_t ewa_association;
enum { EWA_NODES = 0, EWA_CELLS = 1 };

/* Numbers in memory. Values may have any type but EWA_I64. */
typedef struct ewa_array {
    const char *name;  /* name of a field or column; NULL is "value". Not read of arrays that are no field. */
    const void *data;  /* the first number; no alignment is needed */
    size_t count;      /* number of numbers */
    size_t stride;     /* bytes from one number to the next; 0 for numbers without gaps */
    ewa_type type;
} ewa_array;

/* Positions. For rows of x, y, z: pointers to the first three numbers, and the size of three as the stride. */
typedef struct ewa_points {
    const void *x, *y, *z;
    size_t count;      /* number of points */
    size_t stride;     /* bytes from one point's coordinate to the next point's; 0 for three arrays without gaps */
    ewa_type type;     /* EWA_F32 or EWA_F64 */
} ewa_points;

/* The caller's buffers for a picture, with their exact sizes. NULL and 0: not wanted; at least one must be. */
typedef struct ewa_buffers {
    float *rgba;          /* 4 per pixel, linear and premultiplied */
    size_t rgba_count;
    uint8_t *rgba8;       /* 4 per pixel, sRGB-encoded, not premultiplied */
    size_t rgba8_count;
    float *depth;         /* 1 per pixel, along the view, world units; infinity where over half of the light passes */
    size_t depth_count;
    float *normals;       /* 3 per pixel, of opaque surfaces; 0 elsewhere */
    size_t normals_count;
} ewa_buffers;

/* What another renderer drew from the same camera, row by row, with exact sizes. NULL and 0: not there. */
typedef struct ewa_background {
    const float *depth;   /* 1 per pixel; volumes and splats end there. Along the view, world units, infinite where nothing
                             stands; or what the settings "background_depth_is" ("distance" along rays, "opengl") and
                             "background_depth_range" ([near, far], of opengl) say */
    size_t depth_count;
    const float *rgba;    /* 4 per pixel, linear and premultiplied: it stands behind the scene */
    size_t rgba_count;
} ewa_background;

typedef struct ewa_scene ewa_scene;        /* data with the options that turn them into kernels */
typedef struct ewa_transfer ewa_transfer;  /* transfer function: values to colours and opacities */
typedef struct ewa_camera ewa_camera;
typedef struct ewa_renderer ewa_renderer;  /* scenes and the kernels made of them */
typedef struct ewa_deep ewa_deep;          /* deep image: colours and opacities along the ray of each pixel */
typedef struct ewa_task ewa_task;          /* progress and cancelling */

/* The library's version, "0.1.0", and that of its interface: compare it with EWA_ABI_VERSION. */
const char *ewa_version(void);
int32_t ewa_abi_version(void);
/* The text of the calling thread's last error. Never NULL. */
const char *ewa_last_error(void);

/* Tasks. An observer is called at each stage's start and at every thousandth of it, from any thread and from several at
 * the same time; the work waits for it. It must not throw, nor call with the renderer that is drawing. `stage` is text,
 * which lasts during the call; `done` is the finished share of the stage, 0 to 1. `observer` may be NULL. */
typedef void (*ewa_observer)(const char *stage, double done, void *user);
ewa_status ewa_task_new(ewa_observer observer, void *user, ewa_task **out);
/* Ends the work that has this task with EWA_CANCELLED, soon. From any thread. A cancelled task stays cancelled. */
ewa_status ewa_task_cancel(const ewa_task *task);
void ewa_task_free(ewa_task *task);

/* Scenes. `options` are the sampling options of docs/python.md: "kernel_width", "transfer_function" (an object, a colour
 * map's name or a file's path), "range", "scale", "up", "field", "boundary", "kernel", "length", "box", ...
 * `values` with its name is the field that is shown, at nodes or in cells (`of`). */

/* Particles. Columns mean what their names say in tables, all with as many numbers as points:
 *   radius (standard deviation) or h (SPH); vxx, vxy, vxz, vyy, vyz, vzz (variance); scale_0, scale_1, scale_2 with
 *   rot_0 ... rot_3 (w, x, y, z); m (mass) or mass (extinction times volume); volume; opacity; r, g, b; other names are fields,
 *   of which the option "field" names the one that is shown. Without lengths, the neighbours determine sizes. */
ewa_status ewa_scene_points(const ewa_points *points, const ewa_array *columns, size_t column_count,
                            const char *options, ewa_scene **out);
/* A regular grid; x is the fastest index. `dims`: 3 counts of nodes. `origin` (3 numbers, NULL: 0), `spacing` (3, NULL: 1),
 * `direction` (9, row by row, whose columns are the directions of the axes; NULL: x, y, z). */
ewa_status ewa_scene_grid(const size_t *dims, const double *origin, const double *spacing, const double *direction,
                          const ewa_array *values, ewa_association of, const char *options, ewa_scene **out);
/* A rectilinear grid, by its coordinates along x, y and z. */
ewa_status ewa_scene_rectilinear(const ewa_array *x, const ewa_array *y, const ewa_array *z, const ewa_array *values,
                                 ewa_association of, const char *options, ewa_scene **out);
/* A curvilinear grid of one block; i is the fastest index. `dims`: 3 counts of nodes. */
ewa_status ewa_scene_structured(const size_t *dims, const ewa_points *points, const ewa_array *values,
                                ewa_association of, const char *options, ewa_scene **out);
/* An unstructured grid in VTK's arrays: `types` (EWA_U8) are VTK's numbers of kinds, `offsets` one more than cells, from 0 to
 * the count of `connectivity` (both EWA_I32 or EWA_I64). Polyhedra (42) list faces: their number, then for each its number
 * of nodes and these. */
ewa_status ewa_scene_cells(const ewa_points *points, const ewa_array *types, const ewa_array *offsets,
                           const ewa_array *connectivity, const ewa_array *values, ewa_association of,
                           const char *options, ewa_scene **out);
/* Triangles: three indices each (EWA_I32 or EWA_I64). `colours` (4 numbers a vertex: linear RGBA) or `values` or neither;
 * NULL for those that are not given. */
ewa_status ewa_scene_mesh(const ewa_points *points, const ewa_array *triangles, const ewa_array *colours,
                          const ewa_array *values, ewa_association of, const char *options, ewa_scene **out);
/* A file in any format that the library reads: all parts of its first time step, or of "time_step" or "time". Further options:
 * "dims", "type", "spacing", "origin", "big_endian" of raw volumes, "particle_types", "solution", "texture", "read_as", "scales". */
ewa_status ewa_scene_file(const char *path, const char *options, ewa_scene **out);
/* The least and the greatest coordinates, 3 numbers each. */
ewa_status ewa_scene_bounds(const ewa_scene *scene, double *low, double *high);
void ewa_scene_free(ewa_scene *scene);

/* Transfer functions: the text of a JSON file; or a colour map over a range, with an opacity that rises from 0 to 0.2
 * per `unit_distance` (world units; 0 for that of the data). */
ewa_status ewa_transfer_json(const char *json, ewa_transfer **out);
ewa_status ewa_transfer_colour_map(const char *name, double low, double high, double unit_distance, ewa_transfer **out);
void ewa_transfer_free(ewa_transfer *transfer);

/* Cameras. Vectors have 3 numbers. NULL in place of a camera is one fitted to the data; for columns, one along z. */
/* Fitted to the data; NAN for defaults of angles (degrees) and zoom. */
ewa_status ewa_camera_fitted(double azimuth_deg, double elevation_deg, double zoom, int32_t orthographic,
                             ewa_camera **out);
/* From an eye to a target. `up`: NULL for that of the data. `fov_deg`: vertical; `height`: of the picture, world units. */
ewa_status ewa_camera_perspective(const double *eye, const double *target, const double *up, double fov_deg,
                                  ewa_camera **out);
ewa_status ewa_camera_orthographic(const double *eye, const double *target, const double *up, double height,
                                   ewa_camera **out);
/* Orthographic along "x", "y", "z", "-x", "-y" or "-z". `centre`: the point in the middle of the picture, NULL for that of the
 * data; `width`: of the picture, world units, 0 for that of the data. */
ewa_status ewa_camera_along(const char *axis, const double *centre, double width, ewa_camera **out);
/* Calibrated for a picture of this size. `rotation`: 9 numbers, rows right, down, forward; `focal_px`: 2; `centre_px`: 2, NULL
 * for the middle. */
ewa_status ewa_camera_calibrated(const double *eye, const double *rotation, const double *focal_px,
                                 const double *centre_px, size_t width, size_t height, int32_t orthographic,
                                 ewa_camera **out);
void ewa_camera_free(ewa_camera *camera);

/* A renderer of scenes. `options`: "backend" ("auto", "gpu", "cpu"); "keep_shapes": true makes ewa_renderer_set_values
 * quick, for more memory. */
ewa_status ewa_renderer_new(const ewa_scene *const *scenes, size_t scene_count, const char *options,
                            ewa_renderer **out);
/* A renderer of data of which each rank of an MPI communicator holds a part. Every rank gives as many scenes, made by the same
 * functions with the same options; a rank without data gives empty ones (no points, no cells, `dims` of 0). Scenes of one number
 * are parts of each other:
 * - Points are one data set, sampled as one process samples all, rank after rank. The ranks exchange neighbours: give no ghosts.
 * - Cells are one mesh: give each cell on one rank, and the nodes of a face with the same coordinates on every rank that
 *   has it. The ranks exchange ghost cells themselves. If kernels are cut at the boundary (option "boundary"), the parts are
 *   data sets of their own.
 * - Grids (regular, rectilinear, structured), and triangles, are data sets of their own, as several scenes of one process are,
 *   which share the transfer function. Blocks that adjoin have the nodes of their common face on both ranks, and no cell
 *   twice: then no seam shows (docs/c.md).
 * `communicator`: its Fortran handle, MPI_Comm_c2f(comm). It stays the host's; the library uses a duplicate. MPI runs with
 * MPI_THREAD_SERIALIZED, or the calling thread is the one that started it. The renderer is freed before MPI_Finalize. `options`:
 * "backend" ("auto" and "cpu" are processors). Without MPI in the library: EWA_UNSUPPORTED. */
ewa_status ewa_renderer_new_mpi(const ewa_scene *const *scenes, size_t scene_count, int32_t communicator,
                                const char *options, ewa_renderer **out);
void ewa_renderer_free(ewa_renderer *renderer);
/* Replaces the values of the field that scene number `scene` shows, by as many others. The renderer does not sample the data
 * again if it keeps shapes. The scene's own handle keeps its values. `task` may be NULL. */
ewa_status ewa_renderer_set_values(ewa_renderer *renderer, size_t scene, const ewa_array *values, const ewa_task *task);
/* Sets the transfer function of all scenes; NULL for their own. */
ewa_status ewa_renderer_set_transfer(ewa_renderer *renderer, const ewa_transfer *transfer);
/* Writes the name of the adapter that draws, which ends in 0; empty for the CPU, and before the first picture. */
ewa_status ewa_renderer_adapter(const ewa_renderer *renderer, char *buffer, size_t capacity);

/* Draws a picture to the caller's buffers; they keep their contents if it fails. `camera` and `task` may be NULL. `settings`:
 * "tolerance", "composite", "slab_thickness", "classify", "lit", "lights", "shadows", "shadow_softness", "aperture", "focus", "clip",
 * "background", "legend", "low_pass", "filter", "transfer_function", ... as in docs/python.md. On ranks, the buffers of the first one count; others may pass NULL. */
ewa_status ewa_render(ewa_renderer *renderer, const ewa_camera *camera, const char *settings, size_t width,
                      size_t height, const ewa_task *task, const ewa_buffers *buffers);
/* As ewa_render, in front of what another renderer drew, and behind it. `background` may be NULL; on ranks, that of the first one
 * counts. */
ewa_status ewa_render_over(ewa_renderer *renderer, const ewa_camera *camera, const char *settings, size_t width,
                           size_t height, const ewa_background *background, const ewa_task *task,
                           const ewa_buffers *buffers);
/* Draws column densities to `count` (width times height) numbers of `type`, EWA_F32 or EWA_F64. `settings`: "of" (the quantity
 * that is summed, "mass" or a field), "mean" (the field whose mean along rays is drawn), "slice" (a coordinate along the
 * camera's axis), "tolerance", "filter", "low_pass", "cutoff", "clip". `pixel_area`: NULL, or receives a pixel's area; NAN under
 * perspective. On ranks, `values` and `pixel_area` of the first one count, and there are no means. */
ewa_status ewa_columns(ewa_renderer *renderer, const ewa_camera *camera, const char *settings, size_t width,
                       size_t height, const ewa_task *task, ewa_type type, void *values, size_t count,
                       double *pixel_area);

/* Deep images: samples along the ray of each pixel, by which another renderer's picture is put into this one at any depth. Depths
 * are along the view, world units. Settings as ewa_render's, but for backgrounds, legends, depths and normals. It takes ten to a
 * hundred pictures, and one process. */
ewa_status ewa_render_deep(ewa_renderer *renderer, const ewa_camera *camera, const char *settings, size_t width,
                           size_t height, const ewa_task *task, ewa_deep **out);
/* The number of samples of all pixels. */
ewa_status ewa_deep_count(const ewa_deep *deep, size_t *count);
/* Writes the number of samples of each pixel to `counts` (one for each pixel, rows from the top), and all samples, pixel by pixel,
 * front to back: `front` and `back` (`count` depths each; equal for surfaces) and `rgba` (4 times as many, linear, premultiplied:
 * what the sample shows by itself). NULL: not wanted. `count`: that of ewa_deep_count. */
ewa_status ewa_deep_samples(const ewa_deep *deep, size_t *counts, float *front, float *back, float *rgba, size_t count);
/* Writes the pixels (4 floats each) in front of `depth` (1 for each pixel), or with NULL all that lies along the rays. */
ewa_status ewa_deep_before(const ewa_deep *deep, const float *depth, float *rgba, size_t pixel_count);
/* Writes the share of light that reaches the eye from a depth, for each pixel. */
ewa_status ewa_deep_transmittance(const ewa_deep *deep, float depth, float *values, size_t pixel_count);
/* Writes a depth of each pixel, infinite where it is transparent. `kind`: "half", where half of the light from behind is lost;
 * "entry" and "exit", where all but a 256th of the pixel's opacity lies behind and in front; "median", where half of it is
 * reached; "mean", weighted by opacity. */
ewa_status ewa_deep_depth(const ewa_deep *deep, const char *kind, float *values, size_t pixel_count);
/* Writes a deep OpenEXR file (.exr) with the channels A, B, G, R, Z and ZBack. */
ewa_status ewa_deep_write(const ewa_deep *deep, const char *path);
void ewa_deep_free(ewa_deep *deep);

#ifdef __cplusplus
}
#endif

#endif
