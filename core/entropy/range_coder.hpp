// The adaptive binary range coder: integers only, so that any language can follow it bit by bit.
//
// Every model is written once, as a template over the coder's mode: it encodes, it decodes, or it adds up the cost of
// encoding. `bit` takes a bit and returns it; when decoding, it ignores its argument and returns the bit that it
// decodes. A mixed bit combines several predictions in the logistic domain, with weights that learn too (Mahoney 2005,
// "Adaptive weighing of context models for lossless data compression").
//
// This folder has the coding tools that all sections share (3 of the specification). Begin here. Then: numbers.hpp has
// models of whole numbers and lists, text_model models of texts and other bytes, tables the tables of probabilities.
#pragma once

#include <array>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "base/arithmetic.hpp"
#include "base/errors.hpp"

// Tables (tables.cpp): integers that the specification defines, the same on every machine.
//
// Without the attribute `hidden`, every access would go through a table of addresses: -fvisibility does not apply to
// `extern`.
#if defined(__GNUC__)
#pragma GCC visibility push(hidden)
#endif

namespace pdeanim::tables {

inline constexpr int logistic_limit = 2047;  // largest magnitude of log odds [1/256]
inline constexpr int rarest = 32;            // smallest probability of either bit [1/65536]

// Maps the logistic domain, from -logistic_limit on, to a probability [1/65536], which is at least the smallest.
extern const std::array<u16, 2 * logistic_limit + 1> squash;

// Maps a probability [1/4096] to the logistic domain [1/256].
extern const std::array<i16, 4096> stretch;

// Maps the probability [1/4096] of a bit to its cost [1/65536 of a bit].
extern const std::array<i32, 4096> costs;

}  // namespace pdeanim::tables

#if defined(__GNUC__)
#pragma GCC visibility pop
#endif

namespace pdeanim {

enum class Mode { encode, decode, measure };

#if defined(PDEANIM_NOTE_BITS)
// Called with each decoded bit in the build that core/tests/exactness.cpp uses to compare builds.
void note_bit(i32 probability, bool bit);
#endif

// An adaptive bit model. Its state has 22 bits for the probability of a 1, above 10 bits that count adaptations, so
// that it learns fast at first and more slowly later.
class BitModel {
public:
    static constexpr int probability_bits = 22, count_bits = 10;
    static constexpr u32 slowest = 255;  // adaptations after which the rate stays: about as many bits are remembered

    // Return the probability of a 1 [1/65536].
    constexpr i32 probability() const { return static_cast<i32>(state_ >> (count_bits + probability_bits - 16)); }

    // Return the prediction of the next bit in the logistic domain [1/256].
    i32 opinion() const { return tables::stretch[state_ >> (count_bits + probability_bits - 12)]; }

    constexpr void adapt(bool bit) {
        const u32 count = state_ & ((1u << count_bits) - 1);
        const i64 before = state_ >> count_bits;
        const i64 target = bit ? (1 << probability_bits) - 1 : 0;
        // The change of the probability, masked so that it does not touch the count in the low bits.
        const i64 change = (((target - before) * rates[count]) >> (16 - count_bits)) & -(i64{1} << count_bits);
        state_ += static_cast<u32>(change) + (count < slowest);
    }

    // Limit the count of adaptations, so that the model learns faster again.
    constexpr void trust(u32 adaptations) {
        const u32 count = state_ & ((1u << count_bits) - 1);
        if (count > adaptations) state_ -= count - adaptations;
    }

private:
    // 1 / (n + 1.5) in 1/65536 after n adaptations, as a table: a division would take as long as everything else.
    static constexpr std::array<i64, slowest + 1> rates = [] {
        std::array<i64, slowest + 1> found{};
        for (u32 count = 0; count <= slowest; ++count) found[count] = 131072 / (2 * count + 3);
        return found;
    }();

