// Entropy coders of the published methods that research/baselines compares with. The .pdeanim format does not use them.
#include <algorithm>
#include <array>
#include <memory>

#include "bindings/python/bindings.hpp"
#include "entropy/range_coder.hpp"

namespace pdeanim::bindings {

namespace {

// Codes integers below 2^62 in magnitude: a flag for zero, the sign, the number of binary digits in unary, then the
// digits after the leading one. As in the published schemes, neighbouring values are not used as context.
class BandModel {
public:
    // Keep the statistics for the next band, with less confidence. (The bands are modes, frequencies or frames, in
    // order of magnitude.)
    void begin_band() {
        zero_.trust(trusted);
        sign_.trust(trusted);
        for (BitModel &model : more_) model.trust(trusted);
        for (auto &digits : digits_) {
            for (BitModel &model : digits) model.trust(trusted);
        }
    }

    template <Mode mode> i64 code(RangeCoder<mode> &coder, i64 value) {
        if (coder.bit(zero_, value == 0)) return 0;
        const bool is_negative = coder.bit(sign_, value < 0);
        const i64 size = size_of(value);
        int digits = 1;
        while (digits < most_digits && coder.bit(more_[digits], size >> digits > 0)) ++digits;
        i64 found = 1;
        for (int place = digits - 2; place >= 0; --place) {
            const i64 within = found < tree_size ? found : tree_size + place;
            found = found << 1 | coder.bit(digits_[digits][within], (size >> place) & 1);
        }
        return is_negative ? -found : found;
    }

private:
    static constexpr u32 trusted =
        24;  // confidence in the statistics at the start of a band, as a number of adaptations
    static constexpr int most_digits = 62;
    static constexpr i64 tree_size =
        4;  // the two digits after the leading one have the earlier digits as context; later digits are nearly random
    BitModel zero_, sign_;
    std::array<BitModel, most_digits> more_;
    std::array<std::array<BitModel, most_digits + tree_size>, most_digits + 1> digits_;
};

template <Mode mode> void code_bands(RangeCoder<mode> &coder, std::span<i64> values, std::size_t numbers) {
    auto model = std::make_unique<BandModel>();
    for (std::size_t i = 0; i < values.size(); ++i) {
        if (i % numbers == 0) model->begin_band();
        values[i] = model->code(coder, values[i]);
    }
}

using Numbers = nb::ndarray<const i64, nb::ndim<2>, nb::c_contig, nb::device::cpu>;

nb::bytes py_encode_bands(const Numbers &values) {
    std::vector<u8> data;
    {
        nb::gil_scoped_release release;
        std::vector<i64> numbers(values.data(), values.data() + values.size());
        RangeCoder<Mode::encode> coder;
        code_bands(coder, numbers, values.shape(1));
        data = coder.finish();
    }
    return to_bytes(data);
}

nb::object py_decode_bands(const nb::bytes &data, std::size_t bands, std::size_t numbers) {
    std::vector<i64> values(bands * numbers);
    {
        nb::gil_scoped_release release;
        RangeCoder<Mode::decode> coder(view(data));
        code_bands(coder, values, numbers);
    }
    return to_array(std::move(values));
}

// Predict the rows of vertices in traversal order: by the mean of the parallelograms at a position, or by the previous
// row if there are none. The first row is not predicted. Predictions are subtracted, or added to restore the values;
// restoring goes from the first row to the last.
void predict(std::span<i64> changed, std::span<const i64> known, std::size_t columns, std::span<const i64> starts,
             const i64 *corners, bool undo) {
    std::vector<i64> mean(columns);
    for (std::size_t i = 1; i < starts.size() - 1; ++i) {
        const i64 count = starts[i + 1] - starts[i];
        for (std::size_t k = 0; k < columns; ++k) mean[k] = count > 0 ? 0 : known[(i - 1) * columns + k];
        for (const i64 *corner = corners + 3 * starts[i]; corner < corners + 3 * starts[i + 1]; corner += 3) {
            const i64 *a = known.data() + corner[0] * columns, *b = known.data() + corner[1] * columns;
            const i64 *c = known.data() + corner[2] * columns;
            for (std::size_t k = 0; k < columns; ++k) mean[k] += a[k] + b[k] - c[k];
        }
        for (std::size_t k = 0; k < columns; ++k) {
            if (count > 0) mean[k] = floor_divide(2 * mean[k] + count, 2 * count);
            changed[i * columns + k] += undo ? mean[k] : -mean[k];
        }
    }
}

nb::object py_parallelograms(const Numbers &values, const Flat<i64> &starts, const Rows<i64, 3> &corners, bool undo) {
    const std::size_t rows = values.shape(0), columns = values.shape(1);
    const std::span<const i64> ends = view(starts), known{values.data(), values.size()};
    const auto is_known = [&](i64 place) { return static_cast<u64>(place) < rows; };
    if (ends.size() != rows + 1 || ends.front() != 0 || ends.back() != static_cast<i64>(corners.shape(0)) ||
        !std::is_sorted(ends.begin(), ends.end()) ||
        !std::all_of(corners.data(), corners.data() + corners.size(), is_known)) {
        throw nb::value_error("parallelograms do not fit the starts");
    }
    std::vector<i64> changed(known.begin(), known.end());
    {
        nb::gil_scoped_release release;
        predict(changed, undo ? changed : known, columns, ends, corners.data(), undo);
    }
    return to_array(std::move(changed));
}

}  // namespace

void bind_baselines(nb::module_ &module) {
    module.def("encode_bands", &py_encode_bands, nb::arg("values"), "Encode (bands, numbers) int64.");
    module.def("decode_bands", &py_decode_bands, nb::arg("data"), nb::arg("bands"), nb::arg("numbers"),
               "Decode the numbers of all bands, one after another, int64.");
    module.def("parallelograms", &py_parallelograms, nb::arg("values"), nb::arg("starts"), nb::arg("corners"),
               nb::arg("undo"),
               "Subtract the predictions of parallelograms from (places, columns) int64, or add them again.");
}

}  // namespace pdeanim::bindings
