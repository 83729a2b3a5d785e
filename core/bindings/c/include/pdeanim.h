/* libpdeanim reads .pdeanim files, meshes that deform, and gives their positions at any time.
 *
 *     pdeanim_animation *animation;
 *     pdeanim_error error;
 *     if (pdeanim_open_memory(data, size, NULL, &animation, &error)) return fail(error.text);
 *     float *points = malloc(sizeof(float) * 3 * pdeanim_vertex_count(animation));
 *     double time = 1.25;
 *     if (pdeanim_evaluate(animation, PDEANIM_POSITIONS, &time, 1, PDEANIM_ALL_OBJECTS, points, &error)) ...
 *     pdeanim_close(animation);
 *
 * Opening reads headers; mesh, attributes and groups of frames are decoded when they are first asked for, and kept.
 * A function that can fail returns a status, and says what failed in `error`, which may be NULL. No function throws,
 * exits or prints. Functions may be called from several threads, also for the same animation: they take turns. What
 * pointers in results point to belongs to the animation and stays until it is closed.
 *
 * Arguments are checked: NULL in place of an animation, of data or of a result, an animation that is closed, and a number or
 * a size out of range are PDEANIM_ARGUMENT. `out` may be NULL where no number is written to it. A function that returns no
 * status returns -1 then, or NULL; pdeanim_close and pdeanim_cancel do nothing. After an error results are not written, but
 * that a function that opens sets its result to NULL. A closed animation is known by its address, which a later one may
 * get: a program must not depend on the check.
 *
 * Vertices of all objects are numbered through: those of the first object, then those of the second.
 *
 * Faces are the same in every frame of most files. A file may also hold several runs of frames, each with faces and vertices
 * of its own, such as a fluid whose mesh is another one in every frame. Each run is opened as an animation of its own:
 *
 *     pdeanim_animation *run;
 *     if (pdeanim_open_run(animation, pdeanim_run_at(animation, time), &run, &error)) ...
 *     if (pdeanim_evaluate(run, PDEANIM_POSITIONS, &time, 1, PDEANIM_ALL_OBJECTS, points, &error)) ...
 *     pdeanim_close(run);
 *
 * That goes for files of one run as well, where it gives the same animation again.
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
    PDEANIM_CORRUPT = 1,     /* the file is damaged, truncated, of another kind or a later major version */
    PDEANIM_LIMIT = 2,       /* the file asks for more memory than the options allow */
    PDEANIM_ARGUMENT = 3,    /* an argument is NULL, closed or out of range */
    PDEANIM_READ_FAILED = 4, /* the read function failed */
    PDEANIM_NO_MEMORY = 5,   /* there is no memory left */
    PDEANIM_CANCELLED = 6,   /* pdeanim_cancel was called */
    PDEANIM_INTERNAL = 7     /* a fault of this library: please report it */
} pdeanim_status;

#define PDEANIM_ERROR_BYTES 256

typedef struct pdeanim_error {
    pdeanim_status status;
    int64_t offset;                 /* byte of the file, or -1 */
    int64_t frame;                  /* frame, or -1 */
    char text[PDEANIM_ERROR_BYTES]; /* one line of UTF-8: what is wrong and what to do */
} pdeanim_error;

typedef struct pdeanim_options {
    size_t size; /* sizeof(pdeanim_options), never 0: later versions may add fields behind those that there are */
    uint64_t max_memory; /* bytes that a file may ask for; 0: 4 GiB */
    uint32_t threads;    /* that decode beside each other; 0: one a processor */
    uint64_t max_output; /* bytes of positions, 12 for each vertex and frame, that a file may declare; 0: any number */
    uint64_t max_kept;   /* bytes of decoded groups of frames that stay in memory; 0: 512 MiB. They take an eighth of it
                            at first, more where times go back to groups that were given up, and never more than
                            max_memory leaves */
} pdeanim_options;

/* An open file. */
typedef struct pdeanim_animation pdeanim_animation;

/* Version of the library, "1.0.0"; and the major version of the format that it reads. */
PDEANIM_API const char *pdeanim_version(void);
PDEANIM_API int pdeanim_format_version(void);

/* Open a whole file in memory, which must stay there until the animation is closed. Options may be NULL. */
PDEANIM_API pdeanim_status pdeanim_open_memory(const void *data, size_t size, const pdeanim_options *options,
                                               pdeanim_animation **animation, pdeanim_error *error);

