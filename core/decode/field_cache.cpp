#include "decode/field_cache.hpp"

namespace pdeanim {

const FieldCache::Part *FieldCache::find(const Key &key) {
    const auto found = places_.find(key);
    if (found == places_.end()) return nullptr;
    parts_.splice(parts_.begin(), parts_, found->second);
    return &parts_.front().part;
}

TakenMemory FieldCache::take(u64 bytes, std::string_view what) {
    while (limit_.left() < bytes && !parts_.empty()) evict_oldest();
    return TakenMemory(limit_, bytes, what);
}

const FieldCache::Part &FieldCache::keep(const Key &key, Part part, TakenMemory taken) {
    kept_bytes_ += taken.bytes();
    parts_.push_front({key, std::move(part), std::move(taken)});
    places_[key] = parts_.begin();
    while (kept_bytes_ > budget_ && parts_.size() > 1) evict_oldest();
    return parts_.front().part;
}

void FieldCache::clear() {
    while (!parts_.empty()) evict_oldest();
}

void FieldCache::evict_oldest() {
    kept_bytes_ -= parts_.back().taken.bytes();
    places_.erase(parts_.back().key);
    parts_.pop_back();
}

}  // namespace pdeanim
