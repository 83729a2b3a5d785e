// The text of OBJ files: decimal numbers to float32 and back (decimals.cpp), and the bytes of frames (obj.cpp).
//
// A first frame is read in full, later frames only where they may differ from it. All text ends with a line feed and
// has no line continuations. Numbers that are not plain decimal, or not certain, are left to the caller, as unread.
#pragma once

#include <array>
#include <optional>
#include <span>
#include <string_view>
#include <utility>
#include <vector>

#include "base/arithmetic.hpp"

namespace pdeanim::text {

// Decimal text to float32 and back, for text formats.
//
// Reading gives float32(float64(text)) to the last bit. If double arithmetic cannot prove which float32 that is, or the
// token is not plain decimal, the reader says so, and the caller reads the token in full. Writing gives the fewest
// decimal digits that read back to the same float32. Neither uses std::from_chars or std::to_chars, which not every
// standard library has for floating point, so that texts are the same everywhere.

// Whether a byte separates tokens within a line.
constexpr bool is_blank(u8 byte) { return byte == ' ' || (byte >= '\t' && byte <= '\r' && byte != '\n'); }

struct ReadNumber {
    float value;
    bool is_certain;  // whether `value` is the token's
    const u8 *end;    // where reading stopped; not beyond the token
};

// Read the number whose token starts here. A blank or a line feed follows the token.
ReadNumber read_number(const u8 *at);

// Write lines of `word number number ...`, `columns` finite numbers each; nothing if nine digits cannot be shown to
// suffice for one, which is then a subnormal.
std::optional<std::vector<u8>> write_rows(std::span<const float> numbers, std::size_t columns, std::string_view word);

// A number that the caller must read.
struct UnreadNumber {
    i64 array, place;  // index of its array, in the order of declaration in ObjScan, and its index in that array
    i64 byte;          // where its token starts
};

enum class ObjFault {
    none,
    bad_index,
    zero_index,
    index_outside,
    texture_outside,
    too_few_corners,
    bad_coordinates,
};

// Contents of one file, in the file's order.
struct ObjScan {
    explicit ObjScan(std::span<const u8> text);

    std::vector<float> positions;      // the first three numbers of each v line
    std::vector<float> vertex_extras;  // the next four, 0 for none: w, r g b, or r g b a; empty where no line has any
    std::vector<float> textures;       // three numbers of each vt line, 0 for none
    std::vector<float> normals;        // three numbers of each vn line
    std::vector<i32> vertex_sizes;     // how many numbers each v line has
    i32 texture_size = 0;              // most numbers on a vt line
    std::vector<u8> is_face;           // 1 for each element that is a face; the others are lines and points
    std::vector<i32> element_sizes;    // corners of each
    std::vector<i32> corners;          // vertex, texture vertex and normal of each, from 0; -1 for none of the latter
    std::vector<i64> others;  // for each other statement: its byte, and how many vertices and elements stand before it
    std::vector<UnreadNumber> unread;  // in the order in which they must be read

    // The first fault and its byte; nothing after it is read.
    ObjFault fault = ObjFault::none;
    i64 fault_byte = 0;
    i64 vertex_count = 0, texture_count = 0;  // numbers of v and vt lines of the whole file

private:
    class Reading;
};

// Kinds of data of a frame besides structure and positions: the numbers after the position of a v line, vt lines,
// mtllib lines.
constexpr int obj_data_kinds = 3;

// What must be the same in every frame: all lines except numbers, comments and mtllib, which exporters name by frame.
class ObjStructure {
public:
    explicit ObjStructure(std::span<const u8> text);

    // Read the positions of another frame, three numbers each. Return, as bits, the kinds of data that differ from the
    // first frame, byte for byte. Return nothing if vertices or structure differ; positions are then unfinished.
    std::optional<u32> read_positions(std::span<const u8> text, std::span<float> positions,
                                      std::vector<UnreadNumber> &unread) const;

private:
    std::vector<u8> lines_;
    std::array<std::vector<u8>, obj_data_kinds> data_;
    std::vector<std::pair<u32, u32>> before_;  // vertices and texture vertices before each line, for relative indices
};

}  // namespace pdeanim::text
