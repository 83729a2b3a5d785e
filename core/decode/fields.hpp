// Reads the contents of sections: numbers of several sizes, checksums, and the limits that values must keep.
#pragma once

#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <span>
#include <string>

#include "base/arithmetic.hpp"
#include "base/errors.hpp"

namespace pdeanim {

// Reads the fields of a section: little-endian numbers, and counts with seven bits per byte. Never reads beyond the
// end.
class FieldReader {
public:
    // Read the section `name`; error messages mention the name.
    FieldReader(std::span<const u8> data, const char *name) : data_(data), name_(name) {}

    // Read an unsigned number of the size of T.
    template <class T> T integer() {
        const std::span<const u8> bytes = take(sizeof(T));
        u64 value = 0;
        for (std::size_t i = sizeof(T); i-- > 0;) value = value << 8 | bytes[i];
        return static_cast<T>(value);
    }

    // Read a finite float64.
    double real() {
        const double value = std::bit_cast<double>(integer<u64>());
        if (!std::isfinite(value)) throw CorruptError(section(), "holds a number that is not finite");
        return value;
    }

    // Read a number of 0 or more, stored as seven bits per byte, low bits first.
    i64 count() {
        u64 value = 0;
        for (int shift = 0; shift < count_bits; shift += 7) {
            const u8 byte = integer<u8>();
            value |= static_cast<u64>(byte & 127) << shift;
            if (byte < 128) return static_cast<i64>(value);
        }
        throw CorruptError(section(), "holds a count of more than " + std::to_string(count_bits) + " bits");
    }

    // Read a number of bytes.
    std::span<const u8> bytes(std::size_t size) { return take(size); }

    // Read all remaining bytes.
    std::span<const u8> rest() { return take(data_.size() - at_); }

    // Raise CorruptError if bytes remain.
    void finish() const {
        if (at_ != data_.size()) {
            throw CorruptError(section(), "has " + std::to_string(data_.size() - at_) + " bytes too many");
        }
    }

private:
    static constexpr int count_bits = 63;

    Section section() const { return Section(name_); }

    std::span<const u8> take(std::size_t size) {
        if (size > data_.size() - at_) {
            throw CorruptError(section(), "ends at its byte " + std::to_string(data_.size()) + ", " +
                                              std::to_string(size) + " more are needed");
        }
        at_ += size;
        return data_.subspan(at_ - size, size);
    }

    std::span<const u8> data_;
    const char *name_;
    std::size_t at_ = 0;
};

// Tables for CRC-32 as in zlib and PNG (ISO 3309): polynomial 0xEDB88320, reflected. Eight tables take eight bytes per
// step.
namespace crc_tables {

consteval std::array<std::array<u32, 256>, 8> make() {
    std::array<std::array<u32, 256>, 8> tables{};
    for (u32 byte = 0; byte < 256; ++byte) {
        u32 value = byte;
        for (int bit = 0; bit < 8; ++bit) value = value >> 1 ^ (value & 1 ? 0xEDB88320u : 0u);
        tables[0][byte] = value;
    }
    for (u32 byte = 0; byte < 256; ++byte) {
        for (int k = 1; k < 8; ++k) tables[k][byte] = tables[k - 1][byte] >> 8 ^ tables[0][tables[k - 1][byte] & 255];
    }
    return tables;
}

inline constexpr auto of_byte = make();

}  // namespace crc_tables

// Return the checksum of bytes followed by `data`; `before` is the checksum of these bytes.
inline u32 crc32(std::span<const u8> data, u32 before = 0) {
    const auto &table = crc_tables::of_byte;
    u32 value = ~before;
    std::size_t at = 0;
    for (; at + 8 <= data.size(); at += 8) {
        u32 next = 0;
        for (int k = 0; k < 8; ++k) {
            const u32 own = k < 4 ? value >> (8 * k) & 255 : 0;
            next ^= table[7 - k][own ^ data[at + k]];
        }
        value = next;
    }
    for (; at < data.size(); ++at) value = value >> 8 ^ table[0][(value ^ data[at]) & 255];
    return ~value;
}

// Return whether a checksum is the expected one; always true in builds that test damage behind checksums.
inline bool is_checksum(u32 found, u32 expected) {
#ifdef FUZZING_BUILD_MODE_UNSAFE_FOR_PRODUCTION
    static_cast<void>(found);
    static_cast<void>(expected);
    return true;
#else
    return found == expected;
#endif
}

// Limits on values that hold in all parts of the format.
namespace limits {

// Positions end at 2^128, so products with the step stay far from overflow.
inline constexpr double largest_step = 0x1p160;
inline constexpr double largest_rate = 12.0;    // largest rate in Eqs. 12, 14 and 16 over a half-range of 1
inline constexpr i64 most_group_frames = 4096;  // bounded because an encoder holds a whole group in memory

}  // namespace limits

}  // namespace pdeanim
