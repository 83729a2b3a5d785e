// Cache of all decoded data that can be decoded again: groups of frames of the motion; groups, computed frames and
// tables of neighbours of fields. They share one byte budget: the least recently used part is evicted, computed frames
// first.
#pragma once

#include <list>
#include <map>
#include <utility>
#include <variant>
#include <vector>

#include "base/errors.hpp"
#include "decode/decoded_group.hpp"
#include "sections/fields/field_rows.hpp"

namespace pdeanim {

// Called only by the thread that holds the lock of `Turns`.
class DecodedCache {
public:
    enum Kind : u8 { motion, field_group, field_frame, field_rows };
    struct Key {
        Kind kind;
        std::size_t field, number;  // number: of a group, or of a frame
        auto operator<=>(const Key &) const = default;
    };
    // A group of the motion; values of a field's group or frame, (frames of the chunk, rows, components) of its type;
    // or the rows of fields.
    using Part = std::variant<DecodedGroup, std::vector<u8>, FieldRows>;

    // largest_budget: largest number of bytes of all parts. `limit` must outlive the cache.
    DecodedCache(MemoryLimit &limit, i64 largest_budget)
        : limit_(limit), largest_budget_(static_cast<u64>(largest_budget)), budget_(first_budget()) {}

    // Return the initial byte budget. Going through a clip once needs few groups at a time. Each time an evicted group
    // is decoded again the budget doubles, up to the largest: after some scrubbing, all the groups it needs stay
    // cached.
    u64 first_budget() const { return largest_budget_ / 8; }

    u64 budget() const { return budget_; }
    u64 bytes() const { return bytes_; }  // bytes of all parts
    bool is_empty() const { return places_.empty(); }
    bool has(const Key &key) const { return places_.contains(key); }

    // Return a part, which becomes the most recently used; nullptr if it is not cached.
    const Part *find(const Key &key);

    // Keep a new part of `bytes`; it stays at least until other parts are kept or memory is taken. taken: its memory,
    // unless the part itself holds it.
    const Part &keep(const Key &key, Part part, u64 bytes, TakenMemory taken = {});

    // Evict parts until the limit has so many bytes left, or the cache is empty.
    void make_room(u64 bytes);

    // Take memory after making room for it. LimitError if there is too little even with an empty cache.
    TakenMemory take(u64 bytes, std::string_view what);

    void clear();

private:
    struct Kept {
        Key key;
        Part part;
        u64 bytes;
        TakenMemory taken;
    };

    // As many frames as a spline between two frames needs, so that reading a clip once does not fill the budget.
    static constexpr std::size_t most_frames = 64;

    std::list<Kept> &parts_like(const Key &key) { return key.kind == field_frame ? frames_ : others_; }
    bool was_evicted(const Key &key) const;
    void evict_oldest() { evict_oldest(frames_.empty() ? others_ : frames_); }
    void evict_oldest(std::list<Kept> &parts);

    MemoryLimit &limit_;
    u64 largest_budget_, budget_, bytes_ = 0;
    std::list<Kept> frames_, others_;  // most recently used first
    std::map<Key, std::list<Kept>::iterator> places_;
    // For each kind and field, whether each group was evicted. Evicted frames are not recorded.
    std::map<std::pair<Kind, std::size_t>, std::vector<bool>> evicted_;
};

}  // namespace pdeanim
