#include "sections/spatial/still_vertices.hpp"

#include <algorithm>
#include <array>

#include "base/errors.hpp"
#include "entropy/range_coder.hpp"

namespace pdeanim {

namespace {

// Codes bits with the four bits before as context.
template <Mode mode> class BitHistory {
public:
    bool code(RangeCoder<mode> &coder, bool bit) {
        bit = coder.bit(models_[history_], bit);
        history_ = (2 * history_ + bit) % histories;
        return bit;
    }

private:
    static constexpr int histories = 16;
    std::array<BitModel, histories> models_;
    int history_ = 0;
};

// Code for each object that has vertices whether all of them do the same; then one bit for all, or one for each.
template <Mode mode>
void code_still(RangeCoder<mode> &coder, std::span<u8> still, std::span<const i64> first_vertices) {
    BitHistory<mode> of_parts, of_objects, of_vertices;
    for (std::size_t object = 0; object + 1 < first_vertices.size(); ++object) {
        const auto begin = still.begin() + first_vertices[object], end = still.begin() + first_vertices[object + 1];
        if (begin == end) continue;
        coder.check_not_ended();
        const auto is_other = [&](u8 own) { return own != *begin; };
        if (of_parts.code(coder, mode != Mode::decode && std::any_of(begin, end, is_other))) {
            for (auto at = begin; at < end; ++at) *at = of_vertices.code(coder, *at != 0);
        } else {
            std::fill(begin, end, of_objects.code(coder, *begin != 0));
        }
    }
}

}  // namespace

std::vector<u8> encode_still(std::span<const u8> still, std::span<const i64> first_vertices) {
    RangeCoder<Mode::encode> coder;
    std::vector<u8> own(still.begin(), still.end());  // encoding does not change it
    code_still(coder, std::span(own), first_vertices);
    return coder.finish();
}

std::vector<u8> decode_still(std::span<const u8> data, std::span<const i64> first_vertices) {
    RangeCoder<Mode::decode> coder(data);
    std::vector<u8> still(first_vertices.back());
    code_still(coder, std::span(still), first_vertices);
    if (!coder.is_finished()) {
        throw CorruptError(Section("MODL"), "says of more vertices than there are that they stand still");
    }
    return still;
}

}  // namespace pdeanim
