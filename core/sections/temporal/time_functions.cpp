#include "sections/temporal/time_functions.hpp"

#include <algorithm>
#include <memory>
#include <stdexcept>
#include <string>
#include <type_traits>

#include "base/errors.hpp"
#include "entropy/numbers.hpp"
#include "entropy/range_coder.hpp"

namespace pdeanim {

namespace {

// Context models of quantised functions of time.
//
// A number is coded as its exponent, then the digits after the leading one, then the sign. Coding of the exponent
// starts at the one that neighbours (in time or frequency, among axes, among functions) make likely, and goes up or
// down from there, so large numbers take few decisions.

// Exponent e stands for magnitudes 2^e - 1 to 2^(e + 1) - 2. The limit keeps all sums in this file within 64 bits.
constexpr int most_exponent = 39;
// Number of exponents that are distinguished; larger ones share the last, because numbers beyond 65534 are rare.
constexpr int exponents = 16;
// Decisions on a number: is its exponent larger? smaller? what is the digit after the leading one?
enum Decision { rise = 0, fall = exponents, top_bit = 2 * exponents, decisions = 3 * exponents };
// Number of classes of magnitudes and places, 2 per octave: finer classes learn too slowly for the 20,000 numbers of a
// typical group.
constexpr int grades = 24;
constexpr int margin = 2;  // places before the first frame and after the last that count as 0
constexpr int sign_sizes = 6;

// Return the class of a number that is not negative: 0, 1, 2, 3, 4, 4, 5, 5, 6, 6, 6, 6, 7, ...
constexpr int grade_of(i64 number) {
    const int shift = most(bit_length(number) - 2, 0);
    return static_cast<int>(least<i64>(2 * shift + (number >> shift), grades - 1));
}
int grade(i64 number) { return looked_up<grade_of>(number); }

int sign_class(i64 number) { return number == 0 ? 0 : number < 0 ? 1 : 2; }

// The context of a number: the models that its decisions mix, and its expected exponent.
struct Expected {
    std::array<BitModel *, 3> inputs;
    int exponent;
};

class TimeModel {
public:
    explicit TimeModel(i64 frames) {
        for (auto &sizes : sizes_) sizes.resize(frames + 2 * margin);
    }

    template <Mode mode, class Number> void code(RangeCoder<mode> &coder, const TimeShape &shape, Number *quantised) {
        const i64 functions = shape.functions, frames = shape.frames, axes = shape.axes;
        for (i64 function = 0; function < functions; ++function) {
            // Magnitudes at each place, of this function and of the two previous ones.
            std::vector<i64> &own = sizes_[function % 3];
            const std::vector<i64> &before = sizes_[(function + 2) % 3], &second = sizes_[(function + 1) % 3];
            std::fill(own.begin(), own.end(), 0);
            for (i64 place = 0; place < frames; ++place) {
                Number *numbers = quantised + (function * frames + place) * axes;
                const i64 last = own[place + 1], second_last = own[place];
                const i64 same = before[place + 2], around = before[place + 1] + before[place + 3];
                const i64 wide = 10 * last + 8 * second_last + 12 * same + 5 * around + 8 * second[place + 2];
                const auto at = [&](i64 functions_back, i64 places_back, i64 axis) -> i64 {
                    if (functions_back > function || places_back > place) return 0;
                    return numbers[axis - (functions_back * frames + places_back) * axes];
                };
                auto &of_place = by_place_[grade(place)];
                i64 here = 0;
                for (i64 axis = 0; axis < axes; ++axis) {
                    const i64 size = axis == 0   ? wide
                                     : axis == 1 ? (3 * wide + 48 * here) >> 2
                                                 : (wide + 8 * here) >> 1;
                    const i64 one = at(0, 1, axis), two = at(0, 2, axis), four = at(0, 4, axis);
                    const i64 earlier = size_of(two) + (size_of(four) >> 1);
                    const i64 of_functions =
                        size_of(at(1, 0, axis)) + size_of(at(2, 0, axis)) + (size_of(at(3, 0, axis)) >> 1);
                    const Expected expected = {
                        {by_size_[grade(size / 24)][axis].data(), of_place[grade(of_functions)].data(),
                         by_last_[grade(size_of(one))][grade(earlier)].data()},
                        least(bit_length(size / 136 + 1) - 1, most_exponent - 1)};
                    const i64 wanted = mode == Mode::decode ? 0 : numbers[axis];
                    const i64 magnitude = code_magnitude(coder, expected, size_of(wanted));
                    const bool is_negative = magnitude > 0 && code_sign(coder, one, two, four, magnitude, wanted < 0);
                    if constexpr (mode == Mode::decode) numbers[axis] = is_negative ? -magnitude : magnitude;
                    here += magnitude;
                }
                own[place + margin] = axes == 3 ? here : 3 * here;
            }
        }
    }

private:
    template <Mode mode> bool decide(RangeCoder<mode> &coder, const Expected &expected, int decision, bool bit) {
        const auto &inputs = expected.inputs;
        return coder.template mixed<3>({inputs[0] + decision, inputs[1] + decision, inputs[2] + decision},
                                       weights_[decision].data(), bit);
    }

