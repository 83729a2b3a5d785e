#include "decode/group_cache.hpp"

#include <algorithm>
#include <limits>

#include "base/parallel.hpp"

namespace pdeanim {

namespace {

// Peak memory of a group: for each value of a function of time on three axes, and for each of its frames.
constexpr u64 bytes_per_time_value = 120, bytes_per_group_frame = 16;

// Typical memory of a coefficient, used until it is decoded and counted exactly.
constexpr u64 bytes_per_coefficient = 40;

// Largest number of groups decoded in parallel, per thread. Groups differ in size, and a thread that is done takes the
// next.
constexpr int groups_a_thread = 16;

// Return the memory of a group that is known before decoding: chunks, functions of time, starts of frames. It is
// bounded: 4,096 frames, 3 functions per frame, 3 axes.
u64 known_bytes(const Group &group) {
    return group.bytes() + bytes_per_time_value * static_cast<u64>(group.frames * group.functions) +
           bytes_per_group_frame * static_cast<u64>(group.frames);
}

}  // namespace

// Take the memory of a group that is known before it is decoded.
TakenMemory GroupCache::begin_group(std::size_t index) {
    return TakenMemory(run_.memory(), known_bytes(run_.table().groups()[index]),
                       "functions of time of a group of frames");
}

// Return the memory that decoding a group typically takes.
u64 GroupCache::expected_bytes(std::size_t index) const {
    const Group &own = run_.table().groups()[index];
    return known_bytes(own) + bytes_per_coefficient * static_cast<u64>(run_.vertices() * (own.channels() + 1));
}

// Decode a group, the k-th of those that are decoded ahead. taken: from `begin_group`. Several threads call this at
// once.
DecodedGroup GroupCache::decode(std::size_t index, TakenMemory taken, std::size_t k, const SpaceBasis &space,
                                GroupsAhead &ahead, int threads) const {
    const Group &group = run_.table().groups()[index];
    try {
        Chunks read;
        const Chunks *chunks = ahead.chunks(k);
        if (!chunks) {
            read = run_.table().chunks(run_.container(), index);
            chunks = &read;
        }
        const auto values = [&] {
            std::optional<std::vector<double>> found = ahead.values(k);
            return found ? std::move(*found) : decode_group_times(group, (*chunks)[0]);
        };
        return decode_group(group, *chunks, space, run_.times_of(group), std::move(taken), threads,
                            {values, ahead.coefficients(k)});
    } catch (CorruptError &error) {
        if (error.code == FaultCode::section_content) error.code = FaultCode::group_content;
        if (error.frame < 0) error.frame = group.first;
        throw;
    }
}

const DecodedGroup &GroupCache::keep(std::size_t index, DecodedGroup group) {
    const u64 bytes = static_cast<u64>(group.bytes());
    return std::get<DecodedGroup>(cache_.keep(key_of(index), std::move(group), bytes));
}

const DecodedGroup &GroupCache::group(std::size_t index) {
    if (const DecodedCache::Part *known = cache_.find(key_of(index))) return std::get<DecodedGroup>(*known);
    u64 room = expected_bytes(index);
    while (true) {
        turns_.check_cancelled();
        cache_.make_room(room);
        try {
            TakenMemory taken = begin_group(index);
            const std::unique_ptr<GroupsAhead> ahead = run_.begin_ahead({&index, 1});
            const SpaceBasis &space = run_.space(ahead.get());
            return keep(index, decode(index, std::move(taken), 0, space, *ahead, run_.threads()));
        } catch (const LimitError &) {
            // Evicting all other parts may have made room: try again.
            if (cache_.is_empty()) throw;
            room = std::numeric_limits<u64>::max();
        }
    }
}

// Return the groups that are not cached, in the order in which times need them, as many as fit in memory together.
std::vector<std::size_t> GroupCache::wanted_at(std::span<const double> times, u64 &bytes_at_once) const {
    std::vector<std::size_t> wanted;
    u64 kept_bytes = 0;  // estimate for the groups in `wanted`
    const u64 most_at_once = run_.memory().left() + cache_.bytes();
    for (const double time : times) {
        const bool is_enough = static_cast<int>(wanted.size()) == groups_a_thread * run_.threads();
        if (time > run_.times().back() || is_enough) break;
        const std::size_t index = run_.table().group_of(run_.frame_at(most(time, run_.times().front())));
        if (!wanted.empty() && wanted.back() == index) continue;
        const Group &own = run_.table().groups()[index];
        kept_bytes +=
            static_cast<u64>(own.channels() * run_.vertices()) * (own.is_single ? sizeof(float) : sizeof(double));
        if (is_kept(index)) break;
        bytes_at_once += expected_bytes(index);
        // Stop here: a group that is evicted before its frames are evaluated would be decoded twice.
        if (bytes_at_once > most_at_once || (!wanted.empty() && kept_bytes > cache_.budget() - cache_.budget() / 4))
            break;
        wanted.push_back(index);
    }
    return wanted;
}

void GroupCache::decode_ahead(std::span<const double> times) {
    u64 bytes_at_once = 0;
    std::vector<std::size_t> wanted = wanted_at(times, bytes_at_once);
    if (wanted.size() < 2) return;
    cache_.make_room(bytes_at_once);
    // Largest first: if the largest group were started last, the other threads would wait for it.
    const auto bytes_of = [&](std::size_t index) { return run_.table().groups()[index].sizes[1]; };
    std::stable_sort(wanted.begin(), wanted.end(), [&](auto a, auto b) { return bytes_of(a) > bytes_of(b); });
    std::vector<TakenMemory> taken;
    for (const std::size_t index : wanted) taken.push_back(begin_group(index));
    const std::unique_ptr<GroupsAhead> ahead = run_.begin_ahead(wanted);
    const SpaceBasis &space = run_.space(ahead.get());
    std::vector<std::optional<DecodedGroup>> found(wanted.size());
    const auto decode_some = [&](i64 first, i64 end) {
        for (i64 k = first; k < end; ++k) {
            turns_.check_cancelled();
            try {
                found[k].emplace(decode(wanted[k], std::move(taken[k]), k, space, *ahead, 1));
            } catch (const LimitError &) {
                // No room: the caller that needs the group decodes it alone.
            }
        }
    };
    in_shares(static_cast<i64>(wanted.size()), run_.threads(), decode_some, groups_a_thread);
    for (std::size_t k = wanted.size(); k-- > 0;) {
        if (found[k]) keep(wanted[k], std::move(*found[k]));
    }
}

}  // namespace pdeanim
