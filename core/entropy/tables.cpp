#include "entropy/range_coder.hpp"

// The compiler evaluates the functions below. No value is within 1e-5 of a tie before rounding, and the functions are
// off by less than 1e-7, so errors of floating point change no entry; the digests at the end prove it.

namespace pdeanim::tables {

namespace {

constexpr i32 rounded(double value) { return static_cast<i32>(value < 0.0 ? value - 0.5 : value + 0.5); }

constexpr double log_of_2 = 0.693147180559945309417;

// Natural logarithms of the odd numbers 1, 3, ..., 8191: log(n + 2) - log(n) = 2 (y + y^3/3 + y^5/5 + ...) with
// y = 1 / (n + 1).
constexpr std::array<double, 4096> logs = [] {
    std::array<double, 4096> found{};
    for (int i = 1; i < 4096; ++i) {
        const double y = 1.0 / (2 * i);
        double sum = 0.0, power = y;
        for (int odd = 1; power > 1e-18; odd += 2) {
            sum += power / odd;
            power *= y * y;
        }
        found[i] = found[i - 1] + 2.0 * sum;
    }
    return found;
}();

template <class Numbers> constexpr u64 digest_of(const Numbers &numbers) {
    u64 digest = 0;
    for (const auto number : numbers) digest = digest * 0x100000001b3 + static_cast<u64>(static_cast<i64>(number));
    return digest;
}

}  // namespace

constexpr std::array<u16, 2 * logistic_limit + 1> squash = [] {
    constexpr double step = 1.00391388933834757344;  // exp(1/256)
    std::array<u16, 2 * logistic_limit + 1> found{};
    double odds = 1.0;
    for (int x = 0; x <= logistic_limit; ++x, odds *= step) {
        const i32 probability = clamp(rounded(65536.0 * odds / (1.0 + odds)), rarest, 65536 - rarest);
        found[logistic_limit + x] = static_cast<u16>(probability);
        found[logistic_limit - x] = static_cast<u16>(65536 - probability);
    }
    return found;
}();

constexpr std::array<i16, 4096> stretch = [] {
    std::array<i16, 4096> found{};
    for (int p = 0; p < 4096; ++p) found[p] = static_cast<i16>(rounded(256.0 * (logs[p] - logs[4095 - p])));
    return found;
}();

constexpr std::array<i32, 4096> costs = [] {
    std::array<i32, 4096> found{};
    for (int p = 0; p < 4096; ++p) found[p] = rounded(65536.0 * (13.0 - logs[p] / log_of_2));
    return found;
}();

static_assert(digest_of(squash) == 0x4140c16d3ef91a48);
static_assert(digest_of(stretch) == 0x869c7a1d84b9feb2);
static_assert(digest_of(costs) == 0xd90dff406aa5a252);

}  // namespace pdeanim::tables