/* Reads `size` bytes from `offset` on, returns how many were read (fewer at the end of the file alone), or -1. A count
 * above `size` is PDEANIM_READ_FAILED. */
typedef int64_t (*pdeanim_read)(void *user, uint64_t offset, void *into, size_t size);

/* Open a file of `size` bytes that is read through a function: each part when it is first needed, so that a clip on a
 * slow store is read group by group. The function is called by one thread at a time. */
PDEANIM_API pdeanim_status pdeanim_open_read(pdeanim_read read, void *user, uint64_t size,
                                             const pdeanim_options *options, pdeanim_animation **animation,
                                             pdeanim_error *error);

/* Close an animation; NULL, and one that is closed, are passed over. No other call may be under way. */
PDEANIM_API void pdeanim_close(pdeanim_animation *animation);

/* Make calls that are under way end soon with PDEANIM_CANCELLED; later calls go on as if nothing had been. */
PDEANIM_API void pdeanim_cancel(pdeanim_animation *animation);

/* Frames of all runs. Of a file of several runs the vertices are the most that one has, and there are no objects. */
PDEANIM_API int64_t pdeanim_frame_count(const pdeanim_animation *animation);
PDEANIM_API int64_t pdeanim_vertex_count(const pdeanim_animation *animation);
PDEANIM_API int64_t pdeanim_object_count(const pdeanim_animation *animation);
PDEANIM_API double pdeanim_frame_rate(
    const pdeanim_animation *animation); /* frames a second, as the file was made for */
PDEANIM_API const double *pdeanim_times(const pdeanim_animation *animation); /* of the frames [s], increasing */

/* Runs of frames, each with faces of its own: 1 of most files. */
PDEANIM_API int64_t pdeanim_run_count(const pdeanim_animation *animation);

/* The run that holds at a time [s]: between the last frame of one and the first of the next it is the earlier one.
 * -1 for a time that is not a number. */
PDEANIM_API int64_t pdeanim_run_at(const pdeanim_animation *animation, double time);

/* The first frame of a run; of the number of runs the number of frames; -1 where there is no such run. */
PDEANIM_API int64_t pdeanim_first_frame_of_run(const pdeanim_animation *animation, int64_t run);

/* Open one run, whose times are those of its frames; nothing of other runs is read. Close it like any other animation; the
 * one it is of may be closed before. What a file was opened from must stay until all of them are closed. */
PDEANIM_API pdeanim_status pdeanim_open_run(const pdeanim_animation *animation, int64_t run, pdeanim_animation **opened,
                                            pdeanim_error *error);

/* The remarks for people (section META), a Zstandard frame of a JSON object; no bytes where there are none. */
PDEANIM_API pdeanim_status pdeanim_remarks(pdeanim_animation *animation, const void **data, size_t *size,
                                           pdeanim_error *error);

typedef struct pdeanim_object {
    const char *name; /* UTF-8 */
    int64_t first_vertex, vertex_count;
    int64_t face_count, corner_count;         /* corners of all faces together */
    int64_t line_count, line_point_count;     /* points of all lines together */
    const int32_t *face_sizes, *face_indices; /* corners of each face; their vertices, face after face, from 0 */
    const int32_t *line_sizes, *line_indices; /* the same of lines and single points */
} pdeanim_object;

PDEANIM_API pdeanim_status pdeanim_get_object(pdeanim_animation *animation, int64_t index, pdeanim_object *object,
                                              pdeanim_error *error);

typedef enum pdeanim_domain {
    PDEANIM_OF_VERTICES = 0,
    PDEANIM_OF_FACES = 1,
    PDEANIM_OF_CORNERS = 2,
    PDEANIM_OF_OBJECT = 3
} pdeanim_domain;

typedef enum pdeanim_type {
    PDEANIM_FLOAT32 = 0,
    PDEANIM_FLOAT64 = 1,
    PDEANIM_INT32 = 2,
    PDEANIM_INT64 = 3,
    PDEANIM_UINT8 = 4
} pdeanim_type;

