// Decodes groups of frames of the motion, also ahead of their use, and keeps them in the cache.
#pragma once

#include <vector>

#include "decode/decoded_cache.hpp"
#include "decode/run_sections.hpp"

namespace pdeanim {

// Called only by the thread that holds the lock of `Turns`.
class GroupCache {
public:
    // The arguments must outlive this object.
    GroupCache(RunSections &run, DecodedCache &cache, const Turns &turns) : run_(run), cache_(cache), turns_(turns) {}

    // Return a decoded group from the cache, or decode it; valid until another part of the cache is requested.
    // CorruptError if it is damaged, LimitError if there is too little memory even with an empty cache.
    const DecodedGroup &group(std::size_t index);

    bool is_kept(std::size_t index) const { return cache_.has(key_of(index)); }

    // Decode in parallel the groups that are needed first at increasing times, as many as the cache can hold together.
    // Groups for which memory does not suffice are skipped.
    void decode_ahead(std::span<const double> times);

    u64 first_budget() const { return cache_.first_budget(); }

private:
    static DecodedCache::Key key_of(std::size_t index) { return {DecodedCache::motion, 0, index}; }

    std::vector<std::size_t> wanted_at(std::span<const double> times, u64 &bytes_at_once) const;
    TakenMemory begin_group(std::size_t index);
    u64 expected_bytes(std::size_t index) const;
    DecodedGroup decode(std::size_t index, TakenMemory taken, std::size_t k, const SpaceBasis &space,
                        GroupsAhead &ahead, int threads) const;
    const DecodedGroup &keep(std::size_t index, DecodedGroup group);

    RunSections &run_;
    DecodedCache &cache_;
    const Turns &turns_;
};

}  // namespace pdeanim
