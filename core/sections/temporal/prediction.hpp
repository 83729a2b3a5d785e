// Functions of time that are predicted: each number from those of the four frames before it, by weights that learn.
//
// Recursive least squares with forgetting (Haykin, "Adaptive filter theory", chapter 10), the error of each number
// weighed by the variance of the numbers of late, so that functions of every size teach the same weights. Values
// predict others: +, -, * and / of float64 in the order written, so that every IEEE 754 machine gets the same bits.
#pragma once

#include <span>
#include <vector>

#include "sections/temporal/time_functions.hpp"

namespace pdeanim {

// From differences to the prediction in steps.
std::vector<double> predicted_values(const TimeShape &shape, std::span<const i64> quantised, double step);

struct QuantisedTimeFunctions {
    std::vector<i64> quantised;
    std::vector<double> values;  // what a decoder gets
};

// Of what is wanted, in steps, function after function; `rounding` is added to a magnitude before its fraction is
// dropped, 0.5 is plain rounding.
QuantisedTimeFunctions quantise_predicted(const TimeShape &shape, std::span<const double> wanted, double rounding,
                                          double step);

}  // namespace pdeanim
