// Cache of decoded groups of frames, within a byte budget: evicts the least recently used one, decodes ahead.
#pragma once

#include <list>
#include <unordered_map>
#include <vector>

#include "decode/decoded_group.hpp"
#include "decode/run_sections.hpp"

namespace pdeanim {

// Called by the thread that holds the turn.
class GroupCache {
public:
    // largest_budget: bytes of decoded groups at most. `run` and `turns` must outlive it.
    GroupCache(RunSections &run, i64 largest_budget, const Turns &turns);

    // Return a group, decoded unless it is cached; it stays until other groups are requested. CorruptError if it is
    // damaged, LimitError if there is no room for it alone.
    const DecodedGroup &group(std::size_t index);

    bool is_kept(std::size_t index) const { return places_.contains(index); }

    // Decode the groups that frames at increasing times need first, in parallel; fewer if they would not be cached
    // together. Groups without room next to the others are skipped.
    void decode_ahead(std::span<const double> times);

    // The byte budget before any evicted group is decoded again. Going through a clip once needs few groups at a time.
    // Each time a group is decoded again the budget doubles, up to the largest one: scrubbing ends with everything it
    // needs.
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
    i64 largest_budget_, budget_;  // bytes
    i64 kept_bytes_ = 0;
    Kept kept_;  // the latest first
    std::unordered_map<std::size_t, Kept::iterator> places_;
    std::vector<bool> has_been_kept_;  // one entry per group
};

}  // namespace pdeanim
