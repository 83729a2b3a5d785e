// What the report's baselines are coded with. No file of ours holds any of it, so that it is a part of the bindings only.
#include <array>

#include "bindings/bindings.hpp"
#include "entropy/range_coder.hpp"

namespace pdeanim::bindings {

namespace {

// Numbers below 2^62 in magnitude: zero or not, sign, binary digits one by one, then the digits below the leading one. No
// neighbours are looked at: that is what the published schemes do.
class BandModel {
public:
    // What was learned is carried to the next band but trusted less: bands (modes, frequencies, frames) follow one
    // another by size.
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
    static constexpr u32 trusted = 24;     // adaptations that count at the start of a band
    static constexpr int most_digits = 62;
    static constexpr i64 tree_size = 4;    // two digits are coded given those before them; the rest are close to even
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

// Means of parallelograms subtracted from all places, or, to undo that, added to them, first place to last. Without a
// parallelogram it is the place before; the first place has nothing to go by.
nb::object py_parallelograms(const Numbers &values, const Flat<i64> &starts, const Rows<i64, 3> &corners, bool undo) {
    const std::size_t rows = values.shape(0), columns = values.shape(1);
    if (starts.size() != rows + 1 || (rows > 0 && static_cast<u64>(starts.data()[rows]) > corners.shape(0))) {
        throw nb::value_error("there are not as many parallelograms as the places have");
    }
    std::vector<i64> found(values.data(), values.data() + values.size());
    {
        nb::gil_scoped_release release;
        const i64 *known = undo ? found.data() : values.data();
        const i64 *corner = corners.data();
        std::vector<i64> total(columns);
        for (std::size_t i = 1; i < rows; ++i) {
            const i64 count = starts.data()[i + 1] - starts.data()[i];
        }
    }
    return to_rows(std::move(found), columns);
}

}  // namespace

}  // namespace pdeanim::bindings
