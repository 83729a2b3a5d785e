#include "carrier.hpp"

#include "clip.hpp"
#include "text.hpp"

namespace pdeanim_usd {

namespace {

// Limits of section SCEN (26 of the specification).
constexpr std::uint64_t max_entries = 1 << 16, max_text = 4096, max_content = 1ull << 40;

// Memory that a JSON text takes when it is parsed, at most, as a multiple of its size.
constexpr std::uint64_t json_memory = 64;

// Largest size of the names and sizes before the streams [bytes]: of as many streams as there may be.
constexpr std::uint64_t max_head = 1 << 25;

[[noreturn]] void fail() { throw Failure("the scene (section SCEN) is damaged"); }

// Reads fields of bytes one after the other.
class Fields {
public:
    explicit Fields(const std::string &bytes) : bytes_(bytes) {}

    std::uint64_t count(std::uint64_t most) {
        std::uint64_t found = 0;
        for (int shift = 0;; shift += 7) {
            const std::uint64_t byte = next();
            if (shift > 56) fail();
            found |= (byte & 0x7F) << shift;
            if (byte < 0x80) break;
        }
        if (found > most) fail();
        return found;
    }

    std::string text() {
        std::string found(count(max_text), '\0');
        for (char &one : found) one = static_cast<char>(next());
        return found;
    }

    std::uint32_t u32() {
        std::uint32_t found = 0;
        for (int shift = 0; shift < 32; shift += 8) found |= std::uint32_t{next()} << shift;
        return found;
    }

    std::size_t place() const { return place_; }

private:
    unsigned char next() {
        if (place_ == bytes_.size()) fail();
        return static_cast<unsigned char>(bytes_[place_++]);
    }

    const std::string &bytes_;
    std::size_t place_ = 0;
};

std::uint32_t checksum_of(const std::string &bytes) {
    static const std::vector<std::uint32_t> table = [] {
        std::vector<std::uint32_t> made(256);
        for (std::uint32_t i = 0; i < made.size(); ++i) {
            made[i] = i;
            for (int bit = 0; bit < 8; ++bit) made[i] = made[i] >> 1 ^ (made[i] & 1 ? 0xEDB88320u : 0);
        }
        return made;
    }();
    std::uint32_t found = ~0u;
    for (const char byte : bytes) found = found >> 8 ^ table[(found ^ static_cast<unsigned char>(byte)) & 0xFF];
    return ~found;
}

const JsArray &list_of(const JsObject &object, const std::string &key) {
    static const JsArray none;
    const auto found = object.find(key);
    return found == object.end() || !found->second.IsArray() ? none : found->second.GetJsArray();
}

// Read members of a list of JSON.
class Row {
public:
    explicit Row(const JsValue &row) {
        if (!row.IsArray()) fail();
        values_ = row.GetJsArray();
    }

    std::string text(std::size_t at) const {
        if (at >= values_.size() || !values_[at].IsString()) fail();
        return values_[at].GetString();
    }

    double number(std::size_t at) const {
        if (at >= values_.size() || (!values_[at].IsInt() && !values_[at].IsReal())) fail();
        return values_[at].IsInt() ? static_cast<double>(values_[at].GetInt64()) : values_[at].GetReal();
    }

    int whole(std::size_t at) const {
        const double found = number(at);
        if (!(found >= 0 && found <= 0x7FFFFFFF)) fail();
        return static_cast<int>(found);
    }

    SdfPath attribute(std::size_t at) const {
        const std::string found = text(at);
        if (!SdfPath::IsValidPathString(found) || !SdfPath(found).IsPropertyPath()) fail();
        return SdfPath(found);
    }

private:
    JsArray values_;
};

}  // namespace

Carrier::Carrier(std::shared_ptr<ArAsset> asset, std::uint64_t offset, std::uint64_t size, std::uint64_t max_memory)
    : asset_(std::move(asset)), max_memory_(max_memory) {
    // Names and sizes; the streams that follow are read when they are needed.
    std::string head(std::min<std::uint64_t>(size, max_head), '\0');
    if (asset_->Read(head.data(), head.size(), offset) != head.size()) fail();
    Fields fields(head);
    family_ = fields.text();
    for (std::uint64_t kinds = fields.count(max_entries); kinds; --kinds) {
        fields.text();
        fields.count(~0ull);
    }
    for (std::uint64_t outside = fields.count(max_entries); outside; --outside) fields.text();
    std::uint64_t whole = 0, packed = 0;
    for (std::uint64_t streams = fields.count(max_entries); streams; --streams) {
        const std::string name = fields.text();
        Stream one{packed, 0, fields.count(max_content), 0};
        one.packed = fields.count(size);
        one.checksum = fields.u32();
        whole += one.size;
        packed += one.packed;
        if (whole > max_content || packed > size || !streams_.emplace(name, one).second) fail();
        reserve(one.size);
    }
    if (fields.place() + packed != size) fail();
    for (auto &[name, one] : streams_) one.offset += offset + fields.place();
    if (is_usd()) read_cuts();
}

void Carrier::reserve(std::uint64_t bytes) const {
    reserved_ += bytes;
    if (reserved_ > max_memory_) throw Failure("the scene needs more memory than the memory limit allows");
}

std::string Carrier::unpacked(const std::string &name) const {
    const auto found = streams_.find(name);
    if (found == streams_.end()) fail();
    const Stream &one = found->second;
    if (!one.size) return "";
    std::string packed(one.packed, '\0');
    if (asset_->Read(packed.data(), packed.size(), one.offset) != packed.size()) fail();
    std::string content = decompressed(packed.data(), packed.size(), one.size, "files of the scene (section SCEN)");
    if (checksum_of(content) != one.checksum) fail();
    return content;
}

void Carrier::read_cuts() {
    if (const auto found = streams_.find("cuts"); found != streams_.end()) reserve(found->second.size * json_memory);
    const JsObject cuts = json_object(unpacked("cuts"), "the cuts of the scene (section SCEN)");
    const auto root = cuts.find("root");
    if (root == cuts.end() || !root->second.IsString() || !has(root->second.GetString())) fail();
    root_ = root->second.GetString();
    for (const JsValue &value : list_of(cuts, "arrays")) {
        const Row row(value);
        arrays_.emplace(row.text(0), CutArray{row.attribute(1), row.whole(2), row.text(3), row.text(4)});
    }
    for (const JsValue &value : list_of(cuts, "samples")) {
        const Row row(value);
        samples_.push_back({row.text(0), row.text(2), row.attribute(1), row.whole(3), row.number(5), row.number(6),
                            static_cast<std::size_t>(row.whole(7))});
    }
}

std::vector<CutArray> Carrier::arrays_of(const std::string &file) const {
    std::vector<CutArray> found;
    const auto [first, last] = arrays_.equal_range(file);
    for (auto one = first; one != last; ++one) found.push_back(one->second);
    return found;
}

}  // namespace pdeanim_usd
