#include "sections/attributes/plan.hpp"

#include <algorithm>
#include <cstring>
#include <string_view>

#include "sections/attributes/wedges.hpp"

namespace pdeanim {

namespace {

// Texture coordinates have this name, or this name, a colon and another name.
constexpr std::string_view uv = "uv";

// Name of the integer attribute whose equal numbers mark corners of a vertex that share a normal. Numbers count from 0
// at each vertex, in the order of its corners.
constexpr std::string_view normal_group = "normal_group";

template <class T> std::vector<T> values_as(const AttributeView &attribute) {
    std::vector<T> values(attribute.values.size() / sizeof(T));
    if (!values.empty()) std::memcpy(values.data(), attribute.values.data(), values.size() * sizeof(T));
    return values;
}

// Return whether the coder can reproduce the fans that the numbers describe. At a vertex of many corners it examines
// only some of them.
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

// Return a rule that reproduces the numbers of rows; if rows may be renumbered, some rule that needs no list.
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
            is_free = true;  // equal rows may be merged into one
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

namespace {

constexpr int is_common = 34;  // stands for the residual's length plus 1 if a value is common

// Return the place of the entry nearest to a code, the lower of two equally near ones. The table is not empty.
i64 nearest_place(const std::vector<i64> &table, i64 code) {
    const auto above = std::lower_bound(table.begin(), table.end(), code);
    const i64 place = above - table.begin();
    if (above == table.end() || (place > 0 && code - above[-1] <= *above - code)) return place - 1;
    return place;
}

int digits_of(i64 difference) { return bit_length(size_of(difference)); }

}  // namespace

std::vector<i32> Codes::full() const {
    std::vector<i32> found = codes;
    for (std::size_t i = 0; i < found.size(); ++i) {
        const Table &table = tables[i % tables.size()];
        if (table.is_complete) found[i] = static_cast<i32>(table.entries[found[i]]);
    }
    return found;
}

ValueModel::ValueModel()
    : by_channel_(rows * sizes * most_channels), by_prediction_(rows * predictions * sizes),
      by_spread_(rows * sizes * sizes) {}

// Code the length of a residual, the digits after the leading one, and the sign.
template <Mode mode>
i64 ValueModel::code_residual(RangeCoder<mode> &coder, bool is_place, const Outlook &of, i64 residual) {
    const i64 size = size_of(residual);
    const int wanted = bit_length(size);
    int length = clamp(of.spread ? (of.expected + of.spread) >> 1 : of.expected, 1, longest);
    Step step = first;
    while (true) {
        const int row = length * steps + step;
        const bool is_it =
            coder.template mixed<3>({&by_channel_[(row * sizes + of.before) * most_channels + of.channel],
                                     &by_prediction_[(row * predictions + 4 * of.best + of.count) * sizes + of.spread],
                                     &by_spread_[(row * sizes + of.spread) * sizes + of.expected]},
                                    length_weights_[is_place][step][of.best].data(), wanted >= length);
        if (step == first) step = is_it ? up : down;
        if (step == up) {
            if (!is_it) {
                --length;
                break;
            }
            if (length == longest) break;
            ++length;
        } else if (is_it || --length == 0) {
            break;
        }
    }
    if (length == 0) return 0;
    i64 value = 1;
    for (int digit = length - 2; digit >= 0; --digit) {
        const bool bit = (size >> digit) & 1;
        value = 2 * value + (value < 4 ? coder.bit(digits_[length][value], bit) : coder.bypass(bit));
    }
    BitModel &sign = signs_[(of.lean * 4 + least(length, 3)) * (WedgeField::ways + 1) + of.best];
    return coder.bit(sign, residual < 0) ? -value : value;
}

// Code whether a value is in the table of its channel, and if so its place in the table; return the place, or -1.
template <Mode mode> i64 ValueModel::code_common(RangeCoder<mode> &coder, const std::vector<i64> &table, i64 nearest,
                                                 int distance, const Outlook &of, i64 code) {
    const bool is_in = mode != Mode::decode && std::binary_search(table.begin(), table.end(), code);
    const int nearness = clamp(distance - of.expected + 8, 0, 15);
    const bool is_there = coder.template mixed<3>(
        {&common_near_[nearness * 16 + history_], &common_by_prediction_[(4 * of.best + of.count) * sizes + distance],
         &common_expected_[(nearness * most_channels + of.channel) * sizes + of.expected]},
        common_weights_.data(), is_in);
    history_ = (2 * history_ + is_there) & 15;
    if (!is_there) return -1;
    // Try the nearest entry first, then the others in order; the last one needs no bit.
    i64 place = nearest;
    const i64 others = static_cast<i64>(table.size()) - 1;
    for (i64 turn = 0; turn < others; ++turn) {
        if (coder.bit(which_[least<i64>(turn, 3) * sizes + distance], table[place] == code)) break;
        place = turn == 0 ? 0 : place + 1;
        if (place == nearest) ++place;
    }
    return place;
}

template <Mode mode> void ValueModel::code(RangeCoder<mode> &coder, WedgeField &field, Codes &codes) {
    constexpr int none = WedgeField::ways;
    const int channels = field.channels(), shift = field.scales().shift;
    history_ = 0;
    field.restart();
    i32 last = -1;
    for (const i32 wedge : field.order()) {
        if (wedge == field.count()) continue;
        coder.check_not_ended();
        const WedgeField::Findings &found = field.look_around(wedge);
        const auto [best, second] = field.best_ways();
        const int count = best == none ? 0 : static_cast<int>(least<i64>(found.counts[best], 3));
        const bool has_neighbours = found.counts[WedgeField::neighbours] > 0;
        int before = 0;
        for (int k = 0; k < channels; ++k) {
            const Scale &scale = field.scales().of_channel[k];
            const auto &[table, is_complete] = codes.tables[k];
            const i64 linear = best != none ? found.predicted[best][k] : last >= 0 ? field.linear(last, k) : 0;
            i64 prediction = scale.code_near(linear, shift), nearest = 0;
            int distance = 0;
            if (!table.empty()) {
                nearest = nearest_place(table, prediction);
                distance = digits_of(table[nearest] - prediction);
            }
            if (is_complete) prediction = nearest;
            const i64 expected = has_neighbours ? found.expected[k] : last >= 0 ? field.length(last, k) : 0;
            Outlook outlook{k, static_cast<int>(expected), before, 0, 1, best == none ? 0 : best + 1, count};
            if (second != none) {
                i64 other = scale.code_near(found.predicted[second][k], shift);
                if (is_complete) other = nearest_place(table, other);
                outlook.spread = 1 + digits_of(other - prediction);
                outlook.lean = other < prediction ? 0 : other > prediction ? 2 : 1;
            }
            const i64 at = static_cast<i64>(wedge) * channels + k;
            i64 code = codes.codes[at];
            field.length(wedge, k) = static_cast<u8>(expected);
            if (is_complete && table.size() == 1) {
                code = 0;
            } else if (k > 0 && channels > 2 && coder.bit(alike_[k], code == codes.codes[at - 1])) {
                code = codes.codes[at - 1];
            } else {
                i64 place = -1;
                if (!table.empty() && !is_complete) place = code_common(coder, table, nearest, distance, outlook, code);
                if (place >= 0) {
                    code = table[place];
                    before = is_common;
                } else {
                    code = prediction + code_residual(coder, is_complete, outlook, code - prediction);
                    const int length = digits_of(code - prediction);
                    field.length(wedge, k) = static_cast<u8>(length);
                    before = 1 + length;
                }
            }
            const bool is_in_table = !is_complete || (0 <= code && code < static_cast<i64>(table.size()));
            if (!is_in_table || code < -largest_code - 1 || code > largest_code) {
                throw CorruptError("has a value out of range");
            }
            codes.codes[at] = static_cast<i32>(code);
            field.linear(wedge, k) = static_cast<i32>(scale.linear_of(is_complete ? table[code] : code, shift));
        }
        field.learn(wedge);
        last = wedge;
    }
}

template void ValueModel::code(RangeCoder<Mode::encode> &, WedgeField &, Codes &);
template void ValueModel::code(RangeCoder<Mode::decode> &, WedgeField &, Codes &);
template void ValueModel::code(RangeCoder<Mode::measure> &, WedgeField &, Codes &);

}  // namespace pdeanim
