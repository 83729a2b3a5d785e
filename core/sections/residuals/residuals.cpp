#include "sections/residuals/residuals.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <memory>
#include <string>

#include "base/errors.hpp"
#include "sections/residuals/residual_model.hpp"

namespace pdeanim {

namespace {

constexpr std::size_t most_samples = 64;  // places at which frames are compared; enough to distinguish a cycle
constexpr i64 small_number = 1 << 20;     // if all residuals are below this, sums over all samples stay within 32 bits
constexpr i64 raw_vertex_bytes = 12;      // smallest size of a raw vertex in a stream; the last may be shortened

struct Head {
    i64 residuals = 0, raw_vertices = 0;
    bool is_predicted = false;
};

template <Mode mode> Head code_head(RangeCoder<mode> &coder, Head head) {
    CountedModel residuals, raw_vertices;
    BitModel is_predicted;
    head.residuals = residuals.code(coder, head.residuals + 1) - 1;
    head.raw_vertices = raw_vertices.code(coder, head.raw_vertices + 1) - 1;
    head.is_predicted = coder.bit(is_predicted, head.is_predicted);
    return head;
}

// Codes raw vertices, ordered by frame and then by place.
class RawModel {
public:
    // Code one vertex. frame, place: of the previous vertex on entry, of this vertex on return.
    template <Mode mode>
    void code(RangeCoder<mode> &coder, i64 &frame, i64 &place, i64 wanted_frame, i64 wanted_place, Position &position) {
        const i64 passed_over = frames_.code(coder, wanted_frame - frame + 1) - 1;
        if (passed_over > 0) {
            frame += passed_over;
            place = -1;
        }
        place += places_.code(coder, wanted_place - place);
        for (float &coordinate : position) {
            const u32 bits = std::bit_cast<u32>(coordinate);
            u32 found = 0;
            for (int digit = 31; digit >= 0; --digit) found = 2 * found + coder.bypass((bits >> digit) & 1);
            coordinate = std::bit_cast<float>(found);
        }
    }

private:
    CountedModel frames_, places_;
};

// copies: measure the bits of this many times as many residuals of this kind.
template <Mode mode> void write(RangeCoder<mode> &coder, const Residuals &residuals, std::span<const i64> patches,
                                const ResidualCoding &coding, [[maybe_unused]] double copies = 1.0) {
    const i64 count = static_cast<i64>(residuals.places.size());
    const i64 raw_count = static_cast<i64>(residuals.raw_places.size());
    code_head(coder, {count, raw_count, coding.is_predicted});
    if (count) {
        const auto model = std::make_unique<ResidualModel<mode>>(coder, patches, coding.is_predicted, residuals, count);
        model->code(residuals.frames(), coding.distances);
        if constexpr (mode == Mode::measure) {
            if (copies > 1.0) {
                model->begin_again();
                coder.count_more(copies - 1.0, [&] { model->code(residuals.frames(), coding.distances); });
            }
        }
    }
    RawModel model;
    i64 frame = 0, place = -1, wanted = 0;
    for (i64 k = 0; k < raw_count; ++k) {
        while (residuals.raw_frame_starts[wanted + 1] <= k) ++wanted;
        Position position = residuals.raw_positions[k];
        model.code(coder, frame, place, wanted, residuals.raw_places[k], position);
    }
}

void check_starts(const std::vector<i64> &starts, std::size_t count) {
    const bool is_sound = !starts.empty() && starts.front() == 0 && std::is_sorted(starts.begin(), starts.end()) &&
                          starts.back() == static_cast<i64>(count);
    if (!is_sound) throw ArgumentError("residuals must begin at 0, and end with their number");
}

void check_places(const std::vector<i64> &starts, const std::vector<i32> &places, i64 vertices) {
    for (std::size_t frame = 0; frame + 1 < starts.size(); ++frame) {
        i64 before = -1;
        for (i64 k = starts[frame]; k < starts[frame + 1]; ++k) {
            if (places[k] <= before || places[k] >= vertices) {
                throw ArgumentError(
                    "places of residuals must ascend within a frame, and be below the number of vertices");
            }
            before = places[k];
        }
    }
}

// For each frame, find the earlier frame that is most similar at the sampled places (ascending), and store how many
// frames back it is. The distance stays unchanged if no frame is similar. Number must hold sums of 12 differences per
// place.
template <class Number>
void find_nearest(const Residuals &residuals, std::span<const i32> sampled, std::span<i64> distances) {
    const i64 frames = residuals.frames();
    std::vector<i32> sample_of(sampled.back() + 1, -1);
    for (std::size_t k = 0; k < sampled.size(); ++k) sample_of[sampled[k]] = static_cast<i32>(k);
    const std::size_t width = 3 * sampled.size();
    std::vector<Number> numbers(frames * width);
    for (i64 frame = 0; frame < frames; ++frame) {
        for (i64 k = residuals.frame_starts[frame]; k < residuals.frame_starts[frame + 1]; ++k) {
            const i32 place = residuals.places[k];
            const i32 sample = place <= sampled.back() ? sample_of[place] : -1;
            if (sample < 0) continue;
            for (int axis = 0; axis < 3; ++axis) {
                numbers[frame * width + 3 * sample + axis] = static_cast<Number>(residuals.quantised[k][axis]);
            }
        }
    }
    for (i64 frame = 2; frame < frames; ++frame) {
        const Number *own = &numbers[frame * width], *before = own - width, *second = before - width;
        i64 nearest = 0;
        Number least_different = -1, of_frame_before = 0, of_straight_line = 0;
        for (i64 other = 0; other < frame; ++other) {
            const Number *its = &numbers[other * width];
            Number different = 0;
            for (std::size_t k = 0; k < width; ++k) {
                different += its[k] < own[k] ? own[k] - its[k] : its[k] - own[k];
            }
            if (least_different < 0 || different < least_different) {
                nearest = other;
                least_different = different;
            }
            of_frame_before = different;
        }
        for (std::size_t k = 0; k < width; ++k) {
            of_straight_line += static_cast<Number>(size_of(own[k] - 2 * before[k] + second[k]));
        }
        // Take an earlier frame only if it differs by less than half as much as the previous frame does, and as the
        // straight line through the previous two frames does.
        if (2 * least_different < least(of_frame_before, of_straight_line)) distances[frame] = frame - nearest;
    }
}

}  // namespace

void check_residuals(const Residuals &residuals, i64 vertices) {
    const auto &[starts, places, quantised, raw_starts, raw_places, raw_positions] = residuals;
    if (starts.size() != raw_starts.size() || quantised.size() != places.size() ||
        raw_positions.size() != raw_places.size()) {
        throw ArgumentError("residuals and their parts must agree in frames and places");
    }
    check_starts(starts, places.size());
    check_starts(raw_starts, raw_places.size());
    check_places(starts, places, vertices);
    check_places(raw_starts, raw_places, vertices);
    for (const Steps &steps : quantised) {
        if (std::any_of(steps.begin(), steps.end(),
                        [](i64 number) { return number < -largest_residual || number > largest_residual; })) {
            throw ArgumentError("a residual must be of 2^40 steps at most");
        }
        if (steps == Steps{}) throw ArgumentError("a residual must have a number that is not zero");
    }
}

std::vector<i64> reference_distances(const Residuals &residuals) {
    const i64 frames = residuals.frames();
    std::vector<i64> distances(frames, 1);
    if (residuals.places.empty()) return distances;
    std::vector<i32> sampled;
    for (std::size_t k = 0; k < residuals.places.size(); k += 1 + residuals.places.size() / most_samples) {
        sampled.push_back(residuals.places[k]);
    }
    std::sort(sampled.begin(), sampled.end());
    sampled.erase(std::unique(sampled.begin(), sampled.end()), sampled.end());
    const bool is_small = std::all_of(residuals.quantised.begin(), residuals.quantised.end(), [](const Steps &steps) {
        return std::all_of(steps.begin(), steps.end(), [](i64 number) { return size_of(number) < small_number; });
    });
    if (is_small) {
        find_nearest<i32>(residuals, sampled, distances);
    } else {
        find_nearest<i64>(residuals, sampled, distances);
    }
    return distances;
}

std::vector<u8> encode_residuals(const Residuals &residuals, std::span<const i64> patches,
                                 const ResidualCoding &coding) {
    if (residuals.count() == 0) return {};
    RangeCoder<Mode::encode> coder;
    write(coder, residuals, patches, coding);
    return coder.finish();
}

double measure_residuals(const Residuals &residuals, std::span<const i64> patches, const ResidualCoding &coding,
                         double copies) {
    if (residuals.count() == 0) return 0.0;
    RangeCoder<Mode::measure> coder;
    write(coder, residuals, patches, coding, copies);
    return coder.bits();
}

Residuals decode_residuals(std::span<const u8> data, i64 frames, std::span<const i64> patches, TakenMemory &taken) {
    Residuals found;
    if (data.empty()) {
        found.frame_starts.resize(frames + 1);
        found.raw_frame_starts.resize(frames + 1);
        return found;
    }
    const i64 vertices = patches.back();
    RangeCoder<Mode::decode> coder(data);
    const Head head = code_head(coder, {});
    if (most(head.residuals, head.raw_vertices) > frames * vertices ||
        raw_vertex_bytes * (head.raw_vertices - 1) > static_cast<i64>(data.size())) {
        throw CorruptError(Section("CORR"), "declares more residuals than are possible; get the file again");
    }
    taken.take(static_cast<u64>(head.residuals * bytes_per_residual + head.raw_vertices * bytes_per_raw_vertex),
               std::to_string(head.residuals + head.raw_vertices) + " residuals in one group");
    if (head.residuals) {
        const auto model =
            std::make_unique<ResidualModel<Mode::decode>>(coder, patches, head.is_predicted, found, head.residuals);
        try {
            model->code(frames, {});
        } catch (const CorruptError &error) {
            throw CorruptError(Section("CORR"),
                               "holds impossible residuals: " + std::string(error.what()) + "; get the file again");
        }
    }
    found.frame_starts.resize(frames + 1);
    found.raw_places.reserve(head.raw_vertices);
    found.raw_positions.reserve(head.raw_vertices);
    RawModel model;
    i64 frame = 0, place = -1;
    for (i64 k = 0; k < head.raw_vertices; ++k) {
        Position position{};
        model.code(coder, frame, place, 0, 0, position);
        if (frame >= frames || place >= vertices) {
            throw CorruptError(Section("CORR"), "refers to a missing vertex; get the file again");
        }
        if (!(std::isfinite(position[0]) && std::isfinite(position[1]) && std::isfinite(position[2]))) {
            throw CorruptError(Section("CORR"), "has a position that is not finite; get the file again");
        }
        found.raw_frame_starts.resize(frame + 1, k);
        found.raw_places.push_back(static_cast<i32>(place));
        found.raw_positions.push_back(position);
    }
    found.raw_frame_starts.resize(frames + 1, head.raw_vertices);
    if (!coder.is_finished()) {
        throw CorruptError(Section("CORR"), "does not end with its residuals; get the file again");
    }
    return found;
}

void add_residuals(const Residuals &residuals, i64 frame, const ResidualScale &scale, double weight,
                   std::span<const Position> base, std::span<Position> positions) {
    for (i64 k = residuals.frame_starts[frame]; k < residuals.frame_starts[frame + 1]; ++k) {
        Position &position = positions[scale.order[residuals.places[k]]];
        for (int axis = 0; axis < 3; ++axis) {
            const double offset = static_cast<double>(residuals.quantised[k][axis]) * scale.step;
            position[axis] = static_cast<float>(static_cast<double>(position[axis]) + weight * offset);
        }
    }
    for (i64 k = residuals.raw_frame_starts[frame]; k < residuals.raw_frame_starts[frame + 1]; ++k) {
        const i32 vertex = scale.order[residuals.raw_places[k]];
        const Position &raw = residuals.raw_positions[k];
        for (int axis = 0; axis < 3; ++axis) {
            float &coordinate = positions[vertex][axis];
            if (base.empty()) {
                coordinate = raw[axis];
            } else {
                const double offset = static_cast<double>(raw[axis]) - static_cast<double>(base[vertex][axis]);
                coordinate = static_cast<float>(static_cast<double>(coordinate) + weight * offset);
            }
        }
    }
}

void residual_displacements(const Residuals &residuals, i64 frame, const ResidualScale &scale,
                            std::span<const Position> base, std::span<std::array<double, 3>> displacements) {
    for (i64 k = residuals.frame_starts[frame]; k < residuals.frame_starts[frame + 1]; ++k) {
        auto &displacement = displacements[scale.order[residuals.places[k]]];
        for (int axis = 0; axis < 3; ++axis) {
            displacement[axis] = static_cast<double>(residuals.quantised[k][axis]) * scale.step;
        }
    }
    for (i64 k = residuals.raw_frame_starts[frame]; k < residuals.raw_frame_starts[frame + 1]; ++k) {
        const i32 vertex = scale.order[residuals.raw_places[k]];
        for (int axis = 0; axis < 3; ++axis) {
            displacements[vertex][axis] =
                static_cast<double>(residuals.raw_positions[k][axis]) - static_cast<double>(base[vertex][axis]);
        }
    }
}

}  // namespace pdeanim
