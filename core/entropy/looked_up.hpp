// Classes of numbers, looked up where numbers are small, as most are: to count binary digits takes as long as a decision.
#pragma once

#include <array>

#include "base/arithmetic.hpp"

namespace pdeanim {

template <auto class_of> inline constexpr std::array<u8, 256> small_classes = [] {
    std::array<u8, 256> found{};
    for (std::size_t number = 0; number < found.size(); ++number) {
        found[number] = static_cast<u8>(class_of(static_cast<i64>(number)));
    }
    return found;
}();

// What `class_of`, constexpr, says of a number that is not negative: less than 256.
template <auto class_of> int looked_up(i64 number) {
    const auto &small = small_classes<class_of>;
    return number < static_cast<i64>(small.size()) ? small[number] : class_of(number);
}

}  // namespace pdeanim
