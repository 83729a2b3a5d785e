// Stored functions of time (a chunk of section TIME): trajectories and shapes, one value per frame and axis.
//
// An encoder takes the cheapest of three methods. Irregular motion, including sudden starts, is predicted from frame to
// frame. Motion that swings or repeats is a sum of cosines. Motion between keyframes is a polyline, stored as changes
// of speed, nearly all of which are zero. Each method leaves whole numbers, mostly small, which are coded in the same
// way.
//
// This folder codes section TIME (13 of the specification). Begin here: time_functions.cpp has the stream and its
// context models, prediction.cpp and time_methods.cpp the three methods, closed_form the functions of Eq. 12, which are
// never stored.
#pragma once

#include <span>
#include <vector>

#include "base/arithmetic.hpp"

namespace pdeanim {

enum class TimeMethod : u8 { predicted, transformed, straight };

// Shape of functions of time. Quantised numbers are ordered by function, frame (or frequency) and axis; values by
// frame, axis and function.
struct TimeShape {
    i64 functions = 0, frames = 0, axes = 3;  // axes: 1 if all three axes share the values

    i64 numbers() const { return functions * frames * axes; }

    // Raise std::invalid_argument if no array can have this shape.
    void check() const;
};

// Largest number of frames that are transformed: the work of a decoder grows with the square.
constexpr i64 longest_transform = 1024;

// Encode the method and the numbers; empty if all numbers are zero. Magnitudes are at most 2^40 - 2.
std::vector<u8> encode_time_functions(TimeMethod method, const TimeShape &shape, std::span<const i64> quantised);

// Measure the bits that `encode_time_functions` takes, to within a byte or two.
double measure_time_functions(const TimeShape &shape, std::span<const i64> quantised);

// Return the values of quantised functions of time. They are finite for every step below 2^900.
std::vector<double> time_function_values(TimeMethod method, const TimeShape &shape, std::span<const i64> quantised,
                                         double step);

// Undo `encode_time_functions`: return the values. CorruptError if the method is unknown or impossible, or if bytes are
// left over or missing; other damage gives wrong values. Memory and time are bounded by the shape, which the caller has
// checked against its limits.
std::vector<double> decode_time_functions(std::span<const u8> data, const TimeShape &shape, double step);

// Method `predicted`: each number is predicted from the four previous frames, by weights that learn.
//
// This is recursive least squares with forgetting (Haykin, "Adaptive filter theory", chapter 10). The error of each
// number is weighed by the variance of recent numbers, so that functions of every magnitude train the same weights.
// Decoded values predict others: only +, -, * and / of float64 in the order written, so every IEEE 754 machine gets the
// same bits.
//
// Return the values [steps] for prediction errors.
std::vector<double> predicted_values(const TimeShape &shape, std::span<const i64> quantised, double step);

struct QuantisedTimeFunctions {
    std::vector<i64> quantised;
    std::vector<double> values;  // the decoder's values
};

// Quantise wanted values [steps], function after function. rounding: added to a magnitude before its fraction is
// dropped (0.5 is plain rounding).
QuantisedTimeFunctions quantise_predicted(const TimeShape &shape, std::span<const double> wanted, double rounding,
                                          double step);

// Method `transformed`: sums of cosines (DCT-II, orthonormal). Return one period of the cosine in 4 `frames` samples,
// cos(2 pi j / (4 frames)), to within 2^-51 and with the same bits on every machine. There is at least one frame.
std::vector<double> cosine_wave(i64 frames);

// Method `transformed`: return the values [steps] for one number per frequency (the inverse transform).
std::vector<double> transformed_values(const TimeShape &shape, std::span<const i64> quantised, double step);

// Method `straight`: lines from keyframe to keyframe, as changes of speed; for the first frame the value itself.
//
// All numbers are in sixteenths of a step: speeds are whole numbers of these per frame, so a line stays within half a
// step for at least 16 frames.
//
// Return the values for changes of speed: sums of sums, which wrap at 64 bits.
std::vector<double> values_along_lines(const TimeShape &shape, std::span<const i64> quantised, double step);

// Return changes of speed for wanted values [steps], function after function. Each line is as long as it keeps the
// tolerance, which is at least half a sixteenth. There is at least one frame.
std::vector<i64> quantise_straight(const TimeShape &shape, std::span<const double> wanted, double tolerance);

}  // namespace pdeanim
