#include "text/obj.hpp"

#include <cstring>
#include <limits>

namespace pdeanim::text {

namespace {

// Nothing: a blank line or a comment.
enum class Line { other, vertex, texture, normal, face, line, point, library, nothing };

constexpr i64 most_index_digits = 10;  // 2^31 has ten digits; longer indices are refused before they overflow
constexpr int most_vertex_extras = 4, most_texture_numbers = 3, most_normal_numbers = 3;

// Return whether the tokens of a line end at a byte: a line feed, or the start of a comment.
constexpr bool ends_tokens(u8 byte) { return byte == '\n' || byte == '#'; }

constexpr bool ends_token(u8 byte) { return byte == '\n' || is_blank(byte); }

const u8 *skip_blanks(const u8 *at) {
    while (is_blank(*at)) ++at;
    return at;
}

const u8 *skip_token(const u8 *at) {
    while (!ends_token(*at)) ++at;
    return at;
}

const u8 *next_line(const u8 *at, const u8 *end) {
    return static_cast<const u8 *>(std::memchr(at, '\n', end - at)) + 1;
}

// Return the kind of the line whose first token starts at `at`.
Line kind_of(const u8 *at, const u8 *end) {
    const u8 first = *at;
    if (ends_tokens(first)) return Line::nothing;
    const u8 second = at[1], third = at + 2 < end ? at[2] : '\n';  // a line feed ends the text
    if (ends_token(second)) {
        if (first == 'v') return Line::vertex;
        if (first == 'f') return Line::face;
        if (first == 'l') return Line::line;
        if (first == 'p') return Line::point;
    } else if (first == 'v' && ends_token(third)) {
        if (second == 't') return Line::texture;
        if (second == 'n') return Line::normal;
    } else if (first == 'm' && second == 't') {
        return Line::library;
    }
    return Line::other;
}

struct Index {
    i64 value;
    const u8 *end;
    bool is_sound;
};

// Read an index as it is written.
Index read_index(const u8 *at) {
    const bool is_negative = *at == '-';
    if (is_negative) ++at;
    i64 value = 0, digits = 0;
    for (; *at >= '0' && *at <= '9' && digits <= most_index_digits; ++digits) value = value * 10 + (*at++ - '0');
    return {is_negative ? -value : value, at, digits > 0 && digits <= most_index_digits};
}

// Return an index that counts from 0. OBJ counts from 1, or back from the last element so far.
constexpr i64 from_zero(i64 index, i64 so_far) { return index > 0 ? index - 1 : so_far + index; }

}  // namespace

class ObjScan::Reading {
public:
    Reading(ObjScan &scan, std::span<const u8> text)
        : scan_(scan), first_(text.data()), end_(text.data() + text.size()) {}

    void run() {
        count();
        for (const u8 *at = first_; at < end_ && scan_.fault == ObjFault::none;) {
            const u8 *start = skip_blanks(at);
            at = next_line(start, end_);
            read_line(start, kind_of(start, end_));
        }
        scan_.unread.insert(scan_.unread.end(), unread_textures_.begin(), unread_textures_.end());
        scan_.unread.insert(scan_.unread.end(), unread_normals_.begin(), unread_normals_.end());
    }

private:
    // Count vertices first: faces may use vertices that come later.
    void count() {
        i64 normals = 0;
        for (const u8 *at = first_; at < end_;) {
            at = skip_blanks(at);
            const Line kind = kind_of(at, end_);
            scan_.vertex_count += kind == Line::vertex;
            scan_.texture_count += kind == Line::texture;
            normals += kind == Line::normal;
            at = next_line(at, end_);
        }
        scan_.positions.reserve(3 * scan_.vertex_count);
        scan_.vertex_sizes.reserve(scan_.vertex_count);
        scan_.textures.reserve(most_texture_numbers * scan_.texture_count);
        scan_.normals.reserve(most_normal_numbers * normals);
    }

    void fail(ObjFault fault, const u8 *at) {
        scan_.fault = fault;
        scan_.fault_byte = at - first_;
    }

    void read_line(const u8 *start, Line kind) {
        switch (kind) {
            case Line::vertex: return read_vertex(start);
            case Line::texture: return read_texture(start);
            case Line::normal:
                read_numbers(skip_token(start), 3, most_normal_numbers, scan_.normals, unread_normals_);
                return;
            case Line::face:
            case Line::line:
            case Line::point: return read_element(start, kind);
            case Line::library:
            case Line::other: scan_.others.insert(scan_.others.end(), {start - first_, vertices(), elements()}); return;
            case Line::nothing: return;
        }
    }

