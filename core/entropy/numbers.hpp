// Whole numbers of any size: how many binary digits, one by one, then the digits.
//
// The first three digits below the leading one depend on those before; the others are as good as noise and cost a bit
// each.
#pragma once

#include "entropy/range_coder.hpp"

namespace pdeanim {

// Numbers from 0 to 2^32 - 2: twice the largest vertex index and its sign fit.
class NumberModel {
public:
    template <Mode mode> i64 code(RangeCoder<mode> &coder, i64 value) {
        int digits = 1;
        while (digits < most_digits && coder.bit(more_[digits], (value + 1) >> digits > 0)) ++digits;
        i64 found = 1;
        for (int place = digits - 2; place >= 0; --place) {
            bool bit = ((value + 1) >> place) & 1;
            if (place >= digits - 1 - modelled_digits) {
                bit = coder.bit(digits_[digits - 1][found], bit);
            } else {
                bit = coder.bypass(bit);
            }
            found = 2 * found + bit;
        }
        return found - 1;
    }

private:
    static constexpr int most_digits = 32, modelled_digits = 3;
    std::array<BitModel, most_digits> more_;
    std::array<std::array<BitModel, 1 << modelled_digits>, most_digits> digits_;
};

// Numbers of either sign: whether it is 0, its sign, and its magnitude less 1.
class SignedModel {
public:
    template <Mode mode> i64 code(RangeCoder<mode> &coder, i64 value) {
        if (coder.bit(zero_, value == 0)) return 0;
        const bool negative = coder.bit(sign_, value < 0);
        const i64 magnitude = 1 + magnitude_[negative].code(coder, size_of(value) - 1);
        return negative ? -magnitude : magnitude;
    }

private:
    BitModel zero_, sign_;
    std::array<NumberModel, 2> magnitude_;
};

}  // namespace pdeanim
