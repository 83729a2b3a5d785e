#include "clip.hpp"

#include <zstd.h>

#include <algorithm>

#include "text.hpp"

namespace pdeanim_usd {

namespace {

// Runs that stay open: a player asks for those around one time.
constexpr std::size_t max_open_runs = 4;

// Largest memory that the library takes unless it is told another [bytes].
constexpr std::uint64_t default_memory = 1ull << 32;

// Largest size of the remarks [bytes] (18 of the specification).
constexpr unsigned long long max_remark_bytes = 1 << 24;

std::int64_t read_asset(void *user, std::uint64_t offset, void *into, std::size_t size) {
    return static_cast<std::int64_t>(static_cast<ArAsset *>(user)->Read(into, size, offset));
}

}  // namespace

std::string decompressed(const void *data, std::size_t size, std::size_t length, const std::string &name) {
    std::string text(length, '\0');
    if (ZSTD_getFrameContentSize(data, size) != length ||
        ZSTD_decompress(text.data(), text.size(), data, size) != length) {
        throw Failure(name + " are damaged");
    }
    return text;
}

void check(pdeanim_status status, const pdeanim_error &error) {
    if (status != PDEANIM_OK) throw Failure(error.text);
}

Run::Run(std::shared_ptr<const Source> source, pdeanim_animation *handle, bool changes)
    : source_(std::move(source)), handle_(handle) {
    try {
        shapes_ = shapes_of(handle, changes);
        fields_ = fields_of(handle);
    } catch (...) {
        pdeanim_close(handle);
        throw;
    }
}

Clip::Clip(const std::string &resolved_path, std::size_t max_memory, std::size_t max_kept)
    : path_(resolved_path), max_memory_(max_memory ? max_memory : default_memory) {
    std::shared_ptr<ArAsset> asset = ArGetResolver().OpenAsset(ArResolvedPath(resolved_path));
    if (!asset) throw Failure("the file cannot be opened; check that it exists and may be read");
    source_ = std::make_shared<Source>(Source{asset});
    pdeanim_options options{};
    options.size = sizeof options;
    options.max_memory = max_memory;
    options.max_kept = max_kept;
    pdeanim_error error;
    check(pdeanim_open_read(read_asset, asset.get(), asset->GetSize(), &options, &handle_, &error), error);
    const double *times = pdeanim_times(handle_);
    times_.assign(times, times + pdeanim_frame_count(handle_));
}

std::shared_ptr<const Run> Clip::run(int index) const {
    const std::lock_guard guard(lock_);
    const auto found =
        std::find_if(open_runs_.begin(), open_runs_.end(), [&](const auto &one) { return one.first == index; });
    if (found != open_runs_.end()) {
        open_runs_.splice(open_runs_.begin(), open_runs_, found);
        return open_runs_.front().second;
    }
    pdeanim_animation *handle;
    pdeanim_error error;
    check(pdeanim_open_run(handle_, index, &handle, &error), error);
    open_runs_.emplace_front(index, std::make_shared<const Run>(source_, handle, run_count() > 1));
    if (open_runs_.size() > max_open_runs) open_runs_.pop_back();
    return open_runs_.front().second;
}

std::shared_ptr<const Carrier> Clip::carrier() const {
    for (std::int64_t i = 0; i < pdeanim_section_count(handle_); ++i) {
        pdeanim_section section;
        pdeanim_error error;
        check(pdeanim_get_section(handle_, i, &section, &error), error);
        if (std::string(section.type) != "SCEN" || !section.length) continue;
        return std::make_shared<const Carrier>(source_->asset, section.offset, section.length, max_memory_);
    }
    return nullptr;
}

std::map<std::string, std::string> Clip::metadata() const {
    const void *data;
    std::size_t size;
    pdeanim_error error;
    check(pdeanim_remarks(handle_, &data, &size, &error), error);
    if (!size) return {};
    const unsigned long long length = ZSTD_getFrameContentSize(data, size);
    if (length > max_remark_bytes) throw Failure("the remarks (section META) are damaged");
    const JsObject members =
        json_object(decompressed(data, size, length, "the remarks (section META)"), "the remarks (section META)");
    std::map<std::string, std::string> found;
    const auto metadata = members.find("metadata");
    if (metadata == members.end() || !metadata->second.IsObject()) return found;
    for (const auto &[key, value] : metadata->second.GetJsObject()) {
        if (value.IsString()) found[key] = value.GetString();
    }
    return found;
}

}  // namespace pdeanim_usd
