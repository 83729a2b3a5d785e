// How an attribute is coded: what stands before its values in the stream, and what the encoder makes of it.
#pragma once

#include "sections/attributes/attribute_mesh.hpp"
#include "sections/attributes/attributes.hpp"
#include "sections/attributes/scales.hpp"

namespace pdeanim {

// Kinds of values: float32 and uint8 that measure, 1 to 4 a row; int32 and uint8 that count; numbers of the fans that a
// vertex's corners fall into; and from `raw` on bytes of each ValueType.
enum Kind : i64 { floats, colours, integers, flags, fans, raw, kind_end = raw + value_types };

// What is coded before an attribute's values.
struct AttributeHead {
    i64 channels() const { return columns ? columns - 1 : 1; }  // numbers in a row
    ValueType type() const;
    bool is_possible() const;  // whether there are attributes of this kind

    std::string name;
    i64 domain = 0, kind = 0, columns = 0, rule = 0;
    i64 elements = 0;  // of domain "object"; 0 of others
    i64 rows = 0;      // under rule `listed`; else 0
    std::vector<std::string> labels;
};

struct AttributePlan {
    AttributeHead head;
    std::span<const i32> indices;  // where there are any
    // Of rows of values, of elements from rule `first_used` on: what measures or counts, and the bytes of what is raw.
    Channels channels;
    std::span<const u8> bytes;
};

AttributePlan plan_of(const AttributeView &attribute, const AttributeMesh &mesh, const AttributeSettings &settings);

}  // namespace pdeanim
