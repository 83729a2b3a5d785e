// Texts and other bytes.
//
// Each bit of a byte is predicted from the byte before, the last two, the last three, and from what followed the last time
// when the same four bytes had gone before. A model of texts has read a few words that are in most files.
#pragma once

#include <functional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "entropy/range_coder.hpp"

namespace pdeanim {

// Called with a number of bytes before memory for them is taken; throws where there is none.
using TakeMemory = std::function<void(i64)>;

class TextModel {
public:
    // A model that has learnt nothing, or the words.
    explicit TextModel(bool has_read_words);

    // Code all of these bytes, read when encoding and written when decoding.
    template <Mode mode> void code_bytes(RangeCoder<mode> &coder, std::span<u8> values);

    // Code a text; when decoding, CorruptError where it is not UTF-8.
    template <Mode mode> std::string code_text(RangeCoder<mode> &coder, std::string_view text, const TakeMemory &take);

private:
    template <Mode mode> u8 code(RangeCoder<mode> &coder, u8 byte);

    static constexpr u8 end = 255;     // byte after the last one of a text: UTF-8 has none such
    static constexpr i64 piece = 256;  // bytes of a text that are decoded before memory for more is taken
    static constexpr int place_bits = 12, slot_bits = 16;
    static constexpr i64 past_size = 1 << 16;
    static constexpr int longest_run = 15, decisions = 5;

    std::vector<BitModel> one_, two_, three_;  // by the bytes before, the digits found, and hashes of both
    std::array<std::array<BitModel, 2>, longest_run + 1> match_;  // by the run of matches and the digit proposed
    BitModel no_match_;
    std::array<Weights<4>, decisions> weights_;
    i64 count_ = 0, place_ = -1, run_ = 0;  // bytes so far; where the match goes on, or -1; how long it has held
    u32 last_ = 0;                          // the last four bytes
    std::vector<i64> places_;               // place in the past, plus 1, of what came after four bytes, by their hash
    std::vector<u8> past_;
};

}  // namespace pdeanim
