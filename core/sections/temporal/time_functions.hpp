// Functions of time that are stored (a chunk of section TIME): trajectories and shapes, one value a frame and axis.
//
// By one of three methods, of which an encoder takes the cheapest. Motion without a rhythm, jumps and starts included,
// is predicted from frame to frame. Motion that swings or repeats itself is a sum of cosines. Motion between keyframes
// is a row of straight lines: changes of speed, nearly all of them zero. Each way whole numbers are left, small for the
// most part, which are coded alike.
//
// This folder codes section TIME (13 of the specification). Begin here: time_functions.cpp has the stream and its context
// models, prediction.cpp and time_methods.cpp the three methods, closed_form the functions of Eq. 12, which no stream holds.
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

// Method `predicted`: each number from those of the four frames before it, by weights that learn.
//
// Recursive least squares with forgetting (Haykin, "Adaptive filter theory", chapter 10), the error of each number
// weighed by the variance of the numbers of late, so that functions of every size teach the same weights. Values
// predict others: +, -, * and / of float64 in the order written, so that every IEEE 754 machine gets the same bits.
//
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

// Method `transformed`, sums of cosines (DCT-II, orthonormal). One period of the cosine in 4 `frames` samples, cos(2 pi j / (4 frames)) within 2^-51; the same bits on every
// machine. There is a frame or more.
std::vector<double> cosine_wave(i64 frames);

// Method `transformed`: the inverse transform of a number for each frequency, in steps.
std::vector<double> transformed_values(const TimeShape &shape, std::span<const i64> quantised, double step);

// Method `straight`: lines from keyframe to keyframe: changes of speed, of the first frame the value itself.
//
// All in sixteenths of a step: speeds are whole numbers of them a frame, so that a line stays within half a step for 16
// frames at least.
//
// From changes of speed: sums of sums, which wrap at 64 bits.
std::vector<double> values_along_lines(const TimeShape &shape, std::span<const i64> quantised, double step);

// Changes of speed for what is wanted, in steps, function after function; each line as long as it stays within a
// tolerance of half a sixteenth or more. There is a frame or more.
std::vector<i64> quantise_straight(const TimeShape &shape, std::span<const double> wanted, double tolerance);

}  // namespace pdeanim
