// Headers of fields (25.1 and 25.2 of the specification): what each field is, and where the chunks of its groups are.
#pragma once

#include <string>
#include <vector>

#include "decode/run_sections.hpp"
#include "sections/fields/field_rows.hpp"

namespace pdeanim {

enum class FieldType : u8 { f32, f64, i8, i16, i32, i64, u8, u16, u32, u64, boolean };
constexpr int field_types = 11;

inline bool is_float(FieldType type) { return type <= FieldType::f64; }
inline i64 size_of_type(FieldType type) {
    constexpr i64 sizes[field_types] = {4, 8, 1, 2, 4, 8, 1, 2, 4, 8, 1};
    return sizes[static_cast<int>(type)];
}

// How the whole numbers of a chunk become values: unchanged (the bits of floats, mapped so that their order is kept);
// in pairs of 32 bits, the higher half first; or times a quantisation step. The other codings have no chunk: their
// values are computed from another field, or from the motion.
enum class FieldCode : u8 { exact, halves, quantised, copy, magnitude, velocity, displacement };
constexpr int field_codes = 7;

inline bool is_computed(FieldCode code) { return code >= FieldCode::copy; }
inline bool has_source(FieldCode code) { return code == FieldCode::copy || code == FieldCode::magnitude; }

// Consecutive frames of a field. They use some frames of a chunk; the last of these also stands for the remaining
// frames.
struct FieldGroup {
    i64 first = 0, frames = 0;      // frames of the clip
    i64 skipped = 0, in_chunk = 0;  // frames of the chunk that are not used, and frames of the chunk in total
    FieldCode code = FieldCode::exact;
    double unit = 0.0;  // width of a quantisation step
    u64 offset = 0, size = 0;
    u32 checksum = 0;
    // For a copy: index of the source field, and the source's component that becomes component 0.
    i64 source = 0, component = 0;
};

struct FieldHeader {
    std::string name, unit;
    Domain domain = Domain::vertex;
    FieldType type = FieldType::f32;
    i64 components = 1;
    std::vector<i64> objects;          // indices of the objects that have the field, ascending; empty if all have it
    double smallest = 0, largest = 0;  // smallest and largest value of the source, without NaN and infinities
    double bound = 0;                  // largest error; 0: values are exact
    std::vector<FieldGroup> groups;
    bool computes_from_field = false;  // whether any group is a copy or a magnitude
    std::size_t first_of_rows = 0;     // index of the first field with the same domain and objects

    std::size_t group_of(i64 frame) const;
};

// Read section FLDS; without this section there are no fields. CorruptError if it is damaged, LimitError if it needs
// too much memory.
std::vector<FieldHeader> read_field_headers(RunSections &run);

}  // namespace pdeanim
