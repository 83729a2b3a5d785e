/* libpdeanim reads .pdeanim files (animated meshes) and evaluates their vertex positions at any time.
 *
 *     pdeanim_animation *animation;
 *     pdeanim_error error;
 *     if (pdeanim_open_memory(data, size, NULL, &animation, &error)) return fail(error.text);
 *     float *points = malloc(sizeof(float) * 3 * pdeanim_vertex_count(animation));
 *     double time = 1.25;
 *     if (pdeanim_evaluate(animation, PDEANIM_POSITIONS, &time, 1, PDEANIM_ALL_OBJECTS, points, &error)) ...
 *     pdeanim_close(animation);
 *
 * Opening a file reads only its headers. The mesh, the attributes and groups of frames are decoded on first use and
 * then cached.
 *
 * Errors: a function that can fail returns a status and describes the failure in `error`, which may be NULL. No
 * function throws, exits or prints. After an error no results are written, except that a function that opens an
 * animation sets it to NULL.
 *
 * Threads: functions may be called from several threads, even with the same animation; such calls run one after
 * another.
 *
 * Ownership: memory that results point to belongs to the animation and stays valid until the animation is closed.
 *
 * Arguments: NULL in place of an animation, of data or of a result, a closed animation, and a number or size out of
 * range give PDEANIM_ARGUMENT. `out` may be NULL if nothing is written to it. Given such an argument, a function
 * without a status returns -1 or NULL; pdeanim_close and pdeanim_cancel do nothing. A closed animation is recognised by
 * its address, which an animation opened later may reuse: a program must not rely on this check.
 *
 * Vertices: those of all objects are numbered in one row, those of the first object first, then those of the second.
 *
 * Runs: in most files the faces are the same in every frame. A file may also hold several runs of frames, each with its
 * own faces and vertices, such as a fluid with a new mesh in every frame. Each run is opened as an animation of its
 * own:
 *
 *     pdeanim_animation *run;
 *     if (pdeanim_open_run(animation, pdeanim_run_at(animation, time), &run, &error)) ...
 *     if (pdeanim_evaluate(run, PDEANIM_POSITIONS, &time, 1, PDEANIM_ALL_OBJECTS, points, &error)) ...
 *     pdeanim_close(run);
 *
 * This also works for a file with a single run, which is then opened a second time.
 */
#ifndef PDEANIM_H
#define PDEANIM_H

#include <stddef.h>
#include <stdint.h>

#if defined(PDEANIM_STATIC)
#define PDEANIM_API
#elif defined(_WIN32) && defined(PDEANIM_BUILDING)
#define PDEANIM_API __declspec(dllexport)
#elif defined(_WIN32)
#define PDEANIM_API __declspec(dllimport)
#else
#define PDEANIM_API __attribute__((visibility("default")))
#endif

