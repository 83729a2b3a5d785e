#include "sections/coefficients/coefficients.hpp"

#include <algorithm>
#include <stdexcept>
#include <type_traits>

#include "base/errors.hpp"
#include "sections/coefficients/coefficient_model.hpp"

namespace pdeanim {

namespace {

// Row numbers at which the bands of an element end, affine rows included: the numbers of polynomials in two variables
// up to each degree.
constexpr std::array<i64, CoefficientModel::element_bands> band_ends = {6, 10, 15, 21, 28, 36, 48, 64, i64{1} << 62};

// Number of functions of time in a block if all axes share their coefficients; otherwise a block is one function with
// all its axes.
constexpr i64 ranks_together = 4;

// Return the number of coefficients in a block.
i64 block_size(const CoefficientLayout &layout) { return layout.axes == 1 ? ranks_together : layout.axes; }

// The coefficients to encode, in rows of one number per channel.
class GivenRows {
public:
    GivenRows(const CoefficientLayout &layout, std::span<const i64> coefficients)
        : channels_(layout.channels), coefficients_(coefficients.data()), none_(layout.channels) {}

    std::span<const i64> operator[](i64 row) const {
        return {coefficients_ + row * channels_, static_cast<std::size_t>(channels_)};
    }
    const i64 *add(i64 first, i64, i64) const { return coefficients_ + first * channels_; }
    i64 width(i64) const { return channels_; }

    // Return zeros, for use as a row that does not exist.
    std::span<const i64> none() const { return none_; }

private:
    i64 channels_;
    const i64 *coefficients_;
    std::vector<i64> none_;
};

// Codes the subbands of a group one after another.
template <Mode mode> class CoefficientCoder {
public:
    static constexpr bool decodes = mode == Mode::decode;
    using Number = std::conditional_t<decodes, i64, const i64>;
    using AllRows = std::conditional_t<decodes, CoefficientRows, GivenRows>;

    // The rows must outlive this object.
    CoefficientCoder(const CoefficientLayout &layout, AllRows &rows, RangeCoder<mode> coder = {})
        : coder(std::move(coder)), layout(layout), rows_(rows) {}

    // Code the subbands up to `end` - 1 that have not been coded yet.
    void code(i64 end) {
        for (; next_ < end; ++next_) code_subband(next_);
    }

    // Continue with a subband that was coded before; the models keep what they have learned.
    void go_back(i64 subband) { next_ = subband; }

    RangeCoder<mode> coder;
    const CoefficientLayout layout;

private:
    // Return a known row of a subband, or zeros if it does not exist.
    std::span<const i64> row_of(i64 subband, i64 place) const {
        const std::span<const i64> starts = layout.subbands.starts;
        if (subband < 0 || place < 0 || place >= starts[subband + 1] - starts[subband]) return rows_.none();
        return rows_[starts[subband] + place];
    }

    // Return the start of a block of a known row; zeros if the block is beyond the end of the row.
    const i64 *block_of(std::span<const i64> row, i64 first) const {
        if constexpr (decodes) {
            if (first >= static_cast<i64>(row.size())) return nothing_.data();
        }
        return row.data() + first;
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
            Number *numbers = rows_.add(begin + place, begin + stop, count);
            for (; place < stop; ++place, numbers += rows_.width(count)) {
                const Neighbours around = {row_of(subband, place - 1), row_of(subband, place - 2),
                                           row_of(beside, place), row_of(above, place)};
                code_row(band, place + affine, {numbers, static_cast<std::size_t>(count)}, around);
            }
        }
        beside = subband;
    }

    // Return the number of channels up to the last one that is not zero in any of the rows.
    i64 channels_needed(i64 first, i64 end) const {
        i64 needed = 0;
        if constexpr (!decodes) {
            for (i64 row = first; row < end; ++row) {
                const i64 *numbers = rows_[row].data();
                i64 channel = layout.channels;
                while (channel > needed && numbers[channel - 1] == 0) --channel;
                needed = most(needed, channel);
            }
        }
        return needed;
    }

    // The known rows near a row: one and two rows before, in the previous subband, in the node above.
    struct Neighbours {
        std::span<const i64> one, two, beside, above;
    };

    // The parts of these rows at one block.
    struct BlockNeighbours {
        const i64 *one, *two, *beside, *above;
    };

    // Return the sum of the magnitudes of some coefficients.
    static i64 sizes_of(const i64 *numbers, i64 count) {
        i64 sum = 0;
        for (i64 k = 0; k < count; ++k) sum += size_of(numbers[k]);
        return sum;
    }

