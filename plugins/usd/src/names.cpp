#include "names.hpp"

#include <map>

namespace pdeanim_usd {

namespace {

// Name of an object that has none.
const std::string default_name = "mesh";

Steps split(const std::string &text, char separator) {
    Steps parts(1);
    for (const char one : text) {
        if (one == separator) {
            parts.emplace_back();
        } else {
            parts.back() += one;
        }
    }
    return parts;
}

bool continues_character(char byte) { return (static_cast<unsigned char>(byte) & 0xC0) == 0x80; }

}  // namespace

Steps path_steps(const std::string &name) {
    Steps steps = split(name, '/');
    std::erase(steps, "");
    return steps;
}

std::string valid_name(const std::string &step) {
    std::string found;
    for (std::size_t i = 0, end; i < step.size(); i = end) {
        end = i + 1;
        while (end < step.size() && continues_character(step[end])) ++end;
        const std::string character = step.substr(i, end - i);
        found += SdfPath::IsValidIdentifier("_" + character) ? character : "_";
    }
    return SdfPath::IsValidIdentifier(found) ? found : "_" + found;
}

std::string valid_property_name(const std::string &name) {
    std::string found;
    for (const std::string &part : split(name, ':')) found += (found.empty() ? "" : ":") + valid_name(part);
    return found;
}

std::string role_of(const std::string &name) { return name.substr(0, name.find(':')); }

std::string primvar_name(const std::string &field, std::int64_t columns) {
    static const std::set<std::string> roles{"uv", "color", "vector", "normal"};
    if (field == "uv") return "st";
    if (field == "color") return columns == 3 ? "displayColor" : "color";
    const std::string role = role_of(field);
    const bool has_role = roles.contains(role) && field.size() > role.size() + 1;
    return has_role ? field.substr(role.size() + 1) : field;
}

std::string field_name(const std::string &primvar, const TfToken &type) {
    const auto &types = *SdfValueTypeNames;
    static const std::set<std::string> uv_names{"st", "uv", "UVMap", "map1"};
    const auto is = [&](const SdfValueTypeName &one) { return type == one.GetAsToken(); };
    if (is(types.Vector3fArray)) return "vector:" + primvar;
    if (is(types.Normal3fArray)) return "normal:" + primvar;
    const bool is_uv =
        is(types.TexCoord2fArray) || is(types.TexCoord3fArray) || (is(types.Float2Array) && uv_names.contains(primvar));
    if (is_uv) return primvar == "uv" || primvar == "st" ? "uv" : "uv:" + primvar;
    if (is(types.Color3fArray) || is(types.Color4fArray)) {
        return primvar == "color" || primvar == "displayColor" ? "color" : "color:" + primvar;
    }
    return primvar;
}

std::string unique_name(const std::string &name, std::set<std::string> &taken) {
    std::string found = name;
    for (int number = 2; !taken.insert(found).second; ++number) found = name + "_" + std::to_string(number);
    return found;
}

std::vector<Steps> tree_paths(const std::vector<std::string> &names) {
    std::set<Steps> taken, branches;
    std::vector<Steps> wanted, paths;
    for (const std::string &name : names) {
        Steps steps = path_steps(name);
        wanted.push_back(steps.empty() ? Steps{default_name} : steps);
    }
    const auto valid = [](Steps steps) {
        for (std::string &step : steps) step = valid_name(step);
        return steps;
    };
    for (const Steps &steps : wanted) {
        Steps branch = valid(steps);
        for (branch.pop_back(); !branch.empty(); branch.pop_back()) branches.insert(branch);
    }
    // Many objects may have one name: the search for a free number goes on where the last one ended.
    std::map<Steps, int> last_numbers;
    for (const Steps &steps : wanted) {
        Steps path = valid(steps);
        int &number = last_numbers.try_emplace(path, 1).first->second;
        while (taken.contains(path) || branches.contains(path)) {
            path.back() = valid_name(steps.back() + "_" + std::to_string(++number));
        }
        taken.insert(path);
        paths.push_back(path);
    }
    return paths;
}

}  // namespace pdeanim_usd
