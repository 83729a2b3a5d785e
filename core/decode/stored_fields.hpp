// Fields: values on vertices, faces, corners, objects or cells that change in time (25 of the specification).
//
// FLDS has a header for each field, FDAT the chunks of its groups of frames. A chunk consists of whole numbers; the
// group's coding turns them into values.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "decode/evaluator.hpp"
#include "decode/field_headers.hpp"

namespace pdeanim {

// The fields of a run: decodes their values at frames and interpolates between frames. Functions may be called from
// several threads, which take turns.
class StoredFields {
public:
    // The arguments must outlive this object.
    StoredFields(RunSections &run, DecodedCache &cache, Evaluator &evaluator, Turns &turns)
        : run_(run), cache_(cache), evaluator_(evaluator), turns_(turns) {}

    // Return the headers of all fields. CorruptError if they are damaged, LimitError if they need too much memory.
    const std::vector<FieldHeader> &headers();

    // Return the number of rows of a field, in all objects or in one.
    i64 rows(std::size_t field, std::optional<i64> object = std::nullopt);

    // Write the values of frames: out is (frames, rows, components) of the field's type.
    void read(std::size_t field, i64 first, i64 frames, std::span<u8> out);

    // Write values at times [s], or derivatives [1/s, 1/s^2] of floats. Between frames, floats follow the spline
    // through all frames. Other types, and floats where the spline is not finite, keep the value of the earlier frame.
    // Before the first frame and after the last one, values stand still.
    void evaluate(std::size_t field, std::span<const double> times, int derivative, std::optional<i64> object,
                  std::span<u8> out);

    // Check and decode every group.
    void verify();

    // Check the bytes of a group. deep: also decode it, together with the field or the motion that it is computed from.
    void check(std::size_t field, std::size_t group, bool deep);

private:
    template <class Visit> void for_each_owner(const FieldHeader &header, const Visit &visit);
    const FieldRows &rows_with_neighbours(const FieldHeader &header);
    std::vector<u8> chunk(const FieldGroup &group);
    const std::vector<u8> &group(std::size_t field, std::size_t group);
    std::span<const u8> frame(std::size_t field, i64 frame);
    std::span<const u8> decoded_frame(std::size_t field, i64 frame);
    std::span<const u8> computed_frame(std::size_t field, const FieldGroup &group, i64 frame);
    template <class Real>
    void compute(const FieldHeader &header, const FieldGroup &group, i64 frame, std::span<u8> out);
    std::pair<i64, i64> rows_of(std::size_t field, std::optional<i64> object);
    template <class Real> void mix(std::size_t field, double time, int derivative, i64 skip, std::span<Real> out);

    RunSections &run_;
    DecodedCache &cache_;
    Evaluator &evaluator_;
    Turns &turns_;
    std::optional<std::vector<FieldHeader>> headers_;
    std::vector<std::optional<i64>> row_counts_;  // number of rows of each field, once it is counted
    std::vector<float> first_positions_;          // at frame 0, if displacements need them
    TakenMemory of_first_positions_;
    std::optional<BrokenSpline> spline_;
};

}  // namespace pdeanim