    i64 vertices() const { return static_cast<i64>(scan_.vertex_sizes.size()); }
    i64 elements() const { return static_cast<i64>(scan_.element_sizes.size()); }

    // Append the first `most` numbers of a line, with 0 for missing ones; return how many numbers the line has.
    i64 read_numbers(const u8 *at, i64 array, int most, std::vector<float> &numbers,
                     std::vector<UnreadNumber> &unread) {
        i64 tokens = 0;
        for (at = skip_blanks(at); !ends_tokens(*at); at = skip_blanks(skip_token(at))) {
            if (tokens++ >= most) continue;
            const ReadNumber found = read_number(at);
            if (!found.is_certain) unread.push_back({array, static_cast<i64>(numbers.size()), at - first_});
            numbers.push_back(found.value);
            at = found.end;
        }
        for (i64 missing = tokens; missing < most; ++missing) numbers.push_back(0.0f);
        return tokens;
    }

    void read_vertex(const u8 *start) {
        const u8 *at = skip_blanks(start + 1);
        int coordinates = 0;
        for (; coordinates < 3 && !ends_tokens(*at); ++coordinates) {
            const ReadNumber found = read_number(at);
            if (!found.is_certain) scan_.unread.push_back({0, static_cast<i64>(scan_.positions.size()), at - first_});
            scan_.positions.push_back(found.value);
            at = skip_blanks(skip_token(found.end));
        }
        i64 extras = 0;
        if (!ends_tokens(*at) || !scan_.vertex_extras.empty()) {
            scan_.vertex_extras.resize(most_vertex_extras * vertices());
            extras = read_numbers(at, 1, most_vertex_extras, scan_.vertex_extras, scan_.unread);
        }
        if (coordinates < 3 || extras == 2 || extras > most_vertex_extras) {
            return fail(ObjFault::bad_coordinates, start);
        }
        scan_.vertex_sizes.push_back(static_cast<i32>(3 + extras));
    }

    void read_texture(const u8 *start) {
        const i64 size = read_numbers(skip_token(start), 2, most_texture_numbers, scan_.textures, unread_textures_);
        if (size < 1 || size > most_texture_numbers) return fail(ObjFault::bad_coordinates, start);
        scan_.texture_size = most(scan_.texture_size, static_cast<i32>(size));
        ++textures_;
    }

    void read_element(const u8 *start, Line kind) {
        i32 size = 0;
        for (const u8 *at = skip_blanks(start + 1); !ends_tokens(*at); ++size) {
            const u8 *corner = at;
            const ObjFault fault = read_corner(at);
            if (fault != ObjFault::none) return fail(fault, corner);
            if (kind == Line::point) add_element(kind, 1);
            at = skip_blanks(at);
        }
        const i32 least = kind == Line::face ? 3 : kind == Line::line ? 2 : 1;
        if (size < least) return fail(ObjFault::too_few_corners, start);
        if (kind != Line::point) add_element(kind, size);
    }

    void add_element(Line kind, i32 size) {
        scan_.is_face.push_back(kind == Line::face);
        scan_.element_sizes.push_back(size);
    }

    // Read one v, v/vt, v//vn or v/vt/vn, and move past it.
    ObjFault read_corner(const u8 *&at) {
        i64 vertex, texture = -1, normal = -1;
        ObjFault fault = read_reference(at, vertices(), vertex);
        if (fault != ObjFault::none) return fault;
        if (*at == '/') {
            ++at;
            if ((*at >= '0' && *at <= '9') || *at == '-') {
                fault = read_reference(at, textures_, texture);
                if (fault != ObjFault::none) return fault;
                if (texture < 0) return ObjFault::texture_outside;
            }
            if (*at == '/') {
                ++at;
                if (!ends_token(*at)) {
                    fault = read_reference(at, static_cast<i64>(scan_.normals.size()) / most_normal_numbers, normal);
                    if (fault != ObjFault::none) return fault;
                    // A normal that the file does not list is kept: it may still distinguish corners.
                    normal = clamp<i64>(normal, -1, std::numeric_limits<i32>::max());
                }
            }
        }
        if (!ends_token(*at)) return ObjFault::bad_index;
        if (vertex < 0 || vertex >= scan_.vertex_count) return ObjFault::index_outside;
        if (texture >= scan_.texture_count) return ObjFault::texture_outside;
        scan_.corners.insert(scan_.corners.end(),
                             {static_cast<i32>(vertex), static_cast<i32>(texture), static_cast<i32>(normal)});
        return ObjFault::none;
    }

