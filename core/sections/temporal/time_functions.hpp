// Stored functions of time (a chunk of section TIME): trajectories and shapes, one value per frame and axis.
//
// An encoder takes the cheapest of three methods. Motion without a rhythm, including sudden starts, is predicted from
// frame to frame. Motion that swings or repeats is a sum of cosines. Motion between keyframes is a row of straight
// lines: changes of speed, nearly all of them zero. Each method leaves whole numbers, mostly small, which are coded
// alike.
//
// This folder codes section TIME (13 of the specification). Begin here: time_functions.cpp has the stream and its
// context models, prediction.cpp and time_methods.cpp the three methods, closed_form the functions of Eq. 12, which no
// stream holds.
#pragma once

#include <span>
#include <vector>

#include "base/arithmetic.hpp"

namespace pdeanim {

enum class TimeMethod : u8 { predicted, transformed, straight };

// Quantised functions of time are ordered by function, frame (or frequency) and axis; their values by frame, axis and
// function.
struct TimeShape {
    i64 functions = 0, frames = 0, axes = 3;  // 1 axis if all three move alike

    i64 numbers() const { return functions * frames * axes; }

    // std::invalid_argument unless such an array is possible.
    void check() const;
};

// Largest number of frames that are transformed: a decoder's work grows with its square.
constexpr i64 longest_transform = 1024;

// Encode the method and the numbers; empty if all numbers are zero. Magnitudes are at most 2^40 - 2.
std::vector<u8> encode_time_functions(TimeMethod method, const TimeShape &shape, std::span<const i64> quantised);

// Measure the bits of `encode_time_functions`, to a byte or two.
double measure_time_functions(const TimeShape &shape, std::span<const i64> quantised);

// Return the values of quantised functions of time: finite for every step below 2^900.
std::vector<double> time_function_values(TimeMethod method, const TimeShape &shape, std::span<const i64> quantised,
                                         double step);

// Undo `encode_time_functions`: return the values. CorruptError if the method is unknown or impossible, or bytes are
// left over or missing; other damage gives other values. Memory and time are bounded by the shape, which the caller has
// checked against its limits.
std::vector<double> decode_time_functions(std::span<const u8> data, const TimeShape &shape, double step);

// Method `predicted`: each number from those of the four previous frames, by weights that learn.
//
// Recursive least squares with forgetting (Haykin, "Adaptive filter theory", chapter 10). The error of each number is
// weighed by the variance of recent numbers, so that functions of every size train the same weights. Values predict
// others: +, -, * and / of float64 in the order written, so that every IEEE 754 machine gets the same bits.
//
// From prediction errors to values in steps.
std::vector<double> predicted_values(const TimeShape &shape, std::span<const i64> quantised, double step);

struct QuantisedTimeFunctions {
    std::vector<i64> quantised;
    std::vector<double> values;  // the decoder's values
};

// Quantise wanted values, in steps, function after function; `rounding` is added to a magnitude before its fraction is
// dropped (0.5 is plain rounding).
QuantisedTimeFunctions quantise_predicted(const TimeShape &shape, std::span<const double> wanted, double rounding,
                                          double step);

// Method `transformed`, sums of cosines (DCT-II, orthonormal). Return one period of the cosine in 4 `frames` samples,
// cos(2 pi j / (4 frames)) within 2^-51, with the same bits on every machine. There is at least one frame.
std::vector<double> cosine_wave(i64 frames);

// Method `transformed`: the inverse transform of one number per frequency, in steps.
std::vector<double> transformed_values(const TimeShape &shape, std::span<const i64> quantised, double step);

// Method `straight`: lines from keyframe to keyframe, as changes of speed; for the first frame the value itself.
//
// All in sixteenths of a step: speeds are whole numbers of them per frame, so that a line stays within half a step for
// at least 16 frames.
//
// From changes of speed: sums of sums, which wrap at 64 bits.
std::vector<double> values_along_lines(const TimeShape &shape, std::span<const i64> quantised, double step);

// Return changes of speed for wanted values, in steps, function after function; each line is as long as it stays within
// a tolerance of at least half a sixteenth. There is at least one frame.
std::vector<i64> quantise_straight(const TimeShape &shape, std::span<const double> wanted, double tolerance);

}  // namespace pdeanim