    // row: its number within the element or subband.
    void code_row(int band, i64 row, std::span<Number> own, const Neighbours &around) {
        const bool is_shared = layout.axes == 1;
        const i64 size = block_size(layout), count = static_cast<i64>(own.size());
        i64 one = 0, two = 0;  // sums of magnitudes of the previous blocks
        for (i64 first = 0, rank = 0; first < count; first += size, rank += is_shared ? ranks_together : 1) {
            const i64 channels = least(size, count - first);
            const BlockNeighbours near = {block_of(around.one, first), block_of(around.two, first),
                                          block_of(around.beside, first), block_of(around.above, first)};
            const BlocksAround sums = {
                .one_row = sizes_of(near.one, channels),
                .two_rows = sizes_of(near.two, channels),
                .one = one,
                .two = two,
                .beside = sizes_of(near.beside, channels),
                .above = sizes_of(near.above, channels),
            };
            two = one;
            one = decodes ? 0 : sizes_of(own.data() + first, channels);
            if (model_->code_block(coder, band, row, rank, sums, one > 0)) {
                one = code_block(band, rank, own.data(), first, channels, near);
            }
        }
    }

    // Code the coefficients of a block that is not all zero; return the sum of their magnitudes.
    i64 code_block(int band, i64 rank, Number *own, i64 first, i64 channels, const BlockNeighbours &near) {
        const int axes = layout.axes;
        i64 sizes = 0, other_axes = 0;
        for (i64 k = 0; k < channels; ++k) {
            const i64 channel = first + k;
            const CoefficientsAround around = {
                .one_row = size_of(near.one[k]),
                .two_rows = size_of(near.two[k]),
                .one_rank = channel >= axes ? size_of(own[channel - axes]) : 0,
                .two_ranks = channel >= 2 * axes ? size_of(own[channel - 2 * axes]) : 0,
                .beside = size_of(near.beside[k]),
                .other_axes = other_axes,
                .above = size_of(near.above[k]),
            };
            const bool is_last_hope = k + 1 == channels && sizes == 0;
            const i64 found = model_->code_coefficient(coder, band, rank, around, is_last_hope, own[channel]);
            if constexpr (decodes) own[channel] = found;
            sizes += size_of(found);
            if (axes == 1) {
                ++rank;
            } else {
                other_axes += size_of(found);
            }
        }
        return sizes;
    }

    AllRows &rows_;
    const std::array<i64, ranks_together> nothing_{};  // in place of a block beyond the end of a row
    std::unique_ptr<CoefficientModel> model_ = std::make_unique<CoefficientModel>();
    std::array<i64, 2> latest_ = {-1, -1};  // the latest subband of a node, and the latest of an element
    i64 next_ = 0;
};

void check_size(const CoefficientLayout &layout, std::size_t numbers) {
    layout.check();
    if (static_cast<i64>(numbers) != layout.rows * layout.channels) {
        throw std::invalid_argument("there must be as many coefficients as rows times channels");
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
    if (!agree) throw std::invalid_argument("subbands must follow one another, each after the one of the node above");
    if ((axes != 1 && axes != 3) || channels < 0 || channels > CoefficientModel::most_channels || channels % axes) {
        throw std::invalid_argument("channels must be of one axis or three");
    }
}

std::vector<u8> encode_coefficients(const CoefficientLayout &layout, std::span<const i64> coefficients) {
    check_size(layout, coefficients.size());
    if (std::all_of(coefficients.begin(), coefficients.end(), [](i64 number) { return number == 0; })) return {};
    GivenRows rows(layout, coefficients);
    CoefficientCoder<Mode::encode> all(layout, rows);
    all.code(layout.subbands.count());
    return all.coder.finish();
}

double measure_coefficients(const CoefficientLayout &layout, std::span<const i64> coefficients,
                            std::span<const double> copies) {
    check_size(layout, coefficients.size());
    if (!copies.empty() && static_cast<i64>(copies.size()) != layout.subbands.count()) {
        throw std::invalid_argument("there must be as many copies as subbands");
    }
    GivenRows rows(layout, coefficients);
    CoefficientCoder<Mode::measure> all(layout, rows);
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

CoefficientDecoder::CoefficientDecoder(const CoefficientLayout &layout, std::span<const u8> data, TakenMemory taken)
    : rows_(layout.rows, block_size(layout), std::move(taken)) {
    layout.check();
    if (!data.empty()) state_ = std::make_unique<State>(layout, rows_, RangeCoder<Mode::decode>(data));
}

CoefficientDecoder::~CoefficientDecoder() = default;

void CoefficientDecoder::decode(i64 end) {
    if (state_) state_->code(least(end, state_->layout.subbands.count()));
}

void CoefficientDecoder::finish() const {
    if (state_ && !state_->coder.is_finished()) {
        throw CorruptError(Section("COEF"), "does not end with its coefficients; get the file again");
    }
}

}  // namespace pdeanim
