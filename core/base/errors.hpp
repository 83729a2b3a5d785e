// Failures of the core: thrown inside, turned into status codes by the C interface and into Python's errors by the
// bindings.
//
// LimitError comes from the limit on memory: the memory that a file asks for is counted before it is allocated.
#pragma once

#include <atomic>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>

#include "base/arithmetic.hpp"

namespace pdeanim {

// Codes of pdecodec.errors.ErrorCode that a damaged file can cause.
enum class FaultCode {
    identifier,
    version,
    header_checksum,
    table,
    table_checksum,
    truncated,
    trailing_bytes,
    section_unknown_required,
    section_checksum,
    section_content,
    group_checksum,
    group_content,
};

// The four letters of a section's type.
struct Section {
    explicit Section(std::string_view type_) : type(type_) {}

    std::string_view type;
};

// The bytes are not those of an undamaged file. Holds the section, the byte of the file and the frame, if they are
// known.
struct CorruptError : std::runtime_error {
    explicit CorruptError(const std::string &message, FaultCode code_ = FaultCode::section_content, i64 offset_ = -1)
        : std::runtime_error(message), code(code_), offset(offset_) {}

    // The message begins with the section: "section CONN has bytes too many".
    CorruptError(const Section &section_, const std::string &message, FaultCode code_ = FaultCode::section_content,
                 i64 offset_ = -1)
        : std::runtime_error("section " + std::string(section_.type) + " " + message), code(code_),
          section(section_.type), offset(offset_) {}

    FaultCode code;
    std::string section;
    i64 offset, frame = -1;
};

// Decoding the bytes would take more memory than the caller's limit allows.
struct LimitError : std::runtime_error {
    using std::runtime_error::runtime_error;
};

// The caller's request cannot be fulfilled.
struct ArgumentError : std::invalid_argument {
    using std::invalid_argument::invalid_argument;
};

// The caller's read callback failed.
struct ReadError : std::runtime_error {
    using std::runtime_error::runtime_error;
};

// Number of bytes that decoding may take; several threads may share one limit.
class MemoryLimit {
public:
    explicit MemoryLimit(u64 bytes) : bytes_(bytes), left_(bytes) {}

    // Start a separate count at the bytes that another limit has left.
    MemoryLimit(const MemoryLimit &other) : bytes_(other.bytes_), left_(other.left()) {}

    u64 left() const { return left_; }

    // Take bytes permanently. LimitError if fewer are left; its message says what the bytes were for.
    void take(u64 bytes, std::string_view what) {
        u64 left = left_;
        do {
            if (bytes > left) {
                throw LimitError("declares " + std::string(what) + ", about " + std::to_string(bytes_ - left + bytes) +
                                 " bytes to decode; the limit is " + std::to_string(bytes_));
            }
        } while (!left_.compare_exchange_weak(left, left - bytes));
    }

    void give_back(u64 bytes) { left_ += bytes; }

private:
    const u64 bytes_;
    std::atomic<u64> left_;
};

// Bytes that are taken from a limit for one purpose, and returned when the object is destroyed; several threads may
// take more. An object without a limit counts nothing.
class TakenMemory {
public:
    TakenMemory() = default;
    explicit TakenMemory(MemoryLimit &limit) : limit_(&limit) {}
    TakenMemory(MemoryLimit &limit, u64 bytes, std::string_view what) : limit_(&limit) { take(bytes, what); }
    TakenMemory(TakenMemory &&other) noexcept
        : limit_(std::exchange(other.limit_, nullptr)), bytes_(other.bytes_.exchange(0)) {}
    TakenMemory &operator=(TakenMemory &&other) noexcept {
        give_back(bytes_);
        limit_ = std::exchange(other.limit_, nullptr);
        bytes_ = other.bytes_.exchange(0);
        return *this;
    }
    ~TakenMemory() { give_back(bytes_); }

    u64 bytes() const { return bytes_; }

    // Return an object under the same limit that has not taken any memory.
    TakenMemory another() const { return limit_ ? TakenMemory(*limit_) : TakenMemory(); }

    void take(u64 bytes, std::string_view what) {
        if (!limit_) return;
        limit_->take(bytes, what);
        bytes_ += bytes;
    }

    void give_back(u64 bytes) {
        if (!limit_) return;
        bytes_ -= bytes;
        limit_->give_back(bytes);
    }

    // Return all bytes except those that turned out to be needed.
    void keep(u64 bytes) {
        if (bytes < bytes_) give_back(bytes_ - bytes);
    }

private:
    MemoryLimit *limit_ = nullptr;
    std::atomic<u64> bytes_ = 0;
};

}  // namespace pdeanim
