// Names of prims and primvars, by names of objects and fields.
#pragma once

#include <set>
#include <string>
#include <vector>

#include "usd_headers.hpp"

namespace pdeanim_usd {

using Steps = std::vector<std::string>;

// Return the steps of an object's path, without empty ones.
Steps path_steps(const std::string &name);

// Return the identifier for a step, as OpenUSD's importers make it: characters that USD rejects become underscores, and
// an underscore precedes a digit.
std::string valid_name(const std::string &step);

// Return valid_name of each part of a name with colons.
std::string valid_property_name(const std::string &name);

// Return what USD calls a field that has a role, as "color" or "vector:NAME"; the field's own name if it has none.
std::string primvar_name(const std::string &field, std::int64_t columns);

// Return the name that a reader gives the field of a primvar of a type.
std::string field_name(const std::string &primvar, const TfToken &type);

// Return the part of a name before its first colon.
std::string role_of(const std::string &name);

// Return the name with a number appended if it is in `taken`, and add the result to `taken`.
std::string unique_name(const std::string &name, std::set<std::string> &taken);

// Return the path of each object's prim. Paths are unique and have at least one step; none is a parent of another.
std::vector<Steps> tree_paths(const std::vector<std::string> &names);

}  // namespace pdeanim_usd
