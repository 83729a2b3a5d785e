#include "decode/decoded_cache.hpp"

namespace pdeanim {

const DecodedCache::Part *DecodedCache::find(const Key &key) {
    const auto found = places_.find(key);
    if (found == places_.end()) return nullptr;
    std::list<Kept> &parts = parts_like(key);
    parts.splice(parts.begin(), parts, found->second);
    return &parts.front().part;
}

const DecodedCache::Part &DecodedCache::keep(const Key &key, Part part, u64 bytes, TakenMemory taken) {
    if (was_evicted(key)) budget_ = least(2 * budget_, largest_budget_);
    bytes_ += bytes;
    std::list<Kept> &parts = parts_like(key);
    parts.push_front({key, std::move(part), bytes, std::move(taken)});
    places_[key] = parts.begin();
    if (frames_.size() > most_frames) evict_oldest(frames_);
    const std::size_t new_frames = key.kind == field_frame ? 1 : 0;
    while (bytes_ > budget_ && places_.size() > 1) evict_oldest(frames_.size() > new_frames ? frames_ : others_);
    return parts.front().part;
}

void DecodedCache::make_room(u64 bytes) {
    while (limit_.left() < bytes && !is_empty()) evict_oldest();
}

TakenMemory DecodedCache::take(u64 bytes, std::string_view what) {
    make_room(bytes);
    return TakenMemory(limit_, bytes, what);
}

void DecodedCache::clear() {
    while (!is_empty()) evict_oldest();
}

bool DecodedCache::was_evicted(const Key &key) const {
    const auto found = evicted_.find({key.kind, key.field});
    return found != evicted_.end() && key.number < found->second.size() && found->second[key.number];
}

void DecodedCache::evict_oldest(std::list<Kept> &parts) {
    const Kept &oldest = parts.back();
    if (oldest.key.kind != field_frame) {
        std::vector<bool> &evicted = evicted_[{oldest.key.kind, oldest.key.field}];
        if (evicted.size() <= oldest.key.number) evicted.resize(oldest.key.number + 1);
        evicted[oldest.key.number] = true;
    }
    bytes_ -= oldest.bytes;
    places_.erase(oldest.key);
    parts.pop_back();
}

}  // namespace pdeanim