typedef struct pdeanim_attribute {
    const char *name; /* UTF-8 */
    pdeanim_domain domain;
    pdeanim_type type;
    int64_t row_count, column_count; /* one column: a number each */
    const void *values;              /* row after row */
    int64_t index_count;             /* elements of the domain whose rows `indices` gives; 0: element k has row k */
    const int32_t *indices;          /* row of each element, -1 for none */
    int64_t label_count;             /* what integers stand for, if they do */
    const char *const *labels;
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

/* A quantity of all vertices of one object, or of all, at `count` times [s] in any order: out[count][vertices][3].
 * Before the first frame and after the last one a mesh stands still. After an error `out` may hold anything. An animation of
 * several runs is not evaluated as a whole: that is PDEANIM_ARGUMENT. */
PDEANIM_API pdeanim_status pdeanim_evaluate(pdeanim_animation *animation, pdeanim_quantity quantity,
                                            const double *times, size_t count, int64_t object, float *out,
                                            pdeanim_error *error);

/* What follows is for programs that evaluate on a graphics processor. A quantity at a time is
 *
 *     sum over groups of frames, and over a group's functions of time, of weight(time) * field(vertex, axis),
 *
 * and positions are that sum added to the reference frame, with corrections: those of a frame at its time, and between two
 * frames those of both, times one less the share of the way that is gone, and times that share. Velocities have the
 * difference of both corrections divided by the time from frame to frame [s]. Fields stay what they are while a group
 * plays; a frame needs a few weights. Added up in float32 the result differs from that of pdeanim_evaluate in the last
 * places. Of an animation of several runs these calls are PDEANIM_ARGUMENT; open a run. */

typedef struct pdeanim_group {
    int64_t first_frame, frame_count;
    int64_t function_count; /* functions of time, each with a field */
    int64_t axis_count; /* of a field. 1: all axes have it in common, each function has 3 weights. 3: it has 1 weight */
} pdeanim_group;

PDEANIM_API int64_t pdeanim_group_count(const pdeanim_animation *animation);
PDEANIM_API pdeanim_status pdeanim_get_group(pdeanim_animation *animation, int64_t index, pdeanim_group *group,
                                             pdeanim_error *error);

/* The reference frame [scene units]: out[vertices][3]. */
PDEANIM_API pdeanim_status pdeanim_reference(pdeanim_animation *animation, float *out, pdeanim_error *error);

/* The groups that count for a quantity at a time [s]: `count` of them from `first` on. Nothing is decoded for it. */
PDEANIM_API pdeanim_status pdeanim_groups_at(pdeanim_animation *animation, pdeanim_quantity quantity, double time,
                                             int64_t *first, int64_t *count, pdeanim_error *error);

/* Weights of a group's functions for a quantity at a time [s]: out[functions] where fields have 3 axes; where they have
 * 1, out[3][functions], of each axis. */
PDEANIM_API pdeanim_status pdeanim_weights(pdeanim_animation *animation, pdeanim_quantity quantity, double time,
                                           int64_t group, double *out, pdeanim_error *error);

/* Fields of a group [scene units]: out[functions][vertices][axes]. */
PDEANIM_API pdeanim_status pdeanim_fields(pdeanim_animation *animation, int64_t group, float *out,
                                          pdeanim_error *error);

typedef struct pdeanim_correction {
    int32_t frame, vertex;
    float offset[3]; /* [scene units] */
} pdeanim_correction;

/* Corrections at the frames of a group, frame after frame; of each frame one for a vertex at most. They stay until they are
 * asked for of another group, or the animation is closed. */
PDEANIM_API pdeanim_status pdeanim_corrections(pdeanim_animation *animation, int64_t group,
                                               const pdeanim_correction **corrections, int64_t *count,
                                               pdeanim_error *error);

/* The patch, or the piece of a curve, that each vertex belongs to, from 0: out[vertices]. */
PDEANIM_API pdeanim_status pdeanim_elements(pdeanim_animation *animation, int32_t *out, pdeanim_error *error);

typedef struct pdeanim_section {
    const char *type;        /* four letters */
    uint64_t offset, length; /* bytes of the file */
} pdeanim_section;

/* What a file's bytes are spent on: of a run, its sections; of a file of several runs those that it has as a whole. */
PDEANIM_API int64_t pdeanim_section_count(const pdeanim_animation *animation);
PDEANIM_API pdeanim_status pdeanim_get_section(const pdeanim_animation *animation, int64_t index,
                                               pdeanim_section *section, pdeanim_error *error);

/* Check every byte, and that everything decodes. */
PDEANIM_API pdeanim_status pdeanim_verify(pdeanim_animation *animation, pdeanim_error *error);

#ifdef __cplusplus
}
#endif

#endif
