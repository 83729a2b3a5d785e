#include "base/memory_limit.hpp"

#include <string>
#include <utility>

#include "base/errors.hpp"

namespace pdeanim {

void MemoryLimit::take(u64 bytes, std::string_view what) {
    u64 left = left_;
    do {
        if (bytes > left) {
            throw LimitError("declares " + std::string(what) + ", about " + std::to_string(bytes_ - left + bytes) +
                             " bytes to decode; the limit is " + std::to_string(bytes_) +
                             "; raise it if you trust the file");
        }
    } while (!left_.compare_exchange_weak(left, left - bytes));
}

TakenMemory::TakenMemory(TakenMemory &&other) noexcept
    : limit_(std::exchange(other.limit_, nullptr)), bytes_(other.bytes_.exchange(0)) {}

TakenMemory &TakenMemory::operator=(TakenMemory &&other) noexcept {
    give_back(bytes_);
    limit_ = std::exchange(other.limit_, nullptr);
    bytes_ = other.bytes_.exchange(0);
    return *this;
}

void TakenMemory::take(u64 bytes, std::string_view what) {
    if (!limit_) return;
    limit_->take(bytes, what);
    bytes_ += bytes;
}

void TakenMemory::give_back(u64 bytes) {
    if (!limit_) return;
    bytes_ -= bytes;
    limit_->give_back(bytes);
}

}  // namespace pdeanim
