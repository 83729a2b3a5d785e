// Cache of decoded groups and computed frames of fields, and of tables of neighbours, within one byte budget: evicts the
// least recently used one, frames first.
#pragma once

#include <list>
#include <map>
#include <optional>
#include <vector>

#include "base/errors.hpp"
#include "sections/fields/field_rows.hpp"

namespace pdeanim {

// Called only by the thread that holds the lock of `Turns`.
class FieldCache {
public:
    enum Kind : u8 { group, frame, rows };
    struct Key {
        Kind kind;
        std::size_t field, number;  // number: index of the group or frame
        auto operator<=>(const Key &) const = default;
    };
    struct Part {
        std::vector<u8> values;  // of a group or a frame: (frames of the chunk, rows, components) of the field's type
        std::optional<FieldRows> rows;
    };

    // budget: bytes of all parts at most. `limit` must outlive it.
    FieldCache(MemoryLimit &limit, i64 budget) : limit_(limit), budget_(static_cast<u64>(budget)) {}

    // Return a part and make it the most recently used one; nullptr if it is not cached.
    const Part *find(const Key &key);

    // Take memory, and evict parts until it suffices. LimitError if it does not suffice with an empty cache.
    TakenMemory take(u64 bytes, std::string_view what);

    // Keep a new part; it stays until others are kept or memory is taken.
    const Part &keep(const Key &key, Part part, TakenMemory taken);

    bool is_empty() const { return places_.empty(); }
    void clear();

private:
    struct Kept {
        Key key;
        Part part;
        TakenMemory taken;
    };

    // At least as many frames as the spline needs for one time, but so few that reading a clip once does not fill the
    // budget.
    static constexpr std::size_t most_frames = 64;

    std::list<Kept> &parts_like(const Key &key) { return key.kind == frame ? frames_ : others_; }
    void evict_oldest(std::list<Kept> &parts);

    MemoryLimit &limit_;
    u64 budget_, kept_bytes_ = 0;
    std::list<Kept> frames_, others_;  // most recently used first
    std::map<Key, std::list<Kept>::iterator> places_;
};

}  // namespace pdeanim
