#include "xpbd/sheets.hpp"

#include <algorithm>

namespace pdeanim::xpbd {

namespace {

// Eq. 4, from the velocities that the last substep leaves: x^n - x^(n-1) over its length.
PDEANIM_MULTIVERSION void predict_again(Place *positions, Place *previous, const Point *accelerations,
                                        std::size_t count, double substep, double keep) {
    for (std::size_t i = 0; i < count; ++i) {
        const double inverse_mass = previous[i].at[3];
        Register present = lanes_at<4>(positions[i].at);
        present[3] = 0.0;
        const Register velocity = (present - lanes_at<4>(previous[i].at)) / substep;
        Register acceleration{};
        for (int axis = 0; axis < 3; ++axis) acceleration[axis] = accelerations[i][axis];
        lanes_at<4>(previous[i].at) = present;
        previous[i].at[3] = inverse_mass;
        if (inverse_mass > 0.0) present += substep * (keep * velocity + substep * acceleration);
        lanes_at<4>(positions[i].at) = present;
    }
}

}  // namespace

Sheets::Sheets(std::span<const double> inverse_masses)
    : inverse_masses_(inverse_masses.begin(), inverse_masses.end()), positions_(particles() + 1),
      previous_(particles() + 1) {}

void Sheets::take(std::span<const Point> positions, std::span<const Point> previous) {
    for (std::size_t i = 0; i < positions.size(); ++i) {
        positions_[i] = {positions[i][0], positions[i][1], positions[i][2], 0.0};
        previous_[i] = {previous[i][0], previous[i][1], previous[i][2], inverse_masses_[i]};
    }
}

void Sheets::solve(std::span<Point> positions, std::span<const Point> previous, bool is_first) {
    take(positions, previous);
    for (const auto &batch : batches_) {
        if (is_first) batch->clear();
        batch->solve({positions_.data(), previous_.data()});
    }
    for (std::size_t i = 0; i < positions.size(); ++i) std::copy_n(positions_[i].at, 3, positions[i].begin());
}

void Sheets::advance(std::span<Point> positions, std::span<Point> previous, std::span<Point> velocities,
                     std::span<const Point> accelerations, double substep, double keep, i64 substeps, i64 iterations) {
    predict(positions, previous, inverse_masses_, velocities, accelerations, substep, keep);  // line 1
    take(positions, previous);
    for (i64 done = 0; done < substeps; ++done) {
        if (done > 0) {
            predict_again(positions_.data(), previous_.data(), accelerations.data(), particles(), substep, keep);
        }
        for (const auto &batch : batches_) batch->clear();
        for (i64 iteration = 0; iteration < iterations; ++iteration) {                               // line 2
            for (const auto &batch : batches_) batch->solve({positions_.data(), previous_.data()});  // lines 3 to 6
        }
    }
    for (std::size_t i = 0; i < positions.size(); ++i) {
        for (int axis = 0; axis < 3; ++axis) {
            positions[i][axis] = positions_[i].at[axis];
            previous[i][axis] = previous_[i].at[axis];
            velocities[i][axis] = (positions[i][axis] - previous[i][axis]) / substep;  // line 9
        }
    }
}

void Sheets::store() const {
    for (const auto &batch : batches_) batch->store();
}

}  // namespace pdeanim::xpbd
