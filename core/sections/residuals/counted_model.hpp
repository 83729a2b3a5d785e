// Numbers from 1 to 2^43 - 1: how many binary digits, one by one, then the digits as bypass bits.
#pragma once

#include "entropy/range_coder.hpp"

namespace pdeanim {

class CountedModel {
public:
    template <Mode mode> i64 code(RangeCoder<mode> &coder, i64 value) {
        const int wanted = bit_length(value);
        int digits = 1;
        while (digits < most_digits && coder.bit(more_[digits - 1], wanted > digits)) ++digits;
        i64 found = 1;
        for (int place = digits - 2; place >= 0; --place) found = 2 * found + coder.bypass((value >> place) & 1);
        return found;
    }

private:
    static constexpr int most_digits = 43;  // a miss is at most 2^42
    std::array<BitModel, most_digits> more_;
};

}  // namespace pdeanim