    template <Mode mode> i64 code_magnitude(RangeCoder<mode> &coder, const Expected &expected, i64 magnitude) {
        const auto told_apart = [](int exponent) { return least(exponent, exponents - 1); };
        const int wanted = bit_length(magnitude + 1) - 1;
        int exponent = expected.exponent;
        if (decide(coder, expected, rise + told_apart(exponent), wanted > exponent)) {
            do {
                ++exponent;
            } while (exponent < most_exponent &&
                     decide(coder, expected, rise + told_apart(exponent), wanted > exponent));
        } else {
            while (exponent > 0 && !decide(coder, expected, fall + told_apart(exponent - 1), wanted > exponent - 1)) {
                --exponent;
            }
        }
        if (exponent == 0) return 0;
        const auto bit_at = [&](int place) { return static_cast<bool>(((magnitude + 1) >> place) & 1); };
        i64 found = 2 | decide(coder, expected, top_bit + told_apart(exponent), bit_at(exponent - 1));
        for (int place = exponent - 2; place >= 0; --place) found = found << 1 | coder.bypass(bit_at(place));
        return found - 1;
    }

    // Code a sign. Contexts are the numbers one, two and four places before: the cosine transform of a trend
    // alternates.
    template <Mode mode>
    bool code_sign(RangeCoder<mode> &coder, i64 one, i64 two, i64 four, i64 magnitude, bool is_negative) {
        const auto size_class = [](i64 number) { return least(bit_length(number), sign_sizes - 1); };
        const int one_sign = sign_class(one), two_sign = sign_class(two), four_sign = sign_class(four);
        const int one_size = size_class(size_of(one)), two_size = size_class(size_of(two));
        const int size = least(bit_length(magnitude + 1) - 1, sign_sizes - 1);
        return coder.template mixed<2>({&sign_by_three_[one_sign][two_sign][four_sign][two_size >> 1][size >> 1],
                                        &sign_by_first_[one_sign][one_size][two_sign][size]},
                                       sign_weights_.data(), is_negative);
    }

    using Decisions = std::array<BitModel, decisions>;
    template <class T, std::size_t rows, std::size_t columns> using Table = std::array<std::array<T, columns>, rows>;

    Table<Decisions, grades, 3> by_size_;        // by the magnitudes of all neighbours, and the axis
    Table<Decisions, grades, grades> by_place_;  // by the place, and the previous functions
    Table<Decisions, grades, grades> by_last_;   // by the previous places
    std::array<Weights<3>, decisions> weights_;
    Table<std::array<Table<BitModel, 3, 3>, 3>, 3, 3> sign_by_three_;
    Table<Table<BitModel, 3, sign_sizes>, 3, sign_sizes> sign_by_first_;
    Weights<2> sign_weights_;
    std::array<std::vector<i64>, 3> sizes_;
};

// Code all numbers: read when encoding or measuring, written when decoding. Magnitudes are at most 2^40 - 2.
template <Mode mode> void code_time_numbers(RangeCoder<mode> &coder, const TimeShape &shape,
                                            std::conditional_t<mode == Mode::decode, i64, const i64> *quantised) {
    std::make_unique<TimeModel>(shape.frames)->code(coder, shape, quantised);
}

bool are_zero(std::span<const i64> numbers) {
    return std::all_of(numbers.begin(), numbers.end(), [](i64 number) { return number == 0; });
}

}  // namespace

void TimeShape::check() const {
    constexpr i64 most_numbers = i64{1} << 56;
    if (functions < 0 || frames < 0 || (axes != 1 && axes != 3) ||
        (frames > 0 && functions > most_numbers / frames / axes)) {
        throw std::invalid_argument("functions of time must have one axis or three, and not too many numbers");
    }
}

std::vector<u8> encode_time_functions(TimeMethod method, const TimeShape &shape, std::span<const i64> quantised) {
    if (are_zero(quantised)) return {};
    RangeCoder<Mode::encode> coder;
    code_time_numbers(coder, shape, quantised.data());
    std::vector<u8> data = coder.finish();
    data.insert(data.begin(), static_cast<u8>(method));
    return data;
}

double measure_time_functions(const TimeShape &shape, std::span<const i64> quantised) {
    if (are_zero(quantised)) return 0.0;
    RangeCoder<Mode::measure> coder;
    code_time_numbers(coder, shape, quantised.data());
    return 8.0 + coder.bits();
}

std::vector<double> time_function_values(TimeMethod method, const TimeShape &shape, std::span<const i64> quantised,
                                         double step) {
    switch (method) {
        case TimeMethod::predicted: return predicted_values(shape, quantised, step);
        case TimeMethod::transformed: return transformed_values(shape, quantised, step);
        default: return values_along_lines(shape, quantised, step);
    }
}

std::vector<double> decode_time_functions(std::span<const u8> data, const TimeShape &shape, double step) {
    if (data.empty()) return std::vector<double>(shape.numbers());
    if (shape.numbers() == 0) {
        throw CorruptError(Section("TIME"), "has " + std::to_string(data.size()) +
                                                " bytes for no functions of time; get the file again");
    }
    if (data[0] > static_cast<u8>(TimeMethod::straight)) {
        throw CorruptError(Section("TIME"), "codes functions of time by an unknown method, " + std::to_string(data[0]) +
                                                "; get the file again");
    }
    const TimeMethod method{data[0]};
    if (method == TimeMethod::transformed && shape.frames > longest_transform) {
        throw CorruptError(Section("TIME"), "has " + std::to_string(shape.frames) +
                                                " frames in one transform, the most is 1024; get the file again");
    }
    std::vector<i64> quantised(shape.numbers());
    RangeCoder<Mode::decode> coder(data.subspan(1));
    code_time_numbers(coder, shape, quantised.data());
    if (!coder.is_finished()) {
        throw CorruptError(Section("TIME"), "does not end with its functions of time; get the file again");
    }
    return time_function_values(method, shape, quantised, step);
}

}  // namespace pdeanim
