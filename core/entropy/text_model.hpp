// Models of texts and other bytes.
//
// Each bit of a byte is predicted from the last byte, the last two, the last three, and from the byte that followed the
// same four bytes before. A model of texts is first trained on a few words that most files contain.
#pragma once

#include <functional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "entropy/range_coder.hpp"

namespace pdeanim {

// Called with a number of bytes before they are allocated; throws if the memory limit does not allow them.
using TakeMemory = std::function<void(i64)>;

class TextModel {
public:
    // Start with a model that has learned nothing, or with one that has been trained on the words.
    explicit TextModel(bool has_read_words);

    // Code bytes: `values` are read when encoding, written when decoding.
    template <Mode mode> void code_bytes(RangeCoder<mode> &coder, std::span<u8> values);

    // Code a text; when decoding, CorruptError if it is not UTF-8.
    template <Mode mode> std::string code_text(RangeCoder<mode> &coder, std::string_view text, const TakeMemory &take);

private:
    template <Mode mode> u8 code(RangeCoder<mode> &coder, u8 byte);

    static constexpr u8 end = 255;     // byte after the end of a text, which UTF-8 never contains
    static constexpr i64 piece = 256;  // bytes of a text that are decoded before more memory is taken
    static constexpr int place_bits = 12, slot_bits = 16;
    static constexpr i64 past_size = 1 << 16;
    static constexpr int longest_run = 15, decisions = 5;

    // Contexts: the last one, two or three bytes, each with the digits of the current byte so far.
    std::vector<BitModel> one_, two_, three_;
    // Contexts: how long the match has held, and the digit that it predicts.
    std::array<std::array<BitModel, 2>, longest_run + 1> match_;
    BitModel no_match_;
    std::array<Weights<4>, decisions> weights_;
    i64 count_ = 0, place_ = -1, run_ = 0;  // bytes so far; where the match continues, or -1; how long it has held
    u32 last_ = 0;                          // the last four bytes
    std::vector<i64> places_;  // for each hash of four bytes, 1 + the position of the byte that followed them last
    std::vector<u8> past_;
};

// Return whether bytes are standard UTF-8: the shortest form of each character, and no surrogates.
bool is_utf8(std::string_view text);

}  // namespace pdeanim
