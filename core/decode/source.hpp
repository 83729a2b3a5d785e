// Where the bytes of a file come from: memory, or whatever a caller's function reads them from.
#pragma once

#include <algorithm>
#include <functional>
#include <mutex>
#include <span>
#include <vector>

#include "base/arithmetic.hpp"

namespace pdeanim {

class Source {
public:
    virtual ~Source() = default;

    u64 size() const { return size_; }

    // Bytes of the file, as many as there are from `offset` on, at most those of `into`; returns how many.
    virtual std::size_t read(u64 offset, std::span<u8> into) = 0;

protected:
    explicit Source(u64 size) : size_(size) {}

private:
    u64 size_;
};

// A whole file in memory, which must outlive the source.
class MemorySource : public Source {
public:
    explicit MemorySource(std::span<const u8> data) : Source(data.size()), data_(data) {}

    std::size_t read(u64 offset, std::span<u8> into) override {
        const u64 first = std::min<u64>(offset, data_.size());
        const std::size_t count = std::min(into.size(), data_.size() - static_cast<std::size_t>(first));
        std::copy_n(data_.data() + first, count, into.data());
        return count;
    }

private:
    std::span<const u8> data_;
};

// A file that a function reads from: (offset, into) to the number of bytes, which falls short at the end alone. Groups are
// decoded beside each other, and a file has one place that is read next: the function is called by one thread at a time.
class CallbackSource : public Source {
public:
    using Read = std::function<std::size_t(u64 offset, std::span<u8> into)>;

    CallbackSource(u64 size, Read read) : Source(size), read_(std::move(read)) {}

    std::size_t read(u64 offset, std::span<u8> into) override {
        const std::lock_guard guard(lock_);
        return read_(offset, into);
    }

private:
    Read read_;
    std::mutex lock_;
};

}  // namespace pdeanim