    u32 state_ = 1u << (probability_bits - 1 + count_bits);
};

// Weights of the predictions of a mixed bit, in 1/65536. They start equal, with a sum above one, because predictions
// that agree are more certain together than each alone.
template <std::size_t inputs> struct Weights : std::array<i32, inputs> {
    constexpr Weights() { this->fill(static_cast<i32>(6 * 65536 / (5 * inputs))); }
};

template <Mode mode> class RangeCoder {
public:
    static constexpr int first_bytes = 8;  // bytes of the stream that a decoder has ahead
    static constexpr int cost_bits = 16;

    RangeCoder()
        requires(mode != Mode::decode)
    = default;

    // Decode bytes, which must outlive the coder, as if zeros followed them.
    explicit RangeCoder(std::span<const u8> data)
        requires(mode == Mode::decode)
        : data_(data) {
        refill();
        refill();
    }

    // Code a bit whose probability of being 1 is `probability` / 65536. The probability is at least the smallest one,
    // and at most 1 minus the smallest one.
    bool with(i32 probability, bool bit) {
        if constexpr (mode == Mode::measure) {
            cost_ += tables::costs[(bit ? probability : 65536 - probability) >> 4];
            return bit;
        } else {
            const u64 split = (range_ >> 16) * static_cast<u64>(probability);
            if constexpr (mode == Mode::encode) {
                if (!bit) {
                    low_ += split;
                    if (low_ < split) carry();
                }
            } else {
                bit = code_ < split;
                if (!bit) code_ -= split;
#if defined(PDEANIM_NOTE_BITS)
                note_bit(probability, bit);
#endif
            }
            range_ = bit ? split : range_ - split;
            widen();
            return bit;
        }
    }

    // Code a bypass bit: both values are equally likely.
    bool bypass(bool bit) {
        constexpr i32 even = 1 << 15;
        if constexpr (mode != Mode::decode) {
            return with(even, bit);
        } else {
            // Computed without a branch, because no processor could predict the bit.
            const u64 split = (range_ >> 16) * even;
            const u64 where_zero = code_ < split ? 0 : ~u64{0};
            code_ -= split & where_zero;
            range_ = split + ((range_ - 2 * split) & where_zero);
            widen();
            bit = where_zero == 0;
#if defined(PDEANIM_NOTE_BITS)
            note_bit(even, bit);
#endif
            return bit;
        }
    }

    // Code a bit with an adaptive bit model, and let the model learn.
    bool bit(BitModel &model, bool bit) {
        bit = with(clamp(model.probability(), tables::rarest, 65536 - tables::rarest), bit);
        model.adapt(bit);
        return bit;
    }

    static constexpr int learning_shift = 14;  // learning rate of the weights, as a power of two

    // Code a bit with the mixed predictions of several distinct models, and let the models and weights learn.
    template <std::size_t inputs>
    bool mixed(const std::array<BitModel *, inputs> &chosen, i32 *weights, bool bit, int shift = learning_shift) {
        std::array<i32, inputs> opinions;
        i64 total = 0;
        for (std::size_t i = 0; i < inputs; ++i) {
            opinions[i] = chosen[i]->opinion();
            total += static_cast<i64>(weights[i]) * opinions[i];
        }
        total = clamp<i64>(total >> 16, -tables::logistic_limit, tables::logistic_limit);
        const i32 probability = tables::squash[total + tables::logistic_limit];
        const auto learn = [&](bool found) {
            const i32 miss = (found ? 65536 : 0) - probability;
            for (std::size_t i = 0; i < inputs; ++i) {
                weights[i] += (opinions[i] * miss + (1 << (shift - 1))) >> shift;
                chosen[i]->adapt(found);
            }
            return found;
        };
        // A branch, because processors predict the bit and continue before they have it.
        return with(probability, bit) ? learn(true) : learn(false);
    }

    // Finish encoding: return the shortest bytes that lie in the interval if zeros follow them.
    std::vector<u8> finish()
        requires(mode == Mode::encode)
    {
        // Find the first number from `low_` on that ends in as many zero bytes as the interval allows.
        int kept = 0;
        const auto beyond_low = [&] { return (0 - low_) & (kept == 0 ? ~u64{0} : ~u64{0} >> 8 * kept); };
        while (kept < first_bytes && beyond_low() >= range_) ++kept;
        u64 value = kept == first_bytes ? low_ : low_ + beyond_low();
        if (value < low_) carry();
        for (; kept > 0; --kept) {
            written_.push_back(static_cast<u8>(value >> 56));
            value <<= 8;
        }
        return std::move(written_);
    }

    // Return whether a decoder has reached the end of its bytes and needed all of them.
    //
    // An encoder writes four bytes each time the interval is widened. `finish` then writes only as many bytes, up to
    // eight, as it takes to be in the interval. This function returns true for no other bytes.
    bool is_finished() const
        requires(mode == Mode::decode)
    {
        const std::size_t size = data_.size();
        if (position_ < size || position_ - size >= first_bytes) return position_ == size + first_bytes;
        // The final number must be the first one in the interval with that many trailing zeros, and no number in the
        // interval has more.
        const int zeros = 8 * static_cast<int>(position_ - size);
        const u64 last = static_cast<u64>(data_[size - 1]) << zeros;
        return code_ >> zeros == 0 && ((code_ - last) & ~u64{0} >> (56 - zeros)) >= range_;
    }

    // Return the position up to which the decoder has used the bytes; if it finds damage, this is where.
    std::size_t byte() const
        requires(mode == Mode::decode)
    {
        return least(position_, data_.size());
    }

    // Raise CorruptError if a decoder of a section has bytes left, or needed more.
    void check_finished(std::string_view section) const
        requires(mode == Mode::decode)
    {
        if (is_finished()) return;
        const std::size_t left = data_.size() - byte();
        throw CorruptError(Section(section),
                           left > 0 ? "has " + std::to_string(left) + " bytes too many" : "ends too early");
    }

    // Return the number of bytes taken beyond the end; at most eight in an undamaged stream.
    std::size_t beyond() const
        requires(mode == Mode::decode)
    {
        return position_ > data_.size() ? position_ - data_.size() : 0;
    }

    // Raise CorruptError if decoding continues long after the end of the bytes.
    void check_not_ended() const {
        if constexpr (mode == Mode::decode) {
            if (beyond() > first_bytes) throw CorruptError("ends too early");
        }
    }

    // Count the cost of some work several times.
    template <class Work> void count_more(double times, const Work &work)
        requires(mode == Mode::measure)
    {
        const i64 before = cost_;
        work();
        cost_ = before + static_cast<i64>(times * static_cast<double>(cost_ - before));
    }

    // Return the cost of the encoding so far [bits].
    double bits() const
        requires(mode == Mode::measure)
    {
        return static_cast<double>(cost_) / (1 << cost_bits);
    }

private:
    // A narrow interval is widened by whole words, so rarely that processors predict the branch.
    static constexpr int word_bytes = 4, word_bits = 8 * word_bytes;

    void widen() {
        if (range_ >> word_bits != 0) return;
        if constexpr (mode == Mode::encode) {
            for (int i = 0; i < word_bytes; ++i) {
                written_.push_back(static_cast<u8>(low_ >> 56));
                low_ <<= 8;
            }
        } else {
            refill();
        }
        range_ <<= word_bits;
    }

    // Read the next word, most significant byte first; zeros follow the last byte.
    void refill() {
        u32 word = 0;
        if (position_ + word_bytes <= data_.size()) {
            for (int i = 0; i < word_bytes; ++i) word = word << 8 | data_[position_ + i];
        } else {
            for (std::size_t at = position_; at < position_ + word_bytes; ++at) {
                word = word << 8 | (at < data_.size() ? data_[at] : 0);
            }
        }
        position_ += word_bytes;
        code_ = code_ << word_bits | word;
    }

    // Add one to the number that the bytes written so far form.
    void carry() {
        for (std::size_t at = written_.size(); at-- > 0;) {
            if (++written_[at] != 0) return;
        }
    }

    u64 low_ = 0, range_ = ~u64{0}, code_ = 0;
    std::span<const u8> data_;
    std::size_t position_ = 0;
    std::vector<u8> written_;
    i64 cost_ = 0;
};

}  // namespace pdeanim
