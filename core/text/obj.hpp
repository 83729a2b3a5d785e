// The text of OBJ files: decimal numbers to float32 and back (decimals.cpp), and the contents of frames (obj.cpp).
//
// A first frame is read in full, later frames only where they may differ from the first. All text ends with a line feed
// and has no continued lines. Numbers that are not plain decimals, or whose float32 is not certain, are returned as
// unread: the caller reads them.
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
// token is not a plain decimal, the reader says so, and the caller must read the token. Writing gives the fewest
// decimal digits that read back to the same float32. Neither uses std::from_chars or std::to_chars, which some standard
// libraries lack for floating point, so texts are the same everywhere.

// Return whether a byte separates tokens within a line.
constexpr bool is_blank(u8 byte) { return byte == ' ' || (byte >= '\t' && byte <= '\r' && byte != '\n'); }

struct ReadNumber {
    float value;
    bool is_certain;  // if false, the caller must read the token
    const u8 *end;    // where reading stopped, at most the end of the token
};

// Read the number whose token starts at `at`. A blank or a line feed must follow the token.
ReadNumber read_number(const u8 *at);

// Write lines of `word number number ...`, each with `columns` finite numbers. Returns nothing if a number, which is
// then subnormal, is not certain to read back from nine digits.
std::optional<std::vector<u8>> write_rows(std::span<const float> numbers, std::size_t columns, std::string_view word);

// A number that the core leaves to the caller.
struct UnreadNumber {
    i64 array, place;  // array: in the order of declaration in ObjScan; place: index in that array
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

// Contents of one file, in the order of the file.
struct ObjScan {
    explicit ObjScan(std::span<const u8> text);

    std::vector<float> positions;  // the first three numbers of each v line
    std::vector<float>
        vertex_extras;              // the next four, 0 if missing: w, r g b, or r g b a; empty if all v lines lack them
    std::vector<float> textures;    // three numbers of each vt line, 0 for missing ones
    std::vector<float> normals;     // three numbers of each vn line
    std::vector<i32> vertex_sizes;  // how many numbers each v line has
    i32 texture_size = 0;           // largest number of numbers on a vt line
    std::vector<u8> is_face;        // 1 for each element that is a face; the others are lines and points
    std::vector<i32> element_sizes;  // number of corners of each element
    std::vector<i32> corners;        // vertex, texture vertex and normal of each corner, from 0; -1 if it has none
    std::vector<i64> others;  // for every other statement: its byte, and how many vertices and elements precede it
    std::vector<UnreadNumber> unread;  // in the order in which they must be read

    // The first fault, and its byte. Nothing after it is read.
    ObjFault fault = ObjFault::none;
    i64 fault_byte = 0;
    i64 vertex_count = 0, texture_count = 0;  // number of v and vt lines in the whole file

private:
    class Reading;
};

// Number of kinds of data that may change between frames, besides positions: the numbers after the position on v lines,
// vt lines, and mtllib lines.
constexpr int obj_data_kinds = 3;

// The lines that must be the same in every frame: all except numbers, comments and mtllib, which exporters name by
// frame.
class ObjStructure {
public:
    explicit ObjStructure(std::span<const u8> text);

    // Read the positions of another frame, three numbers per vertex. Return, as bits, which of the kinds of data differ
    // from the first frame, byte for byte. Return nothing if the number of vertices or the structure differs; positions
    // are then unfinished.
    std::optional<u32> read_positions(std::span<const u8> text, std::span<float> positions,
                                      std::vector<UnreadNumber> &unread) const;

private:
    std::vector<u8> lines_;
    std::array<std::vector<u8>, obj_data_kinds> data_;
    std::vector<std::pair<u32, u32>> before_;  // vertices and texture vertices before each line, for relative indices
};

}  // namespace pdeanim::text
