#include "encode/displacements.hpp"

#include <cmath>
#include <mutex>

#include "base/parallel.hpp"

namespace pdeanim {

template <class Real> double take_displacements(std::span<const float> points, std::span<const double> shape,
                                                double farthest, std::span<Real> rows, int threads) {
    constexpr i64 block =
        64;  // vertices whose rows are written side by side: each frame's read fills whole cache lines
    const i64 vertices = static_cast<i64>(shape.size()) / 3;
    const i64 frames = vertices ? static_cast<i64>(points.size() / shape.size()) : 0;
    double largest = 0.0;
    std::mutex lock;
    in_shares((vertices + block - 1) / block, threads, [&](i64 first, i64 end) {
        double found = 0.0;
        for (i64 begin = first * block; begin < least(end * block, vertices); begin += block) {
            const i64 stop = least(begin + block, vertices);
            for (i64 frame = 0; frame < frames; ++frame) {
                const float *from = points.data() + 3 * frame * vertices;
                for (i64 vertex = begin; vertex < stop; ++vertex) {
                    Real *to = rows.data() + 3 * (vertex * frames + frame);
                    for (i64 axis = 0; axis < 3; ++axis) {
                        const double moved = static_cast<double>(from[3 * vertex + axis]) - shape[3 * vertex + axis];
                        const double kept = std::fabs(moved) <= farthest ? moved : 0.0;
                        to[axis] = static_cast<Real>(kept);
                        found = most(found, std::fabs(kept));
                    }
                }
            }
        }
        const std::lock_guard guard(lock);
        largest = most(largest, found);
    });
    return largest;
}

template double take_displacements(std::span<const float>, std::span<const double>, double, std::span<float>, int);
template double take_displacements(std::span<const float>, std::span<const double>, double, std::span<double>, int);

}  // namespace pdeanim
