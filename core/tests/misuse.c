/* Makes forbidden calls of every function of the C interface: misuse ONE.pdeanim RUNS.pdeanim
 *
 * The first file has one run, and objects with attributes; the second has several runs. `make sanitize` runs this under
 * the sanitizers; tests/conformance/test_c_interface.py compares the table with the header. A row of the table is a
 * call and its expected result. If the function returns a status, the macro adds the last argument `error`, and repeats
 * the call with NULL instead. */
#include <math.h>
#include <pdeanim.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static int rows, faults;
static pdeanim_error error;

static void expect(int fulfilled, const char *row) {
    ++rows;
    if (fulfilled) return;
    ++faults;
    fprintf(stderr, "not as it must be: %s (%s)\n", row, error.text);
}

static int described(pdeanim_status found, pdeanim_status expected, pdeanim_status without_error) {
    const int lines = strchr(error.text, '\n') ? 2 : error.text[0] ? 1 : 0;
    return found == expected && error.status == expected && without_error == expected && lines == (expected ? 1 : 0);
}

#define RETURNS(status, function, ...)                                                    \
    expect(described(function(__VA_ARGS__, &error), status, function(__VA_ARGS__, NULL)), \
           #function "(" #__VA_ARGS__ ")")
#define REFUSES(function, ...) RETURNS(PDEANIM_ARGUMENT, function, __VA_ARGS__)
#define GIVES(value, function, ...) expect(function(__VA_ARGS__) == (value), #function "(" #__VA_ARGS__ ")")
#define IGNORES(function, argument) (function(argument), expect(1, #function "(" #argument ")"))

static void *bytes_of(const char *path, size_t *size) {
    FILE *file = fopen(path, "rb");
    if (!file || fseek(file, 0, SEEK_END)) {
        perror(path);
        exit(EXIT_FAILURE);
    }
    *size = (size_t)ftell(file);
    rewind(file);
    void *bytes = malloc(*size);
    if (!bytes || fread(bytes, 1, *size, file) != *size) exit(EXIT_FAILURE);
    fclose(file);
    return bytes;
}

static pdeanim_animation *opened(const void *data, size_t size) {
    pdeanim_animation *animation;
    if (pdeanim_open_memory(data, size, NULL, &animation, &error)) {
        fprintf(stderr, "%s\n", error.text);
        exit(EXIT_FAILURE);
    }
    return animation;
}

static int64_t read_nothing(void *user, uint64_t offset, void *into, size_t size) {
    return (void)user, (void)offset, (void)into, (void)size, 0;
}

static int64_t read_failing(void *user, uint64_t offset, void *into, size_t size) {
    return read_nothing(user, offset, into, size) - 1;
}

static int64_t read_too_much(void *user, uint64_t offset, void *into, size_t size) {
    return read_nothing(user, offset, into, size) + (int64_t)size + 1;
}

int main(int count, char **arguments) {
    if (count != 4) {
        fprintf(stderr, "usage: %s ONE.pdeanim RUNS.pdeanim FIELDS.pdeanim\n", arguments[0]);
        return EXIT_FAILURE;
    }
    size_t size, size_of_runs, size_of_fields;
    void *data = bytes_of(arguments[1], &size), *data_of_runs = bytes_of(arguments[2], &size_of_runs);
    void *data_of_fields = bytes_of(arguments[3], &size_of_fields);
    pdeanim_animation *animation = opened(data, size), *runs = opened(data_of_runs, size_of_runs);
    pdeanim_animation *fields = opened(data_of_fields, size_of_fields);
    pdeanim_animation *closed = opened(data, size), *made = NULL;
    pdeanim_close(closed);

    const pdeanim_quantity positions = PDEANIM_POSITIONS, unknown = (pdeanim_quantity)3,
                           negative = (pdeanim_quantity)-1;
    const double times[2] = {0.0, 0.1}, not_numbers[2] = {0.0, NAN}, endless[2] = {INFINITY, -INFINITY};
    const pdeanim_options without_size = {0, 1, 1, 1, 1}, small = {sizeof small, 1, 1, 0, 0};
    float *points = calloc((size_t)pdeanim_vertex_count(animation) * 6, sizeof *points);
    float out[3];
    double weights[3];
    int32_t elements[1];
    int64_t first, number;
    size_t length;
    const void *place;
    const pdeanim_correction *corrections;
    pdeanim_object object;
    pdeanim_attribute attribute;
    pdeanim_cells cells;
    pdeanim_group group;
    pdeanim_field field;
    pdeanim_section section;

    expect(pdeanim_version() && pdeanim_version()[0], "pdeanim_version()");
    expect(pdeanim_format_version() == 1, "pdeanim_format_version()");

    REFUSES(pdeanim_open_memory, NULL, size, NULL, &made);
    REFUSES(pdeanim_open_memory, data, size, NULL, NULL);
    REFUSES(pdeanim_open_memory, data, SIZE_MAX, NULL, &made);
    REFUSES(pdeanim_open_memory, data, size, &without_size, &made);
    RETURNS(PDEANIM_LIMIT, pdeanim_open_memory, data, size, &small, &made);
    RETURNS(PDEANIM_CORRUPT, pdeanim_open_memory, data, 0, NULL, &made);
    expect(!made, "made == NULL");
    REFUSES(pdeanim_open_read, NULL, NULL, size, NULL, &made);
    REFUSES(pdeanim_open_read, read_nothing, NULL, size, NULL, NULL);
    REFUSES(pdeanim_open_read, read_nothing, NULL, UINT64_MAX, NULL, &made);
    REFUSES(pdeanim_open_read, read_nothing, NULL, size, &without_size, &made);
    RETURNS(PDEANIM_CORRUPT, pdeanim_open_read, read_nothing, NULL, size, NULL, &made);
    RETURNS(PDEANIM_READ_FAILED, pdeanim_open_read, read_failing, NULL, size, NULL, &made);
    RETURNS(PDEANIM_READ_FAILED, pdeanim_open_read, read_too_much, NULL, size, NULL, &made);
    expect(!made, "made == NULL");

    IGNORES(pdeanim_close, NULL);
    IGNORES(pdeanim_close, closed);
    IGNORES(pdeanim_cancel, NULL);
    IGNORES(pdeanim_cancel, closed);

    GIVES(-1, pdeanim_frame_count, NULL);
    GIVES(-1, pdeanim_frame_count, closed);
    GIVES(-1, pdeanim_vertex_count, NULL);
    GIVES(-1, pdeanim_vertex_count, closed);
    GIVES(-1, pdeanim_object_count, NULL);
    GIVES(-1, pdeanim_object_count, closed);
    GIVES(0, pdeanim_object_count, runs);
    GIVES(-1, pdeanim_frame_rate, NULL);
    GIVES(-1, pdeanim_frame_rate, closed);
    GIVES(NULL, pdeanim_times, NULL);
    GIVES(NULL, pdeanim_times, closed);
    GIVES(-1, pdeanim_run_count, NULL);
    GIVES(-1, pdeanim_run_count, closed);
    GIVES(-1, pdeanim_run_at, NULL, 0.0);
    GIVES(-1, pdeanim_run_at, closed, 0.0);
    GIVES(-1, pdeanim_run_at, runs, NAN);
    GIVES(pdeanim_run_count(runs) - 1, pdeanim_run_at, runs, INFINITY);
    GIVES(0, pdeanim_run_at, runs, -INFINITY);
    GIVES(-1, pdeanim_first_frame_of_run, NULL, 0);
    GIVES(-1, pdeanim_first_frame_of_run, closed, 0);
    GIVES(-1, pdeanim_first_frame_of_run, runs, -1);
    GIVES(-1, pdeanim_first_frame_of_run, runs, INT64_MAX);
    GIVES(-1, pdeanim_group_count, NULL);
    GIVES(-1, pdeanim_group_count, closed);
    GIVES(0, pdeanim_group_count, runs);
    GIVES(-1, pdeanim_section_count, NULL);
    GIVES(-1, pdeanim_section_count, closed);

    REFUSES(pdeanim_open_run, NULL, 0, &made);
    REFUSES(pdeanim_open_run, closed, 0, &made);
    REFUSES(pdeanim_open_run, runs, 0, NULL);
    REFUSES(pdeanim_open_run, runs, -1, &made);
    REFUSES(pdeanim_open_run, runs, INT64_MAX, &made);
    REFUSES(pdeanim_open_run, runs, pdeanim_run_count(runs), &made);
    expect(!made, "made == NULL");

    REFUSES(pdeanim_remarks, NULL, &place, &length);
    REFUSES(pdeanim_remarks, closed, &place, &length);
    REFUSES(pdeanim_remarks, animation, NULL, &length);
    REFUSES(pdeanim_remarks, animation, &place, NULL);

    REFUSES(pdeanim_get_object, NULL, 0, &object);
    REFUSES(pdeanim_get_object, closed, 0, &object);
    REFUSES(pdeanim_get_object, animation, 0, NULL);
    REFUSES(pdeanim_get_object, animation, -1, &object);
    REFUSES(pdeanim_get_object, animation, INT64_MAX, &object);
    REFUSES(pdeanim_get_object, runs, 0, &object);

    REFUSES(pdeanim_get_cells, NULL, 0, &cells);
    REFUSES(pdeanim_get_cells, closed, 0, &cells);
    REFUSES(pdeanim_get_cells, animation, 0, NULL);
    REFUSES(pdeanim_get_cells, animation, INT64_MAX, &cells);
    REFUSES(pdeanim_get_cells, runs, 0, &cells);

    REFUSES(pdeanim_attribute_count, NULL, 0, &number);
    REFUSES(pdeanim_attribute_count, closed, 0, &number);
    REFUSES(pdeanim_attribute_count, animation, 0, NULL);
    REFUSES(pdeanim_attribute_count, animation, -1, &number);
    REFUSES(pdeanim_attribute_count, animation, INT64_MAX, &number);
    REFUSES(pdeanim_attribute_count, runs, 0, &number);

    REFUSES(pdeanim_get_attribute, NULL, 0, 0, &attribute);
    REFUSES(pdeanim_get_attribute, closed, 0, 0, &attribute);
    REFUSES(pdeanim_get_attribute, animation, 0, 0, NULL);
    REFUSES(pdeanim_get_attribute, animation, -1, 0, &attribute);
    REFUSES(pdeanim_get_attribute, animation, INT64_MAX, 0, &attribute);
    REFUSES(pdeanim_get_attribute, animation, 0, -1, &attribute);
    REFUSES(pdeanim_get_attribute, animation, 0, INT64_MAX, &attribute);
    REFUSES(pdeanim_get_attribute, runs, 0, 0, &attribute);

    REFUSES(pdeanim_evaluate, NULL, positions, times, 2, PDEANIM_ALL_OBJECTS, points);
    REFUSES(pdeanim_evaluate, closed, positions, times, 2, PDEANIM_ALL_OBJECTS, points);
    REFUSES(pdeanim_evaluate, animation, positions, NULL, 2, PDEANIM_ALL_OBJECTS, points);
    REFUSES(pdeanim_evaluate, animation, positions, times, 2, PDEANIM_ALL_OBJECTS, NULL);
    REFUSES(pdeanim_evaluate, animation, positions, not_numbers, 2, PDEANIM_ALL_OBJECTS, points);
    REFUSES(pdeanim_evaluate, animation, unknown, times, 2, PDEANIM_ALL_OBJECTS, points);
    REFUSES(pdeanim_evaluate, animation, negative, times, 2, PDEANIM_ALL_OBJECTS, points);
    REFUSES(pdeanim_evaluate, animation, positions, times, 2, -2, points);
    REFUSES(pdeanim_evaluate, animation, positions, times, 2, INT64_MAX, points);
    REFUSES(pdeanim_evaluate, animation, positions, times, SIZE_MAX, PDEANIM_ALL_OBJECTS, points);
    REFUSES(pdeanim_evaluate, animation, positions, times, SIZE_MAX / 12, PDEANIM_ALL_OBJECTS, points);
    REFUSES(pdeanim_evaluate, runs, positions, times, 2, PDEANIM_ALL_OBJECTS, points);
    RETURNS(PDEANIM_OK, pdeanim_evaluate, animation, positions, NULL, 0, PDEANIM_ALL_OBJECTS, NULL);
    RETURNS(PDEANIM_OK, pdeanim_evaluate, animation, positions, endless, 2, PDEANIM_ALL_OBJECTS, points);

    REFUSES(pdeanim_field_count, NULL, &number);
    REFUSES(pdeanim_field_count, closed, &number);
    REFUSES(pdeanim_field_count, animation, NULL);
    REFUSES(pdeanim_field_count, runs, &number);
    RETURNS(PDEANIM_OK, pdeanim_field_count, animation, &number);

    REFUSES(pdeanim_get_field, NULL, 0, &field);
    REFUSES(pdeanim_get_field, closed, 0, &field);
    REFUSES(pdeanim_get_field, animation, 0, NULL);
    REFUSES(pdeanim_get_field, animation, 0, &field);
    REFUSES(pdeanim_get_field, animation, -1, &field);
    REFUSES(pdeanim_get_field, fields, INT64_MAX, &field);
    REFUSES(pdeanim_get_field, runs, 0, &field);
    RETURNS(PDEANIM_OK, pdeanim_get_field, fields, 0, &field);
    const size_t row = (size_t)(field.row_count * field.column_count) * field.value_bytes;
    void *values = calloc(row, 2);

    REFUSES(pdeanim_evaluate_field, NULL, 0, times, 1, 0, out, 4);
    REFUSES(pdeanim_evaluate_field, closed, 0, times, 1, 0, out, 4);
    REFUSES(pdeanim_evaluate_field, animation, 0, NULL, 1, 0, out, 4);
    REFUSES(pdeanim_evaluate_field, animation, 0, times, 1, 0, NULL, 4);
    REFUSES(pdeanim_evaluate_field, animation, 0, times, 1, 0, out, 4);
    REFUSES(pdeanim_evaluate_field, runs, 0, times, 1, 0, out, 4);
    REFUSES(pdeanim_evaluate_field, fields, -1, times, 2, 0, values, 2 * row);
    REFUSES(pdeanim_evaluate_field, fields, INT64_MAX, times, 2, 0, values, 2 * row);
    REFUSES(pdeanim_evaluate_field, fields, 0, NULL, 2, 0, values, 2 * row);
    REFUSES(pdeanim_evaluate_field, fields, 0, times, 2, 0, NULL, 2 * row);
    REFUSES(pdeanim_evaluate_field, fields, 0, not_numbers, 2, 0, values, 2 * row);
    REFUSES(pdeanim_evaluate_field, fields, 0, times, 2, 0, values, 2 * row - 1);
    REFUSES(pdeanim_evaluate_field, fields, 0, times, 2, 0, values, row);
    REFUSES(pdeanim_evaluate_field, fields, 0, times, SIZE_MAX, 0, values, row);
    REFUSES(pdeanim_evaluate_field, fields, 0, times, SIZE_MAX / row + 1, 0, values, row);
    REFUSES(pdeanim_evaluate_field, fields, 0, times, 2, 3, values, 2 * row);
    REFUSES(pdeanim_evaluate_field, fields, 0, times, 2, -1, values, 2 * row);
    RETURNS(PDEANIM_OK, pdeanim_get_field, fields, 2, &field);
    const size_t whole = (size_t)(field.row_count * field.column_count) * field.value_bytes;
    REFUSES(pdeanim_evaluate_field, fields, 2, times, 1, 1, values, whole);
    RETURNS(PDEANIM_OK, pdeanim_evaluate_field, fields, 2, times, 1, 0, values, whole);
    RETURNS(PDEANIM_OK, pdeanim_evaluate_field, fields, 0, NULL, 0, 0, NULL, 0);
    RETURNS(PDEANIM_OK, pdeanim_evaluate_field, fields, 0, endless, 2, 0, values, 2 * row);

    REFUSES(pdeanim_get_group, NULL, 0, &group);
    REFUSES(pdeanim_get_group, closed, 0, &group);
    REFUSES(pdeanim_get_group, animation, 0, NULL);
    REFUSES(pdeanim_get_group, animation, -1, &group);
    REFUSES(pdeanim_get_group, animation, INT64_MAX, &group);
    REFUSES(pdeanim_get_group, runs, 0, &group);

    REFUSES(pdeanim_reference, NULL, out);
    REFUSES(pdeanim_reference, closed, out);
    REFUSES(pdeanim_reference, animation, NULL);
    REFUSES(pdeanim_reference, runs, out);

    REFUSES(pdeanim_groups_at, NULL, positions, 0.0, &first, &number);
    REFUSES(pdeanim_groups_at, closed, positions, 0.0, &first, &number);
    REFUSES(pdeanim_groups_at, animation, positions, 0.0, NULL, &number);
    REFUSES(pdeanim_groups_at, animation, positions, 0.0, &first, NULL);
    REFUSES(pdeanim_groups_at, animation, positions, NAN, &first, &number);
    REFUSES(pdeanim_groups_at, animation, unknown, 0.0, &first, &number);
    REFUSES(pdeanim_groups_at, runs, positions, 0.0, &first, &number);

    REFUSES(pdeanim_weights, NULL, positions, 0.0, 0, weights);
    REFUSES(pdeanim_weights, closed, positions, 0.0, 0, weights);
    REFUSES(pdeanim_weights, animation, positions, 0.0, 0, NULL);
    REFUSES(pdeanim_weights, animation, positions, NAN, 0, weights);
    REFUSES(pdeanim_weights, animation, negative, 0.0, 0, weights);
    REFUSES(pdeanim_weights, animation, positions, 0.0, -1, weights);
    REFUSES(pdeanim_weights, animation, positions, 0.0, INT64_MAX, weights);
    REFUSES(pdeanim_weights, runs, positions, 0.0, 0, weights);

    REFUSES(pdeanim_fields, NULL, 0, out);
    REFUSES(pdeanim_fields, closed, 0, out);
    REFUSES(pdeanim_fields, animation, 0, NULL);
    REFUSES(pdeanim_fields, animation, -1, out);
    REFUSES(pdeanim_fields, animation, INT64_MAX, out);
    REFUSES(pdeanim_fields, runs, 0, out);

    REFUSES(pdeanim_corrections, NULL, 0, &corrections, &number);
    REFUSES(pdeanim_corrections, closed, 0, &corrections, &number);
    REFUSES(pdeanim_corrections, animation, 0, NULL, &number);
    REFUSES(pdeanim_corrections, animation, 0, &corrections, NULL);
    REFUSES(pdeanim_corrections, animation, -1, &corrections, &number);
    REFUSES(pdeanim_corrections, animation, INT64_MAX, &corrections, &number);
    REFUSES(pdeanim_corrections, runs, 0, &corrections, &number);

    REFUSES(pdeanim_elements, NULL, elements);
    REFUSES(pdeanim_elements, closed, elements);
    REFUSES(pdeanim_elements, animation, NULL);
    REFUSES(pdeanim_elements, runs, elements);

    REFUSES(pdeanim_get_section, NULL, 0, &section);
    REFUSES(pdeanim_get_section, closed, 0, &section);
    REFUSES(pdeanim_get_section, animation, 0, NULL);
    REFUSES(pdeanim_get_section, animation, -1, &section);
    REFUSES(pdeanim_get_section, animation, INT64_MAX, &section);

    REFUSES(pdeanim_verify, NULL);
    REFUSES(pdeanim_verify, closed);
    expect(pdeanim_verify(animation, &error) == PDEANIM_OK && pdeanim_verify(runs, NULL) == PDEANIM_OK,
           "both files are still sound at the end");
    pdeanim_close(animation);
    pdeanim_close(fields);
    pdeanim_close(runs);
    pdeanim_close(runs);
    free(values);
    free(points);
    free(data);
    free(data_of_runs);
    free(data_of_fields);
    printf("%d misuses of the C interface, %d not as they must be\n", rows, faults);
    return faults ? EXIT_FAILURE : EXIT_SUCCESS;
}
