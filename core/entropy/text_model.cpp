#include "entropy/text_model.hpp"

namespace pdeanim {

namespace {

constexpr u32 hash_factor = 0x9E3779B1u;  // 2^32 over the golden ratio (Knuth, volume 3, section 6.4)

// Words that a model of texts is trained on before it codes; 255 ends a word.
constexpr std::string_view words =
    "uv\xffuv:UVMap\xffuv:map1\xffuv:st\xffuv:TEXCOORD_1\xff"
    "color\xff"
    "color:Cd\xff"
    "color:COLOR_0\xff"
    "material\xffgroup\xffobject\xffsmoothing\xffnormal_group\xffsubdivision\xff"
    "catmull-clark\xff"
    "curve_basis\xfftransform\xff"
    "displayOpacity\xffMaterial.001\xffinitialShadingGroup\xfflambert1SG\xffmesh\xff"
    "/root/Armature/BodyShape\xff/World/Geometry/Cube\xffSphere_002/SphereShape_003\xff"
    "default\xff"
    "pCube1|pCubeShape1\xffPlane_0001\xff"
    "Cylinder_10\xff";

}  // namespace

TextModel::TextModel(bool has_read_words)
    : one_(1 << slot_bits), two_(1 << slot_bits), three_(1 << slot_bits), places_(1 << place_bits), past_(past_size) {
    if (!has_read_words) return;
    RangeCoder<Mode::measure> coder;
    for (const char byte : words) code(coder, static_cast<u8>(byte));
}

template <Mode mode> u8 TextModel::code(RangeCoder<mode> &coder, u8 byte) {
    coder.check_not_ended();
    i64 &following = places_[(last_ * hash_factor) >> (32 - place_bits)];
    if (place_ < 0 || count_ - place_ > past_size) {
        place_ = following - 1;
        run_ = 0;
        if (count_ - place_ > past_size) place_ = -1;
    }
    following = count_ + 1;
    const u32 proposed = place_ >= 0 ? 256u + past_[place_ % past_size] : 0;
    const int run = static_cast<int>(least<i64>(run_, longest_run));
    u32 found = 1;
    for (int digit = 7; digit >= 0; --digit) {
        const bool agrees = proposed >> (digit + 1) == found, proposal = (proposed >> digit) & 1;
        const u32 two = ((last_ & 0xFFFF) << 8) + found, three = (last_ << 8) + found;
        const bool bit = coder.template mixed<4>(
            {&one_[((last_ & 0xFF) << 8) + found], &two_[(two * hash_factor) >> (32 - slot_bits)],
             &three_[(three * hash_factor) >> (32 - slot_bits)], agrees ? &match_[run][proposal] : &no_match_},
            weights_[agrees ? 1 + least(run, decisions - 2) : 0].data(), (byte >> digit) & 1);
        found = 2 * found + bit;
    }
    if (place_ >= 0 && found == proposed) {
        ++place_;
        ++run_;
    } else {
        place_ = -1;
    }
    byte = static_cast<u8>(found);
    past_[count_++ % past_size] = byte;
    last_ = last_ << 8 | byte;
    return byte;
}

template <Mode mode> void TextModel::code_bytes(RangeCoder<mode> &coder, std::span<u8> values) {
    for (u8 &value : values) value = code(coder, value);
}

template <Mode mode>
std::string TextModel::code_text(RangeCoder<mode> &coder, std::string_view text, const TakeMemory &take) {
    std::string found;
    if constexpr (mode != Mode::decode) {
        for (const char byte : text) code(coder, static_cast<u8>(byte));
        code(coder, end);
        found = text;
    } else {
        while (true) {
            if (found.size() % piece == 0) take(piece);
            const u8 byte = code(coder, 0);
            if (byte == end) break;
            found.push_back(static_cast<char>(byte));
        }
        if (!is_utf8(found)) throw CorruptError("holds a text that is not UTF-8");
    }
    return found;
}

template void TextModel::code_bytes(RangeCoder<Mode::encode> &, std::span<u8>);
template void TextModel::code_bytes(RangeCoder<Mode::decode> &, std::span<u8>);
template std::string TextModel::code_text(RangeCoder<Mode::encode> &, std::string_view, const TakeMemory &);
template std::string TextModel::code_text(RangeCoder<Mode::decode> &, std::string_view, const TakeMemory &);

bool is_utf8(std::string_view text) {
    for (std::size_t at = 0; at < text.size();) {
        const u32 first = static_cast<u8>(text[at++]);
        if (first < 0x80) continue;
        const int more = first >= 0xF0 ? 3 : first >= 0xE0 ? 2 : 1;
        if (first < 0xC2 || first > 0xF4 || text.size() - at < static_cast<std::size_t>(more)) return false;
        u32 character = first & (0x3F >> more);
        for (int i = 0; i < more; ++i) {
            const u32 next = static_cast<u8>(text[at++]);
            if ((next & 0xC0) != 0x80) return false;
            character = character << 6 | (next & 0x3F);
        }
        if (more == 2 && (character < 0x800 || (character >= 0xD800 && character < 0xE000))) return false;
        if (more == 3 && (character < 0x10000 || character > 0x10FFFF)) return false;
    }
    return true;
}

}  // namespace pdeanim
