// The coded stream of section SEQN (4 of the specification): times that no rule gives, and the names of objects.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "entropy/text_model.hpp"

namespace pdeanim {

// times: those that are listed one by one, or none [s]; names: UTF-8.
std::vector<u8> encode_description(std::span<const double> times, std::span<const std::string> names);

// The listed times, which come first. They are any bits: the caller checks that they increase.
std::vector<double> decode_times(std::span<const u8> data, i64 times);

// Names of so many objects, after so many listed times. CorruptError where they are not UTF-8, or there are more or fewer.
std::vector<std::string> decode_names(std::span<const u8> data, i64 times, i64 objects, const TakeMemory &take);

}  // namespace pdeanim
