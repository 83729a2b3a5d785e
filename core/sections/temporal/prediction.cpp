#include "sections/temporal/time_functions.hpp"

#include <array>
#include <cmath>

namespace pdeanim {

namespace {

// Number of previous frames that predict. With eight, functions of one bit per number would take 3 % fewer bits, those
// of two bits or more just as many.
constexpr int order = 4;
// Factor by which the uncertainty of the weights grows with each number: about 170 frames of three axes are remembered.
constexpr double forgetting = 1.0 + 1.0 / 512.0;
// Smallest variance of a prediction [steps squared]: that of rounding to steps.
constexpr double least_spread = 0.1;
// Largest magnitude of a prediction [steps]: the sum with any number is still exact to 1/4096 of a step.
constexpr double farthest = 0x1p39;
// Predicted variance at which learning starts again: no undamaged file comes near it.
constexpr double most_uncertain = 0x1p120;

using Past = std::array<double, order>;

class Prediction {
public:
    Prediction() { start(); }

    // Start by predicting the last value, ready to learn.
    void start() {
        weights_ = {1.0};
        for (int i = 0; i < order; ++i) {
            for (int j = 0; j < order; ++j) covariance_[i][j] = i == j ? 1.0 : 0.0;
        }
    }

    double predict(const Past &past) const {
        double prediction = 0.0;
        for (int j = 0; j < order; ++j) prediction += weights_[j] * past[j];
        return prediction;
    }

    // Adapt the weights to a prediction error.
    void learn(const Past &past, double miss, double variance) {
        Past gains;
        double uncertainty = 0.0;
        for (int i = 0; i < order; ++i) {
            gains[i] = 0.0;
            for (int j = 0; j < order; ++j) gains[i] += covariance_[i][j] * past[j];
            uncertainty += gains[i] * past[i];
        }
        if (!(0.0 <= uncertainty && uncertainty <= most_uncertain)) {
            start();
        } else if (uncertainty > 0.0) {
            const double divisor = variance + uncertainty;
            for (int i = 0; i < order; ++i) {
                const double share = gains[i] / divisor;
                weights_[i] += share * miss;
                for (int j = 0; j <= i; ++j) {
                    covariance_[i][j] = (covariance_[i][j] - share * gains[j]) * forgetting;
                    covariance_[j][i] = covariance_[i][j];
                }
            }
        }
    }

private:
    Past weights_;
    std::array<Past, order> covariance_;
};

// The numbers of the stream, or the values to quantise.
class GivenNumbers {
public:
    explicit GivenNumbers(const i64 *quantised) : quantised_(quantised) {}
    i64 at(i64 index, double) const { return quantised_[index]; }

private:
    const i64 *quantised_;
};

class WantedValues {
public:
    WantedValues(const double *wanted, double rounding, i64 *quantised)
        : wanted_(wanted), rounding_(rounding), quantised_(quantised) {}

    i64 at(i64 index, double prediction) const {
        const double difference = wanted_[index] - prediction;
        const i64 size = static_cast<i64>(std::fabs(difference) + rounding_);
        return quantised_[index] = difference > 0.0 ? size : -size;
    }

private:
    const double *wanted_;
    double rounding_;
    i64 *quantised_;
};

template <class Numbers> std::vector<double> follow(const TimeShape &shape, const Numbers &numbers, double step) {
    const auto &[functions, frames, axes] = shape;
    std::vector<double> values(shape.numbers());
    Prediction model;
    for (i64 function = 0; function < functions; ++function) {
        std::array<Past, 3> past_of{};  // the last values of each axis [steps], the latest first
        double spread = 1.0;
        for (i64 frame = 0; frame < frames; ++frame) {
            double energy = 0.0;
            for (i64 axis = 0; axis < axes; ++axis) {
                Past &past = past_of[axis];
                double prediction = frame == 0 ? 0.0 : frame == 1 ? past[0] : model.predict(past);
                if (!(std::fabs(prediction) <= farthest)) {
                    prediction = 0.0;
                    model.start();
                }
                const i64 index = (function * frames + frame) * axes + axis;
                const double miss = static_cast<double>(numbers.at(index, prediction));
                const double value = prediction + miss;
                values[(frame * axes + axis) * functions + function] = value * step;
                energy += miss * miss;
                if (frame > 1) model.learn(past, miss, most(spread, least_spread));
                if (frame == 0) {
                    past.fill(value);
                } else {
                    past = {value, past[0], past[1], past[2]};
                }
            }
            spread += (energy / static_cast<double>(axes) - spread) / 8.0;
        }
    }
    return values;
}

}  // namespace

std::vector<double> predicted_values(const TimeShape &shape, std::span<const i64> quantised, double step) {
    return follow(shape, GivenNumbers(quantised.data()), step);
}

QuantisedTimeFunctions quantise_predicted(const TimeShape &shape, std::span<const double> wanted, double rounding,
                                          double step) {
    QuantisedTimeFunctions found;
    found.quantised.resize(wanted.size());
    found.values = follow(shape, WantedValues(wanted.data(), rounding, found.quantised.data()), step);
    return found;
}

}  // namespace pdeanim