    static ObjFault read_reference(const u8 *&at, i64 so_far, i64 &number) {
        const Index index = read_index(at);
        at = index.end;
        if (!index.is_sound) return ObjFault::bad_index;
        if (index.value == 0) return ObjFault::zero_index;
        number = from_zero(index.value, so_far);
        return ObjFault::none;
    }

    ObjScan &scan_;
    const u8 *first_, *end_;
    i64 textures_ = 0;
    std::vector<UnreadNumber> unread_textures_, unread_normals_;
};

ObjScan::ObjScan(std::span<const u8> text) { Reading(*this, text).run(); }

namespace {

// Return whether a line must be the same in every frame.
constexpr bool is_structure(Line kind) {
    return kind == Line::face || kind == Line::line || kind == Line::point || kind == Line::other;
}

// Compares the lines of a frame, one after another, with bytes of the first frame.
class Compared {
public:
    explicit Compared(std::span<const u8> first) : left_(first) {}

    // Return whether the next bytes of the first frame equal those from `at` to `end`.
    bool continues(const u8 *at, const u8 *end) {
        const std::size_t size = end - at;
        if (size > left_.size() || std::memcmp(left_.data(), at, size) != 0) return false;
        left_ = left_.subspan(size);
        return true;
    }

    bool is_whole() const { return left_.empty(); }

private:
    std::span<const u8> left_;
};

}  // namespace

ObjStructure::ObjStructure(std::span<const u8> text) {
    const u8 *end = text.data() + text.size();
    u32 vertices = 0, textures = 0;
    for (const u8 *at = text.data(); at < end;) {
        const u8 *start = skip_blanks(at);
        const Line kind = kind_of(start, end);
        at = next_line(start, end);
        if (kind == Line::vertex) {
            ++vertices;
            const u8 *rest = start + 1;
            for (int axis = 0; axis < 3; ++axis) rest = skip_token(skip_blanks(rest));
            data_[0].insert(data_[0].end(), rest, at);
        } else if (kind == Line::texture || kind == Line::library) {
            textures += kind == Line::texture;
            std::vector<u8> &own = data_[kind == Line::texture ? 1 : 2];
            own.insert(own.end(), start, at);
        } else if (is_structure(kind)) {
            before_.emplace_back(vertices, textures);
            lines_.insert(lines_.end(), start, at);
        }
    }
}

std::optional<u32> ObjStructure::read_positions(std::span<const u8> text, std::span<float> positions,
                                                std::vector<UnreadNumber> &unread) const {
    const u8 *end = text.data() + text.size();
    std::size_t found = 0, lines = 0;
    u32 textures = 0;
    Compared structure(lines_);
    std::array<Compared, obj_data_kinds> data{Compared(data_[0]), Compared(data_[1]), Compared(data_[2])};
    u32 changed = 0;
    for (const u8 *at = text.data(); at < end;) {
        at = skip_blanks(at);
        const Line kind = kind_of(at, end);
        const u8 *next;
        if (kind == Line::vertex) {
            if (found == positions.size()) return std::nullopt;
            ++at;
            for (int axis = 0; axis < 3; ++axis) {
                at = skip_blanks(at);
                const ReadNumber number = read_number(at);
                if (!number.is_certain) unread.push_back({0, static_cast<i64>(found), at - text.data()});
                positions[found++] = number.value;
                at = number.end;
                while (*at > ' ') ++at;
            }
            next = next_line(at, end);
            changed |= u32{!data[0].continues(at, next)};
        } else {
            next = next_line(at, end);
            if (kind == Line::texture || kind == Line::library) {
                textures += kind == Line::texture;
                const int own = kind == Line::texture ? 1 : 2;
                changed |= u32{!data[own].continues(at, next)} << own;
            } else if (is_structure(kind)) {
                const std::pair before{static_cast<u32>(found / 3), textures};
                if (lines == before_.size() || before_[lines] != before) return std::nullopt;
                ++lines;
                if (!structure.continues(at, next)) return std::nullopt;
            }
        }
        at = next;
    }
    if (found != positions.size() || lines != before_.size()) return std::nullopt;
    for (int kind = 0; kind < obj_data_kinds; ++kind) changed |= u32{!data[kind].is_whole()} << kind;
    return changed;
}

}  // namespace pdeanim::text
