// The coded stream of section SEQN (4 of the specification): times that follow no rule, and the names of objects.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "entropy/text_model.hpp"

namespace pdeanim {

// times: times listed one by one [s], may be empty; names: UTF-8.
std::vector<u8> encode_description(std::span<const double> times, std::span<const std::string> names);

// Return the listed times, which come first in the stream. Any bytes give times: the caller checks that they increase.
std::vector<double> decode_times(std::span<const u8> data, i64 times);

// Return the names of `objects` objects, which come after `times` listed times. CorruptError if the names are not
// UTF-8, or if there are more or fewer.
std::vector<std::string> decode_names(std::span<const u8> data, i64 times, i64 objects, const TakeMemory &take);

}  // namespace pdeanim
