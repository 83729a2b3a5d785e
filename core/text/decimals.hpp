// Decimal text to float32 and back, as text formats need it.
//
// Reading gives float32(float64(text)) to the last bit. Where double arithmetic cannot prove which float32 that is, or
// the token is not plain decimal, the reader says so, and the caller reads the token in full. Writing gives decimal
// digits that read back to the same float32: as few as that takes. Both go without std::from_chars and std::to_chars,
// which not every standard library has for floating point, so that texts are the same everywhere.
#pragma once

#include <optional>
#include <span>
#include <string_view>
#include <vector>

#include "base/arithmetic.hpp"

namespace pdeanim::text {

// Whether a byte separates tokens within a line.
constexpr bool is_blank(u8 byte) { return byte == ' ' || (byte >= '\t' && byte <= '\r' && byte != '\n'); }

struct ReadNumber {
    float value;
    bool is_certain;  // whether `value` is the token's
    const u8 *end;    // where reading stopped; not beyond the token
};

// The number whose token starts here. A blank or a line feed follows the token.
ReadNumber read_number(const u8 *at);

// Lines of `word number number ...`, `columns` numbers each, all of them finite; nothing where nine digits cannot be
// shown to be enough for one, which is then a subnormal.
std::optional<std::vector<u8>> write_rows(std::span<const float> numbers, std::size_t columns, std::string_view word);

}  // namespace pdeanim::text
