#include "sections/residuals/miss_model.hpp"

#include "base/errors.hpp"
#include "sections/residuals/residuals.hpp"

namespace pdeanim {

template <Mode mode> i64 MissModel::code(RangeCoder<mode> &coder, const MissContext &known, i64 miss) {
    const i64 size_in_time = size_of(known.in_time), size_in_space = size_of(known.in_space);
    const i64 beside = 2 * known.one_before + known.two_before;
    const i64 expected = 3 * size_in_time + 2 * size_in_space + beside + (known.mean_size >> 4);
    const int digits = bit_length(expected), shift = most(digits - fine_digits, 0);
    const bool is_coarse = shift > 0;
    const i64 kind = is_coarse       ? 20 + ((expected >> (digits - 3)) & 3)
                     : expected < 12 ? expected
                                     : least<i64>(12 + ((expected - 12) >> 2), 19);
    auto &of_kind = by_expected_[kind][known.axis];
    auto &of_near = by_near_[known.has_reference ? least<i64>(size_in_time >> shift, 6) : 7]
                            [known.has_before ? least<i64>(size_in_space >> shift, 6) : 7][is_coarse];
    auto &of_beside = by_beside_[least<i64>(known.one_before >> shift, 7)][least<i64>(known.two_before >> shift, 7)]
                                [known.axis][is_coarse];
    bool is_negative = miss < 0;
    const i64 size = is_negative ? -miss - is_coarse : miss;  // a coarse 0 counts as positive, -1 as the first negative
    const i64 wanted = size >> shift;
    i64 found = known.is_not_zero && !is_coarse;
    while (found < most_counted && coder.template mixed<3>({&of_kind[found], &of_near[found], &of_beside[found]},
                                                           count_weights_[found][is_coarse].data(), wanted > found)) {
        ++found;
    }
    const i64 counted = found;
    if (counted == most_counted) found += rest_.code(coder, wanted - most_counted + 1) - 1;
    if (is_coarse || found) {
        const int in_time = sign_of(known.in_time) + 1, in_space = sign_of(known.in_space) + 1;
        is_negative = coder.template mixed<3>(
            {&signs_[in_time][in_space][is_coarse],
             &signs_in_time_[in_time][sign_of(known.agreed_in_time) + 1][least<i64>(size_in_time, 2)][is_coarse],
             &signs_in_space_[in_space][sign_of(known.agreed_in_space) + 1][known.axis][is_coarse]},
            sign_weights_[is_coarse].data(), is_negative);
    }
    if (found > 4 * largest_residual >> shift) throw CorruptError("a residual is out of range");
    int upper = 1;
    for (int place = shift - 1; place >= 0; --place) {
        bool bit = (size >> place) & 1;
        if (upper < 1 << modelled_digits) {
            bit = coder.bit(lower_digits_[counted][upper], bit);
            upper = 2 * upper + bit;
        } else {
            bit = coder.bypass(bit);
        }
        found = 2 * found + bit;
    }
    return is_negative ? -found - is_coarse : found;
}

template i64 MissModel::code(RangeCoder<Mode::encode> &, const MissContext &, i64);
template i64 MissModel::code(RangeCoder<Mode::decode> &, const MissContext &, i64);
template i64 MissModel::code(RangeCoder<Mode::measure> &, const MissContext &, i64);

}  // namespace pdeanim
