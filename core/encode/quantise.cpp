#include "encode/quantise.hpp"

#include <algorithm>
#include <cmath>
#include <mutex>

#include "base/parallel.hpp"

namespace pdeanim {

template <class Real> Quantised quantise_sparsely(std::span<const Real> values, i64 channels, int axes, double step,
                                                  const DeadZone &zone, int threads) {
    Quantised all{LargeArray<i64>(values.size()), std::vector<i64>(channels)};
    std::mutex lock;
    const i64 rows = channels ? static_cast<i64>(values.size()) / channels : 0;
    const double round_up = 1.0 - zone.round_up_at, alone = zone.round_up_alone_at * step;
    const double surely_zero = 0.999 * zone.round_up_at * step;  // of most it is seen without a division
    const auto size_at = [&](i64 at) { return std::fabs(static_cast<double>(values[at])); };
    const auto magnitude = [&](i64 at) { return std::floor(size_at(at) / step + round_up); };
    const auto is_used = [&](i64 row, i64 channel) {
        return 0 <= row && row < rows && 0 <= channel && channel < channels && magnitude(row * channels + channel) != 0;
    };
    in_shares(rows, threads, [&](i64 first, i64 end) {
        std::vector<i64> largest(channels);
        for (i64 row = first; row < end; ++row) {
            std::fill_n(all.coefficients.begin() + row * channels, channels, 0);
            for (i64 channel = 0; channel < channels; ++channel) {
                const i64 at = row * channels + channel;
                if (size_at(at) < surely_zero) continue;
                const double size = magnitude(at);
                if (size == 0.0) continue;
                if (size_at(at) < alone && !is_used(row - 1, channel) && !is_used(row + 1, channel) &&
                    !is_used(row, channel - axes) && !is_used(row, channel + axes)) {
                    continue;
                }
                const i64 whole = static_cast<i64>(size);
                all.coefficients[at] = values[at] < 0 ? -whole : whole;
                largest[channel] = most(largest[channel], whole);
            }
        }
        const std::lock_guard guard(lock);
        for (i64 channel = 0; channel < channels; ++channel) {
            all.largest[channel] = most(all.largest[channel], largest[channel]);
        }
    });
    return all;
}

template Quantised quantise_sparsely(std::span<const float>, i64, int, double, const DeadZone &, int);
template Quantised quantise_sparsely(std::span<const double>, i64, int, double, const DeadZone &, int);

}  // namespace pdeanim
