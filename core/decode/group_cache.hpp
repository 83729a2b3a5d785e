// Cache of decoded groups of frames, within a byte budget: evicts the least recently used one, decodes ahead.
#pragma once

#include <list>
#include <unordered_map>
#include <vector>

#include "decode/decoded_group.hpp"
#include "decode/run_sections.hpp"

namespace pdeanim {

// Called only by the thread that holds the lock of `Turns`.
class GroupCache {
public:
    // largest_budget: largest number of bytes of decoded groups. `run` and `turns` must outlive the cache.
    GroupCache(RunSections &run, i64 largest_budget, const Turns &turns);

    // Return a decoded group from the cache, or decode it; valid until other groups are requested. CorruptError if it
    // is damaged, LimitError if there is too little memory even with an empty cache.
    const DecodedGroup &group(std::size_t index);

    bool is_kept(std::size_t index) const { return places_.contains(index); }

    // Decode in parallel the groups that are needed first at increasing times, as many as the cache can hold together.
    // Groups for which memory does not suffice are skipped.
    void decode_ahead(std::span<const double> times);

    // Return the initial byte budget. Going through a clip once needs few groups at a time. Each time an evicted group
    // is decoded again the budget doubles, up to the largest: after some scrubbing, all the groups it needs stay
    // cached.
    i64 first_budget() const { return largest_budget_ / 8; }

private:
    using Kept = std::list<std::pair<std::size_t, DecodedGroup>>;

    std::vector<std::size_t> wanted_at(std::span<const double> times, u64 &bytes_at_once) const;
    TakenMemory begin_group(std::size_t index);
    u64 expected_bytes(std::size_t index) const;
    DecodedGroup decode(std::size_t index, TakenMemory taken, std::size_t k, const SpaceBasis &space,
                        GroupsAhead &ahead, int threads) const;
    void keep(std::size_t index, DecodedGroup group);
    void evict_for(u64 bytes);
    void evict_oldest();

    RunSections &run_;
    const Turns &turns_;
    i64 largest_budget_, budget_;  // [bytes]
    i64 kept_bytes_ = 0;
    Kept kept_;  // most recently used first
    std::unordered_map<std::size_t, Kept::iterator> places_;
    std::vector<bool> has_been_kept_;  // one entry per group
};

}  // namespace pdeanim
