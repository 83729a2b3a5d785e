#include "text.hpp"

#include <cmath>
#include <locale>
#include <sstream>

#include "clip.hpp"

namespace pdeanim_usd {

namespace {

// Lists within lists that the library writes are far fewer.
constexpr int max_depth = 64;

bool is_utf8(const std::string &text) {
    for (std::size_t i = 0, end; i < text.size(); i = end) {
        const auto byte = [&](std::size_t k) { return static_cast<unsigned char>(text[k]); };
        const unsigned first = byte(i);
        const int more = first < 0x80   ? 0
                         : first < 0xC2 ? -1
                         : first < 0xE0 ? 1
                         : first < 0xF0 ? 2
                         : first < 0xF5 ? 3
                                        : -1;
        end = i + 1 + more;
        if (more < 0 || end > text.size()) return false;
        unsigned code = more ? first & (0x3F >> more) : first;
        for (std::size_t k = i + 1; k < end; ++k) {
            if ((byte(k) & 0xC0) != 0x80) return false;
            code = code << 6 | (byte(k) & 0x3F);
        }
        const bool is_surrogate = code >= 0xD800 && code < 0xE000;
        if (is_surrogate || code > 0x10FFFF || (more == 2 && code < 0x800) || (more == 3 && code < 0x10000))
            return false;
    }
    return true;
}

bool is_shallow(const std::string &text) {
    int depth = 0;
    bool is_quoted = false;
    for (std::size_t i = 0; i < text.size(); ++i) {
        const char one = text[i];
        if (one == '"') is_quoted = !is_quoted;
        if (is_quoted && one == '\\') ++i;
        if (is_quoted) continue;
        depth += (one == '[' || one == '{') - (one == ']' || one == '}');
        if (depth > max_depth) return false;
    }
    return true;
}

}  // namespace

std::optional<double> number_of(const std::string &text) {
    std::istringstream stream(text);
    stream.imbue(std::locale::classic());
    double number;
    if (stream >> number && stream.peek() == std::char_traits<char>::eof() && std::isfinite(number)) return number;
    return std::nullopt;
}

JsObject json_object(const std::string &text, const std::string &name) {
    if (!is_utf8(text)) throw Failure(name + " are not UTF-8");
    const JsValue found = is_shallow(text) ? JsParseString(text) : JsValue();
    if (!found.IsObject()) throw Failure(name + " are not a JSON object");
    return found.GetJsObject();
}

}  // namespace pdeanim_usd
