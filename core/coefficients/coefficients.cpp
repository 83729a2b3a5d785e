#include "coefficients/coefficients.hpp"

#include <algorithm>
#include <stdexcept>
#include <type_traits>

#include "coefficients/coefficient_model.hpp"
#include "errors.hpp"

namespace pdeanim {

namespace {

// Rows of an element, affine ones included, at which its bands end: the numbers of polynomials of two variables.
constexpr std::array<i64, CoefficientModel::element_bands> band_ends = {6, 10, 15, 21, 28, 36, 48, 64, i64{1} << 62};

// Functions of time that make a block where all axes share their coefficients; else one function does, with its axes.
constexpr i64 ranks_together = 4;

// Codes the subbands of a group one after another.
template <Mode mode> class CoefficientCoder {
public:
    using Number = std::conditional_t<mode == Mode::decode, i64, const i64>;

    CoefficientCoder(const CoefficientLayout &layout, std::span<Number> coefficients, RangeCoder<mode> coder = {},
                     std::span<i32> used = {})
        : coder(std::move(coder)), layout(layout), coefficients_(coefficients.data()), used_(used) {}

    // Those up to `end` - 1 that have not been coded yet.
    void code(i64 end) {
        for (; next_ < end; ++next_) code_subband(next_);
    }

    // Go on with a subband that has been coded before, with models that have learned.
    void go_back(i64 subband) { next_ = subband; }

    RangeCoder<mode> coder;
    const CoefficientLayout layout;

private:
    Number *row_at(i64 row) const { return coefficients_ + row * layout.channels; }

    // A place of a subband that is known, or zeros.
    const i64 *row_of(i64 subband, i64 place) const {
        const std::span<const i64> starts = layout.subbands.starts;
        if (subband < 0 || place >= starts[subband + 1] - starts[subband]) return nothing_.data();
        return row_at(starts[subband] + place);
    }

    void code_subband(i64 subband) {
        const Subbands &subbands = layout.subbands;
        const i64 begin = subbands.starts[subband], size = subbands.starts[subband + 1] - begin;
        const bool is_element = subbands.kinds[subband] < 0;
        const i64 affine = is_element ? -1 - subbands.kinds[subband] : 0;
        const i64 above = subband > 0 ? subbands.parents[subband] : -1;
        i64 &beside = latest_[is_element];
        int band = is_element ? CoefficientModel::depths
                              : static_cast<int>(least<i64>(subbands.kinds[subband], CoefficientModel::depths - 1));
        i64 count = layout.channels;
        for (i64 place = 0; place < size;) {
            i64 stop = size;
            if (is_element) {
                while (place + affine >= band_ends[band - CoefficientModel::depths]) ++band;
                stop = least(size, band_ends[band - CoefficientModel::depths] - affine);
            }
            const i64 needed = channels_needed(begin + place, begin + stop);
            count = model_->code_count(coder, band, count, layout.channels, needed);
            if (!used_.empty()) std::fill_n(used_.begin() + begin + place, stop - place, static_cast<i32>(count));
            for (; place < stop; ++place) {
                code_row(band, place + affine, count, row_at(begin + place), place, row_of(beside, place),
                         row_of(above, place));
            }
        }
        beside = subband;
    }

    // Channels up to the last that is not zero in some rows.
    i64 channels_needed(i64 first, i64 end) const {
        i64 needed = 0;
        if constexpr (mode != Mode::decode) {
            for (i64 row = first; row < end; ++row) {
                const i64 *numbers = row_at(row);
                i64 channel = layout.channels;
                while (channel > needed && numbers[channel - 1] == 0) --channel;
                needed = most(needed, channel);
            }
        }
        return needed;
    }

    // Sizes of some coefficients of a row, added up.
    static i64 sizes_of(const i64 *row, i64 first, i64 end) {
        i64 sum = 0;
        for (i64 channel = first; channel < end; ++channel) sum += size_of(row[channel]);
        return sum;
    }

    // `row`: its number in the element or subband; `place`: among those that are coded.
    void code_row(int band, i64 row, i64 count, Number *numbers, i64 place, const i64 *beside, const i64 *above) {
        const i64 *const nothing = nothing_.data();
        const Rows rows = {
            numbers,
            place > 0 ? numbers - layout.channels : nothing,
            place > 1 ? numbers - 2 * layout.channels : nothing,
            beside,
            above,
        };
        const bool is_shared = layout.axes == 1;
        const i64 block = is_shared ? ranks_together : layout.axes;
        i64 one = 0, two = 0;  // sizes of the blocks before
        for (i64 first = 0, rank = 0; first < count; first += block, rank += is_shared ? ranks_together : 1) {
            const i64 end = least(first + block, count);
            const BlocksAround around = {
                .one_row = sizes_of(rows.one, first, end),
                .two_rows = sizes_of(rows.two, first, end),
                .one = one,
                .two = two,
                .beside = sizes_of(rows.beside, first, end),
                .above = sizes_of(rows.above, first, end),
            };
            two = one;
            one = mode == Mode::decode ? 0 : sizes_of(numbers, first, end);
            if (model_->code_block(coder, band, row, rank, around, one > 0)) {
                one = code_block(band, rows, rank, first, end);
            }
        }
    }

    struct Rows {
        Number *own;
        const i64 *one, *two, *beside, *above;
    };

    // Code a block of which not all are zero; sizes added up.
    i64 code_block(int band, const Rows &rows, i64 rank, i64 first, i64 end) {
        const int axes = layout.axes;
        i64 sizes = 0, other_axes = 0;
        for (i64 channel = first; channel < end; ++channel) {
            const CoefficientsAround around = {
                .one_row = size_of(rows.one[channel]),
                .two_rows = size_of(rows.two[channel]),
                .one_rank = channel >= axes ? size_of(rows.own[channel - axes]) : 0,
                .two_ranks = channel >= 2 * axes ? size_of(rows.own[channel - 2 * axes]) : 0,
                .beside = size_of(rows.beside[channel]),
                .other_axes = other_axes,
                .above = size_of(rows.above[channel]),
            };
            // What is decoded is not read before: a page of zeros that is read first is replaced when it is written.
            const i64 given = mode == Mode::decode ? 0 : rows.own[channel];
            const bool is_last_hope = channel + 1 == end && sizes == 0;
            const i64 found = model_->code_coefficient(coder, band, rank, around, is_last_hope, given);
            if constexpr (mode == Mode::decode) rows.own[channel] = found;
            sizes += size_of(found);
            if (axes == 1) {
                ++rank;
            } else {
                other_axes += size_of(found);
            }
        }
        return sizes;
    }

    Number *coefficients_;
    std::span<i32> used_;
    std::vector<i64> nothing_ = std::vector<i64>(layout.channels);  // the row that is not there
    std::unique_ptr<CoefficientModel> model_ = std::make_unique<CoefficientModel>();
    std::array<i64, 2> latest_ = {-1, -1};  // latest subband of a node, and that of an element
    i64 next_ = 0;
};

void check_size(const CoefficientLayout &layout, std::size_t numbers) {
    layout.check();
    if (static_cast<i64>(numbers) != layout.rows * layout.channels) {
        throw std::invalid_argument("as many coefficients as rows times channels");
    }
}

}  // namespace

void CoefficientLayout::check() const {
    const auto &[starts, kinds, parents] = subbands;
    bool agree = starts.size() == kinds.size() + 1 && parents.size() == kinds.size() && starts.front() == 0 &&
                 starts.back() == rows && std::is_sorted(starts.begin(), starts.end());
    for (i64 subband = 1; agree && subband < subbands.count(); ++subband) {
        agree = parents[subband] >= 0 && parents[subband] < subband;
    }
    if (!agree) throw std::invalid_argument("subbands that follow each other, each after that of the node above");
    if ((axes != 1 && axes != 3) || channels < 0 || channels > CoefficientModel::most_channels || channels % axes) {
        throw std::invalid_argument("channels of one axis or of three");
    }
}

std::vector<u8> encode_coefficients(const CoefficientLayout &layout, std::span<const i64> coefficients) {
    check_size(layout, coefficients.size());
    if (std::all_of(coefficients.begin(), coefficients.end(), [](i64 number) { return number == 0; })) return {};
    CoefficientCoder<Mode::encode> all(layout, coefficients);
    all.code(layout.subbands.count());
    return all.coder.finish();
}

double measure_coefficients(const CoefficientLayout &layout, std::span<const i64> coefficients,
                            std::span<const double> copies) {
    check_size(layout, coefficients.size());
    if (!copies.empty() && static_cast<i64>(copies.size()) != layout.subbands.count()) {
        throw std::invalid_argument("as many copies as subbands");
    }
    CoefficientCoder<Mode::measure> all(layout, coefficients);
    all.code(layout.subbands.count());
    for (std::size_t subband = 0; subband < copies.size(); ++subband) {
        if (copies[subband] <= 1.0) continue;
        all.go_back(static_cast<i64>(subband));
        all.coder.count_more(copies[subband] - 1.0, [&] { all.code(static_cast<i64>(subband) + 1); });
    }
    return all.coder.bits();
}

class CoefficientDecoder::State : public CoefficientCoder<Mode::decode> {
    using CoefficientCoder::CoefficientCoder;
};

CoefficientDecoder::CoefficientDecoder(const CoefficientLayout &layout, std::span<const u8> data,
                                       std::span<i64> coefficients, std::span<i32> used) {
    check_size(layout, coefficients.size());
    if (!data.empty()) state_ = std::make_unique<State>(layout, coefficients, RangeCoder<Mode::decode>(data), used);
}

CoefficientDecoder::~CoefficientDecoder() = default;

void CoefficientDecoder::decode(i64 end) {
    if (state_) state_->code(least(end, state_->layout.subbands.count()));
}

void CoefficientDecoder::finish() const {
    if (state_ && !state_->coder.is_finished()) {
        throw CorruptError("section COEF does not end where its levels do; get the file again");
    }
}

}  // namespace pdeanim
