// Functions of time that are stored (a chunk of section TIME): trajectories and shapes, one value a frame and axis.
//
// By one of three methods, of which an encoder takes the cheapest. Motion without a rhythm, jumps and starts included,
// is predicted from frame to frame. Motion that swings or repeats itself is a sum of cosines. Motion between keyframes
// is a row of straight lines: changes of speed, nearly all of them zero. Each way whole numbers are left, small for the
// most part, which are coded alike.
#pragma once

#include <span>
#include <vector>

#include "base/arithmetic.hpp"

namespace pdeanim {

enum class TimeMethod : u8 { predicted, transformed, straight };

// Quantised functions of time stand function after function, in each frame after frame (or frequency), axis after axis;
// their values stand frame after frame, axis after axis, function after function.
struct TimeShape {
    i64 functions = 0, frames = 0, axes = 3;  // of 1 axis where all three move alike

    i64 numbers() const { return functions * frames * axes; }

    // std::invalid_argument unless there can be such an array.
    void check() const;
};

// Frames beyond which nothing is transformed: a decoder's work grows with their square.
constexpr i64 longest_transform = 1024;

// The method and the numbers as bytes; nothing where all numbers are zero. Magnitudes are 2^40 - 2 at most.
std::vector<u8> encode_time_functions(TimeMethod method, const TimeShape &shape, std::span<const i64> quantised);

// Bits that `encode_time_functions` would take, to a byte or two.
double measure_time_functions(const TimeShape &shape, std::span<const i64> quantised);

// Values of quantised functions of time: finite for every step below 2^900.
std::vector<double> time_function_values(TimeMethod method, const TimeShape &shape, std::span<const i64> quantised,
                                         double step);

// Undo `encode_time_functions`: the values. CorruptError if the method is unknown or cannot be, or bytes are left over
// or missing; other damage gives other values. Memory and time are bounded by the shape, which the caller has held
// against its limits.
std::vector<double> decode_time_functions(std::span<const u8> data, const TimeShape &shape, double step);

}  // namespace pdeanim
