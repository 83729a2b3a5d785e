// Fields of a section: little-endian numbers, and counts of seven bits a byte. The reader never goes past the end.
#pragma once

#include <bit>
#include <cmath>
#include <cstring>
#include <span>
#include <string>

#include "base/errors.hpp"

namespace pdeanim {

class FieldReader {
public:
    // Fields of section `name`, which messages call it by.
    FieldReader(std::span<const u8> data, const char *name) : data_(data), name_(name) {}

    // An unsigned number of the size of T.
    template <class T> T integer() {
        const std::span<const u8> bytes = take(sizeof(T));
        u64 value = 0;
        for (std::size_t i = sizeof(T); i-- > 0;) value = value << 8 | bytes[i];
        return static_cast<T>(value);
    }

    // A finite float64.
    double real() {
        const double value = std::bit_cast<double>(integer<u64>());
        if (!std::isfinite(value)) throw CorruptError(section() + " holds a number that is not finite");
        return value;
    }

    // A number of 0 or more, seven bits a byte, low bits first.
    i64 count() {
        u64 value = 0;
        for (int shift = 0; shift < count_bits; shift += 7) {
            const u8 byte = integer<u8>();
            value |= static_cast<u64>(byte & 127) << shift;
            if (byte < 128) return static_cast<i64>(value);
        }
        throw CorruptError(section() + " holds a count of more than " + std::to_string(count_bits) + " bits");
    }

    // All that is left.
    std::span<const u8> rest() { return take(data_.size() - at_); }

    // Refuse bytes that are left over.
    void finish() const {
        if (at_ != data_.size()) {
            throw CorruptError(section() + " has " + std::to_string(data_.size() - at_) + " bytes too many");
        }
    }

private:
    static constexpr int count_bits = 63;

    std::string section() const { return std::string("section ") + name_; }

    std::span<const u8> take(std::size_t size) {
        if (size > data_.size() - at_) {
            throw CorruptError(section() + " ends at its byte " + std::to_string(data_.size()) + ", " +
                               std::to_string(size) + " more are needed");
        }
        at_ += size;
        return data_.subspan(at_ - size, size);
    }

    std::span<const u8> data_;
    const char *name_;
    std::size_t at_ = 0;
};

}  // namespace pdeanim
