// The closed form in time: the functions of Eq. 12 of Fang et al. 2024 over a group of frames, at any time.
//
// Inside a group the functions are evaluated directly. Between the last frame of one group and the first of the next,
// positions follow the cubic that matches both in value and first derivative (Hermite). So position and velocity are
// continuous everywhere.
#pragma once

#include <array>
#include <span>
#include <vector>

#include "base/arithmetic.hpp"

namespace pdeanim {

// The functions of Eq. 12 over the frames of one group, made orthonormal at the frames from their well-conditioned
// form.
class ClosedForm {
public:
    static constexpr int most_functions = 4;

    using Weights = std::array<double, most_functions>;

    // times: times of the frames [s]; alpha: rate of Eq. 12 over half the length of the group; functions: their number,
    // at most 4 and at most the number of frames.
    ClosedForm(std::span<const double> times, double alpha, i64 functions);

    // Return the functions at a time, or their first or second derivative [1 / s^derivative].
    Weights weights(double time, int derivative = 0) const;

    double first() const { return times_.front(); }
    double last() const { return times_.back(); }

private:
    Weights series(double time, int derivative) const;

    std::span<const double> times_;
    double alpha_, centre_, half_length_;
    int functions_;
    std::array<Weights, most_functions> triangle_{};  // upper triangular matrix R with series = functions R
};

// The weights of one group's functions at a time.
struct GroupWeights {
    std::size_t group = 0;
    ClosedForm::Weights weights{};
};

// Return the weights at a time between the first and the last frame of consecutive groups: of one group if the time is
// inside it, of two groups if it is between them.
std::vector<GroupWeights> closed_form_weights(std::span<const ClosedForm> groups, double time, int derivative);

}  // namespace pdeanim
