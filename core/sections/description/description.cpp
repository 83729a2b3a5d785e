#include "sections/description/description.hpp"

namespace pdeanim {

namespace {

constexpr std::size_t bytes_each = sizeof(double);

// Map the bits of a double to an integer so that the order of doubles is kept; also the inverse.
i64 flipped(i64 bits) { return bits ^ ((bits >> 63) & INT64_MAX); }

// Return the second differences of the ranks of times among all doubles, as bytes: first bytes of all, then second
// bytes, and so on.
std::vector<u8> bytes_of(std::span<const double> times) {
    std::vector<u8> bytes(bytes_each * times.size());
    i64 before = 0, step_before = 0;
    for (std::size_t i = 0; i < times.size(); ++i) {
        const i64 place = flipped(std::bit_cast<i64>(times[i])), step = place - before, change = step - step_before;
        const u64 coded = static_cast<u64>(change << 1 ^ change >> 63);
        for (std::size_t byte = 0; byte < bytes_each; ++byte) {
            bytes[byte * times.size() + i] = static_cast<u8>(coded >> 8 * byte);
        }
        before = place;
        step_before = step;
    }
    return bytes;
}

std::vector<double> times_of(std::span<const u8> bytes) {
    std::vector<double> times(bytes.size() / bytes_each);
    u64 place = 0, step = 0;  // sums of signed numbers, which wrap at 64 bits
    for (std::size_t i = 0; i < times.size(); ++i) {
        u64 coded = 0;
        for (std::size_t byte = 0; byte < bytes_each; ++byte) {
            coded |= static_cast<u64>(bytes[byte * times.size() + i]) << 8 * byte;
        }
        step += (coded >> 1) ^ -(coded & 1);
        place += step;
        times[i] = std::bit_cast<double>(flipped(static_cast<i64>(place)));
    }
    return times;
}

std::vector<u8> decode_bytes(RangeCoder<Mode::decode> &coder, i64 times) {
    std::vector<u8> bytes(bytes_each * times);
    if (times > 0) TextModel(false).code_bytes(coder, std::span<u8>(bytes));
    return bytes;
}

[[noreturn]] void refuse(const RangeCoder<Mode::decode> &coder, const CorruptError &error) {
    throw CorruptError(Section("SEQN"), std::string(error.what()) + ", at its byte " + std::to_string(coder.byte()));
}

}  // namespace

std::vector<u8> encode_description(std::span<const double> times, std::span<const std::string> names) {
    RangeCoder<Mode::encode> coder;
    std::vector<u8> bytes = bytes_of(times);
    if (!bytes.empty()) TextModel(false).code_bytes(coder, std::span<u8>(bytes));
    TextModel texts(true);
    for (const std::string &name : names) texts.code_text(coder, name, nullptr);
    return coder.finish();
}

std::vector<double> decode_times(std::span<const u8> data, i64 times) {
    RangeCoder<Mode::decode> coder(data);
    try {
        return times_of(decode_bytes(coder, times));
    } catch (const CorruptError &error) {
        refuse(coder, error);
    }
}

std::vector<std::string> decode_names(std::span<const u8> data, i64 times, i64 objects, const TakeMemory &take) {
    RangeCoder<Mode::decode> coder(data);
    std::vector<std::string> names;
    try {
        decode_bytes(coder, times);
        TextModel texts(true);
        for (i64 object = 0; object < objects; ++object) names.push_back(texts.code_text(coder, "", take));
        if (!coder.is_finished()) throw CorruptError("does not end with its contents");
    } catch (const CorruptError &error) {
        refuse(coder, error);
    }
    return names;
}

}  // namespace pdeanim
