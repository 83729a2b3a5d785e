// Numbers in another precision, or as they are.
#pragma once

#include <algorithm>
#include <type_traits>
#include <vector>

#include "base/arithmetic.hpp"

namespace pdeanim {

template <class Real> class InPrecision {
public:
    // Valid until others are asked for.
    template <class Given> const Real *of(const Given *given, i64 count) {
        if constexpr (std::is_same_v<Given, Real>) {
            return given;
        } else {
            kept_.resize(count);
            std::transform(given, given + count, kept_.begin(), [](Given number) { return static_cast<Real>(number); });
            return kept_.data();
        }
    }

private:
    std::vector<Real> kept_;
};

}  // namespace pdeanim
