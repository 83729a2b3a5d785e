// Fields: values on vertices, faces, corners or objects that change in time (25 of the specification).
//
// FLDS has a header for each field, FDAT the chunks of its groups of frames. A chunk is whole numbers, which become
// values by the coding of the group.
#pragma once

#include <list>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "decode/evaluator.hpp"
#include "decode/run_sections.hpp"
#include "sections/fields/field_domain.hpp"

namespace pdeanim {

enum class FieldType : u8 { f32, f64, i8, i16, i32, i64, u8, u16, u32, u64, boolean };
constexpr int field_types = 11;

inline bool is_float(FieldType type) { return type <= FieldType::f64; }
inline i64 size_of_type(FieldType type) {
    constexpr i64 sizes[field_types] = {4, 8, 1, 2, 4, 8, 1, 2, 4, 8, 1};
    return sizes[static_cast<int>(type)];
}

// How whole numbers become values: themselves (floats: by their bits, in order), pairs of 32 bits, the higher half first,
// or times a unit. The others have no chunk: values are computed from those of another field, or from the motion.
enum class FieldCode : u8 { exact, halves, quantised, copy, magnitude, velocity, displacement };
constexpr int field_codes = 7;

inline bool is_computed(FieldCode code) { return code >= FieldCode::copy; }
inline bool has_source(FieldCode code) { return code == FieldCode::copy || code == FieldCode::magnitude; }

// Consecutive frames of a field: some frames of a chunk, the last of which holds for the rest.
struct FieldGroup {
    i64 first = 0, frames = 0;      // frames of the clip
    i64 skipped = 0, in_chunk = 0;  // frames of the chunk, the skipped ones included
    FieldCode code = FieldCode::exact;
    double unit = 0.0;  // width of a quantisation step
    u64 offset = 0, size = 0;
    u32 checksum = 0;
    i64 source = 0, component = 0;  // of a copy: number of the field, and its component that is the first here
};

struct FieldHeader {
    std::string name, unit;
    FieldSite site = FieldSite::vertex;
    FieldType type = FieldType::f32;
    i64 components = 1;
    std::vector<i64> objects;          // indices of the objects that have the field, ascending; empty if all have it
    double smallest = 0, largest = 0;  // range of the source's values, without NaN and infinities
    double bound = 0;                  // largest error; 0: exact
    std::vector<FieldGroup> groups;

    std::size_t group_of(i64 frame) const;
};

// Functions may be called from several threads, which take turns.
class StoredFields {
public:
    // All of them must outlive it. largest_budget: bytes of decoded groups at most.
    StoredFields(RunSections &run, Evaluator &evaluator, Turns &turns, i64 largest_budget)
        : run_(run), evaluator_(evaluator), turns_(turns), largest_budget_(largest_budget) {}

    // CorruptError or LimitError if they are damaged, or ask for too much.
    const std::vector<FieldHeader> &headers();

    // Number of rows of a field, of all objects or of one.
    i64 rows(std::size_t field, std::optional<i64> object = std::nullopt);

    // Write the values of frames: out is (frames, rows, components) of the field's type.
    void read(std::size_t field, i64 first, i64 frames, std::span<u8> out);

    // Write values at times [s], or derivatives [1/s] of floats. Between frames floats follow the spline through all
    // frames; other types, and values near which one is not finite, are those of the frame before. Outside the clip its
    // first or last frame stands still.
    void evaluate(std::size_t field, std::span<const double> times, int derivative, std::optional<i64> object,
                  std::span<u8> out);

    // Check and decode every group.
    void verify();

    // Check the bytes of a group.
    void check(std::size_t field, std::size_t group);

private:
    struct Kept {
        std::size_t field, part;  // part: a group, or a frame that is computed
        std::vector<u8> values;   // (frames of the chunk, rows, components) of the field's type
        TakenMemory taken;
    };
    using KeptParts = std::list<Kept>;  // the latest first

    const FieldDomain &domain(const FieldHeader &header);
    std::vector<u8> chunk(const FieldGroup &group);
    const std::vector<u8> &group(std::size_t field, std::size_t group);
    std::span<const u8> frame(std::size_t field, i64 frame);
    std::span<const u8> computed_frame(std::size_t field, const FieldGroup &group, i64 frame);
    const std::vector<u8> *find(KeptParts &kept, std::size_t field, std::size_t part);
    template <class Real>
    void compute(const FieldHeader &header, const FieldGroup &group, i64 frame, std::span<u8> out);
    std::pair<i64, i64> rows_of(std::size_t field, std::optional<i64> object);
    template <class Real> void mix(std::size_t field, double time, int derivative, i64 skip, std::span<Real> out);

    RunSections &run_;
    Evaluator &evaluator_;
    Turns &turns_;
    i64 largest_budget_;
    std::optional<std::vector<FieldHeader>> headers_;
    std::map<std::pair<int, std::vector<i64>>, FieldDomain> domains_;
    KeptParts kept_, computed_;
    std::vector<float> first_positions_;  // of frame 0, if displacements need them
    std::optional<BrokenSpline> spline_;
};

}  // namespace pdeanim
