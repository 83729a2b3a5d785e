#include "sections/temporal/time_functions.hpp"

#include <algorithm>
#include <stdexcept>
#include <string>

#include "base/errors.hpp"
#include "sections/temporal/cosines.hpp"
#include "sections/temporal/prediction.hpp"
#include "sections/temporal/straight_lines.hpp"
#include "sections/temporal/time_model.hpp"

namespace pdeanim {

namespace {

bool are_zero(std::span<const i64> numbers) {
    return std::all_of(numbers.begin(), numbers.end(), [](i64 number) { return number == 0; });
}

}  // namespace

void TimeShape::check() const {
    constexpr i64 most_numbers = i64{1} << 56;
    if (functions < 0 || frames < 0 || (axes != 1 && axes != 3) ||
        (frames > 0 && functions > most_numbers / frames / axes)) {
        throw std::invalid_argument("functions of time of one axis or of three, as many as there can be");
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
        throw CorruptError(std::to_string(data.size()) +
                           " bytes of modes stand where there are none; get the file again");
    }
    if (data[0] > static_cast<u8>(TimeMethod::straight)) {
        throw CorruptError("modes are coded by an unknown method, " + std::to_string(data[0]) + "; get the file again");
    }
    const TimeMethod method{data[0]};
    if (method == TimeMethod::transformed && shape.frames > longest_transform) {
        throw CorruptError(std::to_string(shape.frames) +
                           " frames of modes are transformed at once; get the file again");
    }
    std::vector<i64> quantised(shape.numbers());
    RangeCoder<Mode::decode> coder(data.subspan(1));
    code_time_numbers(coder, shape, quantised.data());
    if (!coder.is_finished()) {
        throw CorruptError("section TIME does not end where its modes do; get the file again");
    }
    return time_function_values(method, shape, quantised, step);
}

}  // namespace pdeanim
