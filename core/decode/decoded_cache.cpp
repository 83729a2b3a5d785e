#include "decode/field_cache.hpp"

namespace pdeanim {

const FieldCache::Part *FieldCache::find(const Key &key) {
    const auto found = places_.find(key);
    if (found == places_.end()) return nullptr;
    std::list<Kept> &parts = parts_like(key);
    parts.splice(parts.begin(), parts, found->second);
    return &parts.front().part;
}

TakenMemory FieldCache::take(u64 bytes, std::string_view what) {
    while (limit_.left() < bytes && !is_empty()) evict_oldest(frames_.empty() ? others_ : frames_);
    return TakenMemory(limit_, bytes, what);
}

const FieldCache::Part &FieldCache::keep(const Key &key, Part part, TakenMemory taken) {
    kept_bytes_ += taken.bytes();
    std::list<Kept> &parts = parts_like(key);
    parts.push_front({key, std::move(part), std::move(taken)});
    places_[key] = parts.begin();
    if (frames_.size() > most_frames) evict_oldest(frames_);
    const std::size_t new_frames = key.kind == frame ? 1 : 0;
    while (kept_bytes_ > budget_ && places_.size() > 1) {
        evict_oldest(frames_.size() > new_frames ? frames_ : others_);
    }
    return parts.front().part;
}

void FieldCache::clear() {
    while (!is_empty()) evict_oldest(frames_.empty() ? others_ : frames_);
}

void FieldCache::evict_oldest(std::list<Kept> &parts) {
    kept_bytes_ -= parts.back().taken.bytes();
    places_.erase(parts.back().key);
    parts.pop_back();
}

}  // namespace pdeanim
