// What a file may take of the memory, counted before it is taken.
#pragma once

#include <atomic>
#include <string_view>

#include "base/arithmetic.hpp"

namespace pdeanim {

// A number of bytes; several threads may take of it.
class MemoryLimit {
public:
    explicit MemoryLimit(u64 bytes) : bytes_(bytes), left_(bytes) {}

    // As much as is left of another one.
    MemoryLimit(const MemoryLimit &other) : bytes_(other.bytes_), left_(other.left()) {}

    u64 left() const { return left_; }

    // For good. LimitError, which says for what, where so much is not left.
    void take(u64 bytes, std::string_view what);

    void give_back(u64 bytes) { left_ += bytes; }

private:
    const u64 bytes_;
    std::atomic<u64> left_;
};

// What is taken for something, as long as that is there; several threads may take more. Without a limit nothing is counted.
class TakenMemory {
public:
    TakenMemory() = default;
    explicit TakenMemory(MemoryLimit &limit) : limit_(&limit) {}
    TakenMemory(MemoryLimit &limit, u64 bytes, std::string_view what) : limit_(&limit) { take(bytes, what); }
    TakenMemory(TakenMemory &&other) noexcept;
    TakenMemory &operator=(TakenMemory &&other) noexcept;
    ~TakenMemory() { give_back(bytes_); }

    u64 bytes() const { return bytes_; }

    // Nothing yet, of the same limit.
    TakenMemory another() const { return limit_ ? TakenMemory(*limit_) : TakenMemory(); }

    void take(u64 bytes, std::string_view what);

    void give_back(u64 bytes);

    // It has turned out that no more than so much is needed.
    void keep(u64 bytes) {
        if (bytes < bytes_) give_back(bytes_ - bytes);
    }

private:
    MemoryLimit *limit_ = nullptr;
    std::atomic<u64> bytes_ = 0;
};

}  // namespace pdeanim
