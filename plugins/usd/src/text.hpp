// Numbers and JSON in texts that come from files and from layers' arguments.
#pragma once

#include <optional>
#include <string>

#include "usd_headers.hpp"

namespace pdeanim_usd {

// Return the number that a whole text is, whatever the program's locale; nothing if it is none, or not finite.
std::optional<double> number_of(const std::string &text);

// Return the JSON object that a text is. Raise Failure, which calls the text by a name, if it is none: it must be UTF-8, and
// nested less deeply than parsers can bear.
JsObject json_object(const std::string &text, const std::string &name);

}  // namespace pdeanim_usd
