#include "sections/attributes/attributes.hpp"

#include <algorithm>
#include <bit>
#include <cstring>
#include <map>
#include <optional>

#include "base/errors.hpp"
#include "entropy/numbers.hpp"
#include "entropy/text_model.hpp"
#include "sections/attributes/plan.hpp"
#include "sections/attributes/wedges.hpp"

namespace pdeanim {

namespace {

static_assert(std::endian::native == std::endian::little, "bytes of values are read and written as they lie in memory");

// Peak memory. Per corner of an object with attributes: three corner tables, the traversal, normals. Per element or row
// of an attribute: its wedge, the wedge's fan, its place in the traversal and in the rows. Per number: codes, linear
// values, lengths, predictions, the result.
constexpr i64 bytes_per_corner = 320, bytes_per_element = 200, bytes_per_number = 64;

// Memory in Python of an attribute without values, and of a short text [bytes].
constexpr i64 bytes_per_attribute = 1024, bytes_per_label = 128;

constexpr i64 most_rows = (i64{1} << 31) - 1;  // rows are numbered by int32

// A value is common if it occurs at least this often and makes up at least this share of all values, because its entry
// in a table costs four bytes.
constexpr double least_common = 4, common_share = 0.02;
constexpr std::size_t most_common = 16;

constexpr double most_tabled = 0.95;  // share of different values above which a complete table does not pay

// Sizes that a file declares are clamped to this, so that products and sums of two stay within 64 bits.
constexpr i64 immense = i64{1} << 60;
constexpr i64 product(i64 a, i64 b) { return b && a > immense / b ? immense : a * b; }

// Replace codes by indices into tables, which hold all values or only the common ones.
Codes tabled(const std::vector<i32> &full, int channels, bool all_in) {
    Codes found{full, {}};
    const std::size_t rows = full.size() / channels;
    for (int k = 0; k < channels; ++k) {
        std::vector<i64> values;
        for (std::size_t row = 0; row < rows; ++row) values.push_back(full[row * channels + k]);
        std::sort(values.begin(), values.end());
        Codes::Table table;
        std::vector<i64> common;
        for (std::size_t begin = 0, end; begin < rows; begin = end) {
            for (end = begin + 1; end < rows && values[end] == values[begin];) ++end;
            table.entries.push_back(values[begin]);
            const double least_many = most(least_common, common_share * static_cast<double>(rows));
            if (static_cast<double>(end - begin) >= least_many && common.size() < most_common) {
                common.push_back(values[begin]);
            }
        }
        table.is_complete = all_in || table.entries.size() <= 1;
        if (table.is_complete) {
            for (std::size_t at = k; at < full.size(); at += channels) {
                const auto entry = std::lower_bound(table.entries.begin(), table.entries.end(), full[at]);
                found.codes[at] = static_cast<i32>(entry - table.entries.begin());
            }
        } else {
            table.entries = std::move(common);
        }
        found.tables.push_back(std::move(table));
    }
    return found;
}

double cost_of(WedgeField &field, Codes &codes) {
    RangeCoder<Mode::measure> coder;
    AscendingModel tables;
    for (Codes::Table &table : codes.tables) tables.code(coder, std::span<i64>(table.entries));
    ValueModel().code(coder, field, codes);
    return coder.bits();
}

// Return codes with tables of the common values or with complete tables, whichever cost less.
Codes best_tables(WedgeField &field, const std::vector<i32> &full) {
    Codes found = tabled(full, field.channels(), false), complete = tabled(full, field.channels(), true);
    std::size_t entries = 0;
    for (const Codes::Table &table : complete.tables) entries += table.entries.size();
    if (static_cast<double>(entries) > most_tabled * static_cast<double>(full.size())) return found;
    return cost_of(field, complete) < cost_of(field, found) ? complete : found;
}

// The decoded parts of an attribute.
struct Decoded {
    i64 rows = 0;
    std::optional<std::vector<i32>> indices;
    Channels channels;      // measured values or labels
    std::vector<u8> bytes;  // raw values
};

// Codes the attributes of all objects one after another, so that each benefits from the statistics of those before.
template <Mode mode> class AttributeCoder {
public:
    // Memory of decoded data is counted in `taken`.
    AttributeCoder(RangeCoder<mode> &coder, TakenMemory &taken)
        : coder_(coder), taken_(taken), for_a_while_(taken.another()) {}

    i64 code_count(i64 attributes) { return number(of_part, attributes); }

    // Code one attribute: `plan` when encoding; return the decoded attribute when decoding.
    Attribute code(AttributeMesh &mesh, const AttributePlan &plan) {
        const AttributeHead head = code_head(plan.head);
        const Domain domain = static_cast<Domain>(head.domain);
        const i64 count = domain == Domain::object ? head.elements : mesh.count_of(domain);
        const i64 rows = head.rule == listed ? head.rows : head.rule == by_vertex ? mesh.polygons().vertices : count;
        make_room(mesh, head, count, rows);
        Decoded decoded;
        AttributeElements elements = mesh.elements_of(domain, count);
        if (head.rule == listed) {
            std::vector<i32> indices = code_integers(of_rows, mesh, elements, plan.indices, -1, rows - 1, "an index");
            std::vector<i32> of_corner = std::move(elements.of_corner);
            for (i32 &element : of_corner) {
                if (element >= 0) element = indices[element];
            }
            elements = AttributeElements(std::move(of_corner), rows);
            decoded.indices = std::move(indices);
        } else if (head.rule == by_vertex) {
            elements = mesh.elements_of(Domain::vertex, rows);
            decoded.indices.emplace(mesh.face_corners().begin(), mesh.face_corners().end());
        }
        decoded.rows = rows;
        code_values(mesh, head, elements, plan, decoded);
        if constexpr (mode == Mode::decode) return attribute_of(mesh, head, std::move(decoded));
        return {};
    }

private:
    enum Field {
        of_part,
        of_domain,
        of_kind,
        of_columns,
        of_rule,
        of_elements,
        of_listed,
        of_labels,
        of_shift,
        of_scale,
        of_divisor,
        of_complete,
        of_table,
        fields
    };
    enum Use { of_rows, of_fans, of_integers, of_channels, uses };

    i64 number(Field field, i64 value) { return numbers_[field].code(coder_, value); }

    std::string text(std::string_view value) {
        return texts_.code_text(coder_, value, [this](i64 size) { taken_.take(size, "long texts"); });
    }

    AttributeHead code_head(const AttributeHead &head) {
        AttributeHead found;
        found.name = text(head.name);
        found.domain = number(of_domain, head.domain);
        found.kind = number(of_kind, head.kind);
        found.columns = number(of_columns, head.columns);
        found.rule = number(of_rule, head.rule);
        if (!found.is_possible()) throw CorruptError("has an attribute of an unknown kind");
        if (static_cast<Domain>(found.domain) == Domain::object) found.elements = number(of_elements, head.elements);
        if (found.rule == listed) found.rows = number(of_listed, head.rows);
        const i64 labels = number(of_labels, static_cast<i64>(head.labels.size()));
        for (i64 label = 0; label < labels; ++label) {
            if constexpr (mode == Mode::decode) {
                taken_.take(bytes_per_label, "long texts");
                found.labels.push_back(text(""));
            } else {
                found.labels.push_back(text(head.labels[label]));
            }
        }
        return found;
    }

    void make_room(const AttributeMesh &mesh, const AttributeHead &head, i64 count, i64 rows) {
        const i64 largest = most(count, rows);
        const std::string what = "an attribute of " + std::to_string(largest) + " rows";
        if (most(largest, head.columns) > most_rows) {
            throw CorruptError("has " + what + " and " + std::to_string(head.columns) + " columns");
        }
        if constexpr (mode == Mode::decode) {
            const i64 numbers = product(largest, head.channels()), indices = head.rule == not_indexed ? 0 : count;
            taken_.take(bytes_per_attribute + product(numbers, head.kind > raw ? 8 : 4) + 4 * indices, what);
            const i64 peak = bytes_per_corner * mesh.corners() + bytes_per_element * largest;
            for_a_while_.keep(0);
            for_a_while_.take(peak + product(numbers, bytes_per_number), what);
        }
        coder_.check_not_ended();
    }

    // Code the values of all elements.
    void code_values(AttributeMesh &mesh, const AttributeHead &head, const AttributeElements &elements,
                     const AttributePlan &plan, Decoded &decoded) {
        const i64 count = elements.count();
        if (head.kind >= raw) {
            decoded.bytes = code_raw(plan.bytes, count * head.channels(), bytes_of(head.type()));
        } else if (head.kind == floats || head.kind == colours) {
            code_channels(mesh, head, elements, plan, decoded.channels);
        } else if (head.kind == fans) {
            const Wedges wedges = code_wedges(of_fans, mesh, mesh.by_vertex(), elements, false, plan.channels.codes);
            decoded.channels.codes = fan_numbers(mesh.face_corners(), wedges.of_element);
        } else {
            const bool is_byte = head.kind == flags;
            decoded.channels.codes =
                code_integers(of_integers, mesh, elements, plan.channels.codes, is_byte ? 0 : -largest_code - 1,
                              is_byte ? 255 : largest_code, "an integer");
        }
    }

    // Arrange the first bytes of all values, then the second bytes, and so on: similar bytes compress together.
    std::vector<u8> code_raw(std::span<const u8> values, i64 count, i64 size) {
        std::vector<u8> planes(count * size);
        const auto place = [&](i64 at) { return at % size * count + at / size; };
        if constexpr (mode != Mode::decode) {
            for (i64 at = 0; at < count * size; ++at) planes[place(at)] = values[at];
        }
        if (!bytes_) bytes_.emplace(false);
        bytes_->code_bytes(coder_, std::span<u8>(planes));
        std::vector<u8> found(planes.size());
        for (i64 at = 0; at < count * size; ++at) found[at] = planes[place(at)];
        return found;
    }

    Wedges code_wedges(Use use, AttributeMesh &mesh, const CornerTable &corners, const AttributeElements &elements,
                       bool has_runs, std::span<const i32> wanted) {
        Wedges wedges = wedges_[use].code(coder_, mesh, corners, elements, has_runs, wanted);
        if (!elements.corners.empty()) {
            mesh.earlier.resize(elements.of_corner.size());
            for (std::size_t corner = 0; corner < mesh.earlier.size(); ++corner) {
                const i32 element = elements.of_corner[corner];
                mesh.earlier[corner] = element < 0 ? -1 : wedges.of_element[element];
            }
        }
        return wedges;
    }

    // Code integers for all elements; CorruptError if one is below `lowest` or above `highest`.
    std::vector<i32> code_integers(Use use, AttributeMesh &mesh, const AttributeElements &elements,
                                   std::span<const i32> wanted, i64 lowest, i64 highest, const char *what) {
        const Wedges wedges = code_wedges(use, mesh, mesh.by_point(), elements, true, wanted);
        std::vector<i64> numbers(wedges.count());
        if constexpr (mode != Mode::decode) {
            for (std::size_t wedge = 0; wedge < numbers.size(); ++wedge) numbers[wedge] = wanted[wedges.first[wedge]];
        }
        lists_[use].code(coder_, std::span<i64>(numbers));
        if (std::any_of(numbers.begin(), numbers.end(), [&](i64 each) { return each < lowest || each > highest; })) {
            throw CorruptError(std::string("has ") + what + " out of range");
        }
        std::vector<i32> found;
        found.reserve(wedges.of_element.size());
        for (const i32 wedge : wedges.of_element) found.push_back(static_cast<i32>(numbers[wedge]));
        return found;
    }

    void code_channels(AttributeMesh &mesh, const AttributeHead &head, const AttributeElements &elements,
                       const AttributePlan &plan, Channels &decoded) {
        const int channels = static_cast<int>(head.channels());
        Scales scales = code_scales(head, plan.channels.scales);
        std::vector<i32> wanted;
        if constexpr (mode != Mode::decode) wanted = number_rows(plan.channels.codes, channels).of;
        const Wedges wedges = code_wedges(of_channels, mesh, mesh.by_point(), elements, false, wanted);
        auto field = std::make_unique<WedgeField>(mesh, elements, wedges, scales);
        Codes codes;
        if constexpr (mode == Mode::decode) {
            codes.codes.resize(wedges.count() * channels);
            codes.tables.resize(channels);
        } else {
            codes = best_tables(*field, rows_of(plan.channels.codes, channels, wedges.first));
        }
        for (Codes::Table &table : codes.tables) code_table(table, field->count());
        values_[{head.kind, channels}].code(coder_, *field, codes);
        if (!elements.corners.empty()) mesh.measured = std::move(field);
        if constexpr (mode == Mode::decode) {
            decoded = {rows_of(codes.full(), channels, wedges.of_element), std::move(scales)};
            const auto is_no_byte = [](i32 code) { return code < 0 || code > 255; };
            if (head.kind == colours && std::any_of(decoded.codes.begin(), decoded.codes.end(), is_no_byte)) {
                throw CorruptError("has a byte out of range");
            }
        }
    }

    Scales code_scales(const AttributeHead &head, const Scales &given) {
        if (head.kind == colours) return byte_scales(static_cast<int>(head.channels()));
        constexpr i64 offset = largest_shift + 1;  // makes a shift, which may be negative, positive
        const i64 shift = number(of_shift, given.shift + offset) - offset;
        if (size_of(shift) > largest_shift) throw CorruptError("has a unit out of range");
        Scales found;
        found.shift = static_cast<int>(shift);
        for (i64 k = 0; k < head.channels(); ++k) {
            const Scale wanted = mode == Mode::decode ? Scale{} : given.of_channel[k];
            Scale scale{static_cast<Scale::Kind>(number(of_scale, wanted.kind)), 1};
            if (scale.kind != Scale::place) scale.divisor = number(of_divisor, wanted.divisor);
            if (scale.kind > Scale::place || scale.divisor < 1 || scale.divisor > largest_code) {
                throw CorruptError("has an unknown scale");
            }
            if (scale.kind != Scale::place && (shift < 0 || shift > linear_bits)) {
                throw CorruptError("has a unit out of range");
            }
            found.of_channel.push_back(scale);
        }
        return found;
    }

    void code_table(Codes::Table &table, i64 wedges) {
        table.is_complete = number(of_complete, table.is_complete) != 0;
        const i64 size = number(of_table, static_cast<i64>(table.entries.size()));
        if constexpr (mode == Mode::decode) {
            for_a_while_.take(8 * size, "a table of " + std::to_string(size) + " values");
            table.entries.resize(size);
        }
        constexpr const char *broken = "has a table that does not fit its values";
        try {
            tables_.code(coder_, std::span<i64>(table.entries));
        } catch (const CorruptError &) {
            throw CorruptError(broken);
        }
        if (size > 0 && (table.entries.front() < -largest_code - 1 || table.entries.back() > largest_code)) {
            throw CorruptError(broken);
        }
        if (table.is_complete && size == 0 && wedges > 0) throw CorruptError("has a table without values");
    }

    static Attribute attribute_of(const AttributeMesh &mesh, const AttributeHead &head, Decoded &&decoded) {
        Attribute found;
        found.name = head.name;
        found.domain = static_cast<Domain>(head.domain);
        found.type = head.type();
        found.columns = head.columns;
        found.labels = head.labels;
        found.indices = std::move(decoded.indices);
        found.rows = decoded.rows;
        std::vector<i32> &codes = decoded.channels.codes;
        const i64 channels = head.channels();
        if (head.rule >= first_used) {
            Numbered rows = number_by_use(mesh, found.domain, head.rule, codes, static_cast<int>(channels));
            codes = rows_of(codes, channels, rows.first);
            found.rows = static_cast<i64>(rows.first.size());
            found.indices = std::move(rows.of);
        }
        if (head.kind >= raw) {
            found.values = std::move(decoded.bytes);
        } else if (found.type == ValueType::uint8) {
            found.values.assign(codes.begin(), codes.end());
        } else {
            if (head.kind == floats) {
                for (std::size_t at = 0; at < codes.size(); ++at) {
                    const Scale &scale = decoded.channels.scales.of_channel[at % channels];
                    codes[at] = std::bit_cast<i32>(scale.value_of(codes[at]));
                }
            }
            found.values.resize(4 * codes.size());
            if (!codes.empty()) std::memcpy(found.values.data(), codes.data(), found.values.size());
        }
        return found;
    }

    RangeCoder<mode> &coder_;
    TakenMemory &taken_;
    TakenMemory for_a_while_;  // taken while one attribute is decoded
    std::array<NumberModel, fields> numbers_;
    TextModel texts_{true};
    std::optional<TextModel> bytes_;
    std::array<WedgeModel, uses> wedges_;
    AscendingModel tables_;
    // These models are large, so they are made on first use.
    std::map<Use, StepModel> lists_;
    std::map<std::pair<i64, int>, ValueModel> values_;  // by kind of values and number of channels
};

}  // namespace

std::vector<u8> encode_attributes(std::span<const AttributedPart> parts, std::span<const GridPoint> grid,
                                  const AttributeSettings &settings) {
    RangeCoder<Mode::encode> coder;
    TakenMemory not_counted;
    AttributeCoder<Mode::encode> attributes(coder, not_counted);
    for (const AttributedPart &part : parts) {
        const std::size_t vertices = static_cast<std::size_t>(part.connectivity.vertices);
        AttributeMesh mesh(part.connectivity, grid.first(vertices));
        grid = grid.subspan(vertices);
        attributes.code_count(static_cast<i64>(part.attributes.size()));
        for (const AttributeView &attribute : part.attributes)
            attributes.code(mesh, plan_of(attribute, mesh, settings));
    }
    return coder.finish();
}

std::vector<std::vector<Attribute>> decode_attributes(std::span<const u8> data, std::span<const ConnectivityView> parts,
                                                      std::span<const GridPoint> grid, TakenMemory &taken) {
    RangeCoder<Mode::decode> coder(data);
    std::vector<std::vector<Attribute>> found;
    try {
        AttributeCoder<Mode::decode> attributes(coder, taken);
        for (const ConnectivityView &part : parts) {
            const std::size_t vertices = static_cast<std::size_t>(part.vertices);
            AttributeMesh mesh(part, grid.first(vertices));
            grid = grid.subspan(vertices);
            std::vector<Attribute> &of_part = found.emplace_back();
            const i64 count = attributes.code_count(0);
            for (i64 each = 0; each < count; ++each) of_part.push_back(attributes.code(mesh, {}));
        }
        if (!coder.is_finished()) throw CorruptError("does not end with its contents");
    } catch (const CorruptError &error) {
        throw CorruptError(Section("ATTR"),
                           std::string(error.what()) + ", at its byte " + std::to_string(coder.byte()));
    }
    return found;
}

}  // namespace pdeanim
