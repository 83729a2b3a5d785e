/* Converts a .pdeanim file to OBJ: play FILE.pdeanim FOLDER [FPS] writes one file per frame into an existing folder. */
#include <pdeanim.h>
#include <stdio.h>
#include <stdlib.h>

static int64_t read_file(void *user, uint64_t offset, void *into, size_t size) {
    FILE *file = user;
    if (fseek(file, (long)offset, SEEK_SET)) return -1;
    return (int64_t)fread(into, 1, size, file);
}

static int fail(const char *path, const pdeanim_error *error) {
    fprintf(stderr, "%s: %s\n", path, error->text);
    return EXIT_FAILURE;
}

static int write_obj(const char *path, pdeanim_animation *animation, const float *points, pdeanim_error *error) {
    FILE *file = fopen(path, "w");
    if (!file) {
        snprintf(error->text, sizeof error->text, "the folder for the frames cannot be written to");
        return 1;
    }
    for (int64_t v = 0; v < pdeanim_vertex_count(animation); ++v) {
        fprintf(file, "v %.9g %.9g %.9g\n", points[3 * v], points[3 * v + 1], points[3 * v + 2]);
    }
    for (int64_t i = 0; i < pdeanim_object_count(animation); ++i) {
        pdeanim_object object;
        if (pdeanim_get_object(animation, i, &object, error)) break;
        fprintf(file, "o %s\n", object.name);
        const int32_t *corner = object.face_indices;
        for (int64_t f = 0; f < object.face_count; ++f) {
            fputc('f', file);
            for (int32_t k = 0; k < object.face_sizes[f]; ++k) {
                fprintf(file, " %lld", (long long)(object.first_vertex + *corner++ + 1));
            }
            fputc('\n', file);
        }
    }
    return fclose(file) || error->status;
}

int main(int count, char **arguments) {
    if (count < 3) {
        fprintf(stderr, "usage: %s FILE.pdeanim FOLDER [FPS]\n", arguments[0]);
        return EXIT_FAILURE;
    }
    FILE *file = fopen(arguments[1], "rb");
    if (!file || fseek(file, 0, SEEK_END)) {
        perror(arguments[1]);
        return EXIT_FAILURE;
    }
    pdeanim_animation *animation;
    pdeanim_error error = {0};
    if (pdeanim_open_read(read_file, file, (uint64_t)ftell(file), NULL, &animation, &error)) {
        fclose(file);
        return fail(arguments[1], &error);
    }
    const double *times = pdeanim_times(animation);
    const double fps = count > 3 ? atof(arguments[3]) : pdeanim_frame_rate(animation);
    const double last = times[pdeanim_frame_count(animation) - 1];
    float *points = malloc(sizeof(float) * 3 * (size_t)(pdeanim_vertex_count(animation) + 1));
    int failed = !points || !(fps > 0);
    for (int frame = 0; !failed; ++frame) {
        const double time = times[0] + frame / fps;
        if (time > last + 1e-9) break;
        failed = pdeanim_evaluate(animation, PDEANIM_POSITIONS, &time, 1, PDEANIM_ALL_OBJECTS, points, &error);
        char path[4096];
        snprintf(path, sizeof path, "%s/frame_%04d.obj", arguments[2], frame);
        failed = failed || write_obj(path, animation, points, &error);
    }
    free(points);
    pdeanim_close(animation);
    fclose(file);
    return failed ? fail(arguments[1], &error) : EXIT_SUCCESS;
}
