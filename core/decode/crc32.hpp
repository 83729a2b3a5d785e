// CRC-32 as in zlib and PNG (ISO 3309): polynomial 0xEDB88320, reflected. Eight bytes a step, by eight tables.
#pragma once

#include <array>
#include <span>

#include "base/arithmetic.hpp"

namespace pdeanim {

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

// Checksum of `data` after bytes whose checksum is `before`.
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

// Whether a checksum is the one that was expected; always in builds that look for what damage does behind checksums.
inline bool is_checksum(u32 found, u32 expected) {
#ifdef FUZZING_BUILD_MODE_UNSAFE_FOR_PRODUCTION
    static_cast<void>(found);
    static_cast<void>(expected);
    return true;
#else
    return found == expected;
#endif
}

}  // namespace pdeanim
