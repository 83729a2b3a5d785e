#include "sections/attributes/plan.hpp"

#include <algorithm>
#include <cstring>
#include <string_view>

#include "sections/attributes/wedges.hpp"

namespace pdeanim {

namespace {

// Texture coordinates are attributes of this name, and those whose name begins with it and a colon.
constexpr std::string_view uv = "uv";

// Corners of a vertex with equal numbers share a normal; numbered at each vertex from 0, as its corners come.
constexpr std::string_view normal_group = "normal_group";

template <class T> std::vector<T> values_as(const AttributeView &attribute) {
    std::vector<T> values(attribute.values.size() / sizeof(T));
    if (!values.empty()) std::memcpy(values.data(), attribute.values.data(), values.size() * sizeof(T));
    return values;
}

// Whether numbers are those of fans, and the coder can find these: of many corners at a vertex only some are looked at.
bool are_fans(const AttributeView &attribute, const std::vector<i32> &numbers, const AttributeMesh &mesh) {
    if (attribute.name != normal_group || attribute.domain != Domain::corner || attribute.indices) return false;
    const std::span<const i32> vertices = mesh.face_corners();
    if (numbers.size() != vertices.size() || fan_numbers(vertices, numbers) != numbers) return false;
    std::vector<i32> corners(mesh.polygons().vertices), fans_at(corners.size());
    for (std::size_t corner = 0; corner < numbers.size(); ++corner) {
        const i32 vertex = vertices[corner];
        ++corners[vertex];
        fans_at[vertex] = most(fans_at[vertex], numbers[corner] + 1);
    }
    for (std::size_t vertex = 0; vertex < corners.size(); ++vertex) {
        const i32 fans_here = fans_at[vertex];
        if (corners[vertex] > WedgeModel::most_corners && fans_here > 1 && fans_here < corners[vertex]) return false;
    }
    return true;
}

Kind kind_of(const AttributeView &attribute, const AttributeMesh &mesh) {
    const i64 channels = attribute.columns ? attribute.columns - 1 : 1;
    const bool is_narrow = 1 <= channels && channels <= most_channels, is_flat = attribute.columns == 0;
    if (attribute.type == ValueType::float32 && is_narrow) return floats;
    if (attribute.type == ValueType::uint8 && is_narrow && !is_flat) return colours;
    if (attribute.type == ValueType::int32 && is_flat) {
        return are_fans(attribute, values_as<i32>(attribute), mesh) ? fans : integers;
    }
    if (attribute.type == ValueType::uint8 && is_flat) return flags;
    return static_cast<Kind>(raw + static_cast<i64>(attribute.type));
}

i64 plain_rule(const AttributeView &attribute, const AttributeMesh &mesh) {
    if (!attribute.indices) return not_indexed;
    if (attribute.domain != Domain::corner || attribute.rows != mesh.polygons().vertices) return listed;
    return std::ranges::equal(*attribute.indices, mesh.face_corners()) ? by_vertex : listed;
}

// A rule that numbers rows as they are; where they are free, any that has no list.
i64 rule_of(const AttributeView &attribute, const AttributeMesh &mesh, std::span<const i32> codes, int channels,
            bool is_free) {
    for (i64 rule = first_used; rule <= last_rule; ++rule) {
        const Numbered found = number_by_use(mesh, attribute.domain, rule, codes, channels);
        const bool has_all = static_cast<i64>(found.first.size()) == attribute.rows;
        if (has_all && std::ranges::equal(found.of, *attribute.indices)) return rule;
    }
    return is_free ? first_used : listed;
}

}  // namespace

ValueType AttributeHead::type() const {
    if (kind >= raw) return static_cast<ValueType>(kind - raw);
    if (kind == floats) return ValueType::float32;
    return kind == colours || kind == flags ? ValueType::uint8 : ValueType::int32;
}

bool AttributeHead::is_possible() const {
    if (domain >= domain_count || rule > last_rule || kind >= kind_end) return false;
    const bool is_of_corners = static_cast<Domain>(domain) == Domain::corner;
    if (rule == by_vertex && !is_of_corners) return false;
    if (kind == floats || kind == colours) {
        return 1 <= channels() && channels() <= most_channels && (kind == floats || columns > 0);
    }
    if (kind == integers || kind == flags) return columns == 0;
    if (kind == fans) return columns == 0 && rule == not_indexed && is_of_corners;
    return rule < first_used;
}

AttributePlan plan_of(const AttributeView &attribute, const AttributeMesh &mesh, const AttributeSettings &settings) {
    AttributePlan plan;
    AttributeHead &head = plan.head;
    head.name = attribute.name;
    head.domain = static_cast<i64>(attribute.domain);
    head.kind = kind_of(attribute, mesh);
    head.columns = attribute.columns;
    head.labels = attribute.labels;
    const int channels = head.kind < raw ? static_cast<int>(head.channels()) : 0;
    bool is_free = !settings.keeps_rows;
    if (head.kind == floats) {
        std::vector<float> values = values_as<float>(attribute);
        i64 divisor = 1;
        if (settings.uv_tolerance && attribute.name.substr(0, attribute.name.find(':')) == uv) {
            divisor = round_within(values, channels, *settings.uv_tolerance);
            is_free = true;  // rows that became equal may come back as one
        }
        plan.channels = codes_of_floats(values, channels, divisor);
    } else if (attribute.type == ValueType::uint8 && head.kind < raw) {
        plan.channels = {{attribute.values.begin(), attribute.values.end()}, byte_scales(channels)};
    } else if (head.kind < raw) {
        plan.channels.codes = values_as<i32>(attribute);
    } else {
        plan.bytes = attribute.values;
    }
    head.rule = plain_rule(attribute, mesh);
    if (attribute.indices) plan.indices = *attribute.indices;
    const bool has_holes = std::any_of(plan.indices.begin(), plan.indices.end(), [](i32 row) { return row < 0; });
    if (head.rule == listed && head.kind < fans && !has_holes) {
        std::vector<i32> codes = rows_of(plan.channels.codes, channels, plan.indices);
        head.rule = rule_of(attribute, mesh, codes, channels, is_free);
        if (head.rule >= first_used) plan.channels.codes = std::move(codes);
    }
    if (attribute.domain == Domain::object) {
        head.elements = attribute.indices ? static_cast<i64>(plan.indices.size()) : attribute.rows;
    }
    if (head.rule == listed) head.rows = attribute.rows;
    return plan;
}

}  // namespace pdeanim
