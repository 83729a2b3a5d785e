// Choice of the weights by which terms correct the prediction of the reference frame (encoder only, floating point).
#pragma once

#include "sections/reference/predictor.hpp"

namespace pdeanim {

// Weights that make residuals cost the fewest bits, kind by kind. The predictor has all grid coordinates and has learnt
// nothing; it is changed.
TermWeights choose_term_weights(const std::vector<i32> &order, Predictor &points);

}  // namespace pdeanim
