// Coding of one attribute: its head in the stream, the encoder's plan, and the model of its values.
#pragma once

#include <vector>

#include "entropy/range_coder.hpp"
#include "sections/attributes/attribute_mesh.hpp"
#include "sections/attributes/attributes.hpp"
#include "sections/attributes/scales.hpp"
#include "sections/attributes/wedges.hpp"

namespace pdeanim {

// The head of an attribute, and the encoder's plan for it.

// Kinds of values: float32 and uint8 that are measured, 1 to 4 per row; int32 and uint8 that are labels; numbers of the
// fans of a vertex's corners; and from `raw` on, bytes of each ValueType.
enum Kind : i64 { floats, colours, integers, flags, fans, raw, kind_end = raw + value_types };

// The data coded before an attribute's values.
struct AttributeHead {
    i64 channels() const { return columns ? columns - 1 : 1; }  // number of numbers per row
    ValueType type() const;
    bool is_possible() const;  // whether attributes of this kind exist

    std::string name;
    i64 domain = 0, kind = 0, columns = 0, rule = 0;
    i64 elements = 0;  // number of objects for domain "object", 0 for other domains
    i64 rows = 0;      // 0 unless the rule is `listed`
    std::vector<std::string> labels;
};

struct AttributePlan {
    AttributeHead head;
    std::span<const i32> indices;  // empty if there are no indices
    // Values of rows, or of elements if the rule is `first_used` or more: measured values or labels as codes, others as
    // bytes.
    Channels channels;
    std::span<const u8> bytes;
};

AttributePlan plan_of(const AttributeView &attribute, const AttributeMesh &mesh, const AttributeSettings &settings);

// The values of wedges: predicted, with exact residuals.
//
// Values of a channel have integer codes. If there are few different values, they form a table and are coded by their
// place in it. If a few values of many are common (0 and 1 where texture coordinates are clipped), a flag first says
// whether a value is common.

// Codes of wedges in rows, and the tables that the codes refer to.
struct Codes {
    // Some values of a channel, ascending. If the table is complete, all values are in it and codes are places in the
    // table.
    struct Table {
        std::vector<i64> entries;
        bool is_complete = false;
    };

    std::vector<i32> codes;
    std::vector<Table> tables;  // one table per channel

    // Return the codes, with places in complete tables replaced by the entries.
    std::vector<i32> full() const;
};

class ValueModel {
public:
    ValueModel();

    // Code the values of all wedges: read when encoding, written when decoding. CorruptError if a value is out of
    // range.
    template <Mode mode> void code(RangeCoder<mode> &coder, WedgeField &field, Codes &codes);

private:
    // The context of a residual.
    struct Outlook {
        int channel;
        int expected;  // length of the residuals of the neighbours
        int before;    // 1 + the residual's length in the channel before; 0 in the first channel
        int spread;    // 1 + the length of the difference of the two best predictions; 0 if there is only one
        int lean;      // where the second best prediction lies: 0 below, 1 equal, 2 above
        int best;      // 1 + the kind of the best prediction; 0 if there is none
        int count;     // number of predictions of that kind
    };

    template <Mode mode>
    i64 code_residual(RangeCoder<mode> &coder, bool is_place, const Outlook &outlook, i64 residual);

    template <Mode mode> i64 code_common(RangeCoder<mode> &coder, const std::vector<i64> &table, i64 nearest,
                                         int distance, const Outlook &outlook, i64 code);

    enum Step { first, up, down, steps };  // decisions on a length: the first, then up or down

    static constexpr int longest = 32;         // binary digits of the largest residual
    static constexpr int sizes = longest + 3;  // lengths that are distinguished
    static constexpr int predictions = 4 * (WedgeField::ways + 1);
    static constexpr int rows = (longest + 1) * steps;

    std::vector<BitModel> by_channel_, by_prediction_, by_spread_;  // inputs of a decision on a length
    std::array<std::array<BitModel, 4>, longest + 1> digits_;
    std::array<BitModel, 3 * 4 * (WedgeField::ways + 1)> signs_;
    // Models for the decision whether a value is in the table, and for its place in the table.
    std::array<BitModel, 16 * 16> common_near_;
    std::array<BitModel, predictions * sizes> common_by_prediction_;
    std::array<BitModel, 16 * most_channels * sizes> common_expected_;
    std::array<BitModel, 4 * sizes> which_;
    std::array<BitModel, most_channels> alike_;  // whether a channel equals the previous channel
    // Weights for decisions on lengths, of residuals of values and of places in a table, by step and kind of
    // prediction; and for whether a value is common.
    std::array<std::array<std::array<Weights<3>, WedgeField::ways + 1>, steps>, 2> length_weights_;
    Weights<3> common_weights_;
    int history_ = 0;  // which of the last 4 values were common
};

}  // namespace pdeanim