#ifdef __cplusplus
extern "C" {
#endif

typedef enum pdeanim_status {
    PDEANIM_OK = 0,
    PDEANIM_CORRUPT = 1,     /* the file is damaged, truncated, of another kind or of a later major version */
    PDEANIM_LIMIT = 2,       /* the file needs more memory or output than the options allow */
    PDEANIM_ARGUMENT = 3,    /* an argument is NULL, closed or out of range */
    PDEANIM_READ_FAILED = 4, /* the read function failed */
    PDEANIM_NO_MEMORY = 5,   /* the system has no memory left */
    PDEANIM_CANCELLED = 6,   /* pdeanim_cancel was called */
    PDEANIM_INTERNAL = 7     /* a bug of this library: please report it */
} pdeanim_status;

#define PDEANIM_ERROR_BYTES 256

typedef struct pdeanim_error {
    pdeanim_status status;
    int64_t offset;                 /* position in the file [bytes], or -1 */
    int64_t frame;                  /* frame index, or -1 */
    char text[PDEANIM_ERROR_BYTES]; /* one line of UTF-8: what is wrong and what to do */
} pdeanim_error;

/* Options for opening a file; set those that you do not need to 0. */
typedef struct pdeanim_options {
    size_t size;         /* sizeof(pdeanim_options), never 0: later versions may append fields */
    uint64_t max_memory; /* largest memory that decoding may take [bytes]; 0: 4 GiB */
    uint32_t threads;    /* number of threads that decode in parallel; 0: one per processor */
    uint64_t max_output; /* largest size of all positions, at 12 bytes per vertex and frame [bytes]; 0: unlimited */
    /* Largest size of the cache of decoded groups of frames [bytes]; 0: 512 MiB. The cache begins with an eighth of it
     * and grows when evicted groups are needed again. It never exceeds what max_memory leaves. */
    uint64_t max_kept;
} pdeanim_options;

/* An open file, or one open run of a file. */
typedef struct pdeanim_animation pdeanim_animation;

/* Return the version of the library, "1.0.0". */
PDEANIM_API const char *pdeanim_version(void);

/* Return the major version of the file format that the library reads. */
PDEANIM_API int pdeanim_format_version(void);

/* Open a file that lies in memory as a whole. `data` must stay valid until the animation, and every run opened from it,
 * is closed. `options` may be NULL. */
PDEANIM_API pdeanim_status pdeanim_open_memory(const void *data, size_t size, const pdeanim_options *options,
                                               pdeanim_animation **animation, pdeanim_error *error);

/* A function of the caller that reads `size` bytes from `offset` on into `into`. It returns the number of bytes read,
 * which may be smaller than `size` only at the end of the file, or -1 on failure. A number above `size` gives
 * PDEANIM_READ_FAILED. `user` is the pointer that was given to pdeanim_open_read. */
typedef int64_t (*pdeanim_read)(void *user, uint64_t offset, void *into, size_t size);

/* Open a file of `size` bytes through a read function. Each part is read when it is first needed, so a clip on slow
 * storage is read group by group. Only one thread at a time calls `read`. `options` may be NULL. */
PDEANIM_API pdeanim_status pdeanim_open_read(pdeanim_read read, void *user, uint64_t size,
                                             const pdeanim_options *options, pdeanim_animation **animation,
                                             pdeanim_error *error);

/* Close an animation. NULL and a closed animation are ignored. No other call with this animation may be running. */
PDEANIM_API void pdeanim_close(pdeanim_animation *animation);

/* Make the running calls with this animation return soon, with PDEANIM_CANCELLED. Later calls are not affected. */
PDEANIM_API void pdeanim_cancel(pdeanim_animation *animation);

/* Return the number of frames of all runs. */
PDEANIM_API int64_t pdeanim_frame_count(const pdeanim_animation *animation);

/* Return the number of vertices of all objects; for a file with several runs, the largest number in any run. */
PDEANIM_API int64_t pdeanim_vertex_count(const pdeanim_animation *animation);

/* Return the number of objects; 0 for a file with several runs, where each run has its own objects. */
PDEANIM_API int64_t pdeanim_object_count(const pdeanim_animation *animation);

PDEANIM_API double pdeanim_frame_rate(
    const pdeanim_animation *animation); /* frame rate for which the file was made [frames / s] */

/* Return the times of all frames [s], in increasing order. */
PDEANIM_API const double *pdeanim_times(const pdeanim_animation *animation);

/* Return the number of runs of frames, which is 1 for most files. */
PDEANIM_API int64_t pdeanim_run_count(const pdeanim_animation *animation);

/* Return the run to show at a time [s]. Between the last frame of one run and the first frame of the next this is the
 * earlier run. Returns -1 if the time is NaN. */
PDEANIM_API int64_t pdeanim_run_at(const pdeanim_animation *animation, double time);

/* Return the index of a run's first frame, or the number of frames if `run` equals the number of runs. Returns -1 if
 * there is no such run. */
PDEANIM_API int64_t pdeanim_first_frame_of_run(const pdeanim_animation *animation, int64_t run);

/* Open one run of a file as an animation of its own, whose times are those of the run's frames. No data of other runs
 * are read. Close it like any other animation; the animation it was opened from may be closed earlier. The data or the
 * read function of the file must stay valid until all of them are closed. */
PDEANIM_API pdeanim_status pdeanim_open_run(const pdeanim_animation *animation, int64_t run, pdeanim_animation **opened,
                                            pdeanim_error *error);

/* Get the remarks for human readers (section META): a JSON object, compressed as a Zstandard frame. `size` is 0 if the
 * file has no remarks. */
PDEANIM_API pdeanim_status pdeanim_remarks(pdeanim_animation *animation, const void **data, size_t *size,
                                           pdeanim_error *error);

typedef struct pdeanim_object {
    const char *name; /* UTF-8 */
    int64_t first_vertex, vertex_count;
    int64_t face_count, corner_count;     /* number of faces, and of corners of all faces */
    int64_t line_count, line_point_count; /* number of lines, and of points of all lines */
    /* Number of corners of each face; then the vertex of each corner, face after face. Vertices count from 0 in each
     * object. */
    const int32_t *face_sizes, *face_indices;
    /* Likewise the points of each line and the vertex of each point. A line with a single point draws a point. */
    const int32_t *line_sizes, *line_indices;
} pdeanim_object;

/* Get the name and the topology of an object. */
PDEANIM_API pdeanim_status pdeanim_get_object(pdeanim_animation *animation, int64_t index, pdeanim_object *object,
                                              pdeanim_error *error);

typedef enum pdeanim_shape {
    PDEANIM_POLYLINE = 0,
    PDEANIM_LINE = 1,
    PDEANIM_POLYGON = 2,
    PDEANIM_TRIANGLE = 3,
    PDEANIM_QUAD = 4,
    PDEANIM_TETRAHEDRON = 5,
    PDEANIM_PYRAMID = 6,
    PDEANIM_WEDGE = 7,
    PDEANIM_HEXAHEDRON = 8
} pdeanim_shape;

/* The elements of a file that keeps solids, in the order of their source. The object's faces and lines are then their
 * visible sides and edges. */
typedef struct pdeanim_cells {
    int64_t cell_count, node_count; /* number of cells, and of nodes of all cells; 0 if the file keeps no solids */
    const uint8_t *shapes;          /* a pdeanim_shape for each cell */
    /* Number of nodes of each cell; then the vertex of each node, cell after cell, in the order of VTK: corners, then
     * nodes on edges, then others. Shape and number of nodes give the kind: a tetrahedron of 10 is quadratic. */
    const int32_t *sizes, *indices;
} pdeanim_cells;

/* Get the cells of an object. */
PDEANIM_API pdeanim_status pdeanim_get_cells(pdeanim_animation *animation, int64_t index, pdeanim_cells *cells,
                                             pdeanim_error *error);

/* The elements of an object that an attribute has values for. */
typedef enum pdeanim_domain {
    PDEANIM_OF_VERTICES = 0,
    PDEANIM_OF_FACES = 1,
    PDEANIM_OF_CORNERS = 2,
    PDEANIM_OF_OBJECT = 3,
    PDEANIM_OF_CELLS = 4
} pdeanim_domain;

typedef enum pdeanim_type {
    PDEANIM_FLOAT32 = 0,
    PDEANIM_FLOAT64 = 1,
    PDEANIM_INT32 = 2,
    PDEANIM_INT64 = 3,
    PDEANIM_UINT8 = 4
} pdeanim_type;

/* Data of an object that are constant in time, such as UVs and colours. */
typedef struct pdeanim_attribute {
    const char *name; /* UTF-8 */
    pdeanim_domain domain;
    pdeanim_type type;
    int64_t row_count, column_count; /* shape of the values; scalar values have one column */
    const void *values;              /* row after row */
    int64_t index_count;             /* number of `indices`, one per element; 0: element k has row k */
    const int32_t *indices;          /* row of each element, -1 for none */
    int64_t label_count;             /* number of `labels`; 0: the values have no labels */
    const char *const *labels;       /* UTF-8: what each integer value means */
} pdeanim_attribute;

PDEANIM_API pdeanim_status pdeanim_attribute_count(pdeanim_animation *animation, int64_t object, int64_t *count,
                                                   pdeanim_error *error);
PDEANIM_API pdeanim_status pdeanim_get_attribute(pdeanim_animation *animation, int64_t object, int64_t index,
                                                 pdeanim_attribute *attribute, pdeanim_error *error);

typedef enum pdeanim_quantity {
    PDEANIM_POSITIONS = 0,    /* [scene units] */
    PDEANIM_VELOCITIES = 1,   /* [scene units / s] */
    PDEANIM_ACCELERATIONS = 2 /* [scene units / s^2] */
} pdeanim_quantity;

#define PDEANIM_ALL_OBJECTS (-1)

/* Evaluate a quantity at `count` times [s], in any order, for all vertices of one object or of PDEANIM_ALL_OBJECTS:
 * out[count][vertices][3]. Before the first frame and after the last one the mesh stands still. After an error the
 * content of `out` is undefined. An animation with several runs cannot be evaluated as a whole (PDEANIM_ARGUMENT). */
PDEANIM_API pdeanim_status pdeanim_evaluate(pdeanim_animation *animation, pdeanim_quantity quantity,
                                            const double *times, size_t count, int64_t object, float *out,
                                            pdeanim_error *error);

/* The type of a field's values; a boolean is a byte, 0 or 1. */
typedef enum pdeanim_field_type {
    PDEANIM_FIELD_FLOAT32 = 0,
    PDEANIM_FIELD_FLOAT64 = 1,
    PDEANIM_FIELD_INT8 = 2,
    PDEANIM_FIELD_INT16 = 3,
    PDEANIM_FIELD_INT32 = 4,
    PDEANIM_FIELD_INT64 = 5,
    PDEANIM_FIELD_UINT8 = 6,
    PDEANIM_FIELD_UINT16 = 7,
    PDEANIM_FIELD_UINT32 = 8,
    PDEANIM_FIELD_UINT64 = 9,
    PDEANIM_FIELD_BOOLEAN = 10
} pdeanim_field_type;

/* Values on vertices, faces, corners, objects or cells that change in time, such as stresses. */
typedef struct pdeanim_field {
    const char *name, *unit; /* UTF-8; an empty unit means that it is unknown */
    pdeanim_domain domain;
    pdeanim_field_type type;
    int64_t row_count, column_count; /* number of rows of all objects that have the field; numbers per row */
    size_t value_bytes;              /* size of one number [bytes] */
    double smallest, largest;        /* smallest and largest value of the source */
    double bound;                    /* largest error at the frames; 0: values are exact */
    int64_t object_count;            /* 0: all objects have the field, and its rows stand object after object */
    const int64_t *objects;          /* [object_count] otherwise the objects that have it, ascending */
} pdeanim_field;

PDEANIM_API pdeanim_status pdeanim_field_count(pdeanim_animation *animation, int64_t *count, pdeanim_error *error);
PDEANIM_API pdeanim_status pdeanim_get_field(pdeanim_animation *animation, int64_t index, pdeanim_field *field,
                                             pdeanim_error *error);

/* Evaluate a field at `count` times [s], in any order: out[count][rows][columns] of the field's type; `size` is the
 * size of `out` in bytes. Between frames, floats follow a smooth curve and other types keep the values of the earlier
 * frame. `derivative` is 0 for values; 1 or 2 gives derivatives of floats [1 / s, 1 / s^2]. */
PDEANIM_API pdeanim_status pdeanim_evaluate_field(pdeanim_animation *animation, int64_t index, const double *times,
                                                  size_t count, int derivative, void *out, size_t size,
                                                  pdeanim_error *error);

/* The functions below are for programs that evaluate on a graphics processor. A quantity at a time is
 *
 *     sum over groups of frames, and over each group's functions of time, of weight(time) * field(vertex, axis).
 *
 * Positions are this sum plus the reference frame plus corrections. At the time of a frame its corrections are added;
 * between two frames those of both, weighted by linear interpolation. Velocities include the difference of both frames'
 * corrections divided by the time between the frames [s]. Fields stay the same while a group plays, so each new time
 * needs only a few weights. Summed in float32, the result differs from that of pdeanim_evaluate in the last digits. For
 * an animation with several runs these functions return PDEANIM_ARGUMENT; open a run. */

typedef struct pdeanim_group {
    int64_t first_frame, frame_count;
    int64_t function_count; /* number of functions of time, each with a field */
    /* Number of axes of a field. 3: each axis has its own values, and each function has one weight. 1: all axes share
     * one value per vertex, and each function has three weights. */
    int64_t axis_count;
} pdeanim_group;

PDEANIM_API int64_t pdeanim_group_count(const pdeanim_animation *animation);
PDEANIM_API pdeanim_status pdeanim_get_group(pdeanim_animation *animation, int64_t index, pdeanim_group *group,
                                             pdeanim_error *error);

/* Get the reference frame [scene units]: out[vertices][3]. */
PDEANIM_API pdeanim_status pdeanim_reference(pdeanim_animation *animation, float *out, pdeanim_error *error);

/* Find the groups that contribute to a quantity at a time [s]: `count` groups from `first` on. Decodes nothing. */
PDEANIM_API pdeanim_status pdeanim_groups_at(pdeanim_animation *animation, pdeanim_quantity quantity, double time,
                                             int64_t *first, int64_t *count, pdeanim_error *error);

/* Compute the weights of a group's functions for a quantity at a time [s]: out[functions] if fields have 3 axes;
 * out[3][functions], one row per axis, if they have 1. */
PDEANIM_API pdeanim_status pdeanim_weights(pdeanim_animation *animation, pdeanim_quantity quantity, double time,
                                           int64_t group, double *out, pdeanim_error *error);

/* Decode the fields of a group [scene units]: out[functions][vertices][axes]. */
PDEANIM_API pdeanim_status pdeanim_fields(pdeanim_animation *animation, int64_t group, float *out,
                                          pdeanim_error *error);

typedef struct pdeanim_correction {
    int32_t frame, vertex;
    float offset[3]; /* [scene units] */
} pdeanim_correction;

/* Get the corrections at the frames of a group, frame after frame, with at most one per vertex in each frame. They stay
 * valid until the corrections of another group are requested or the animation is closed. */
PDEANIM_API pdeanim_status pdeanim_corrections(pdeanim_animation *animation, int64_t group,
                                               const pdeanim_correction **corrections, int64_t *count,
                                               pdeanim_error *error);

/* Get the element (patch, or piece of a curve) of each vertex, from 0: out[vertices]. */
PDEANIM_API pdeanim_status pdeanim_elements(pdeanim_animation *animation, int32_t *out, pdeanim_error *error);

typedef struct pdeanim_section {
    const char *type;        /* four letters */
    uint64_t offset, length; /* position and size in the file [bytes] */
} pdeanim_section;

/* Return the number of sections of the file: those of a run, or, for a file with several runs, those of the whole
 * file. */
PDEANIM_API int64_t pdeanim_section_count(const pdeanim_animation *animation);

/* Get the type, position and size of a section. */
PDEANIM_API pdeanim_status pdeanim_get_section(const pdeanim_animation *animation, int64_t index,
                                               pdeanim_section *section, pdeanim_error *error);

/* Check every byte of the file against its checksum, and decode everything. */
PDEANIM_API pdeanim_status pdeanim_verify(pdeanim_animation *animation, pdeanim_error *error);

#ifdef __cplusplus
}
#endif

#endif
