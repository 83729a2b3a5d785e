#include "layer_fields.hpp"

#include <algorithm>
#include <cmath>

#include "text.hpp"

namespace pdeanim_usd {

namespace {

const std::map<std::string, double> units{{"mm", 0.001}, {"cm", 0.01},   {"dm", 0.1},    {"m", 1.0},
                                          {"km", 1000.}, {"in", 0.0254}, {"ft", 0.3048}, {"yd", 0.9144}};

// Seconds within which two times are the same.
constexpr double same_time = 1e-6;

// Return the numbers of a text of words; nothing for a word that is none.
std::vector<std::optional<double>> numbers_of(const std::string &text) {
    std::vector<std::optional<double>> found;
    for (const std::string &word : TfStringTokenize(text)) found.push_back(number_of(word));
    return found;
}

// Return the length of a unit [m], "cm" or "2.5 m"; 0 if the text is no unit.
double metres_of(const std::string &text) {
    if (const auto found = units.find(text); found != units.end()) return found->second;
    const std::vector<std::string> words = TfStringTokenize(text);
    const bool is_length = words.size() == 2 && words[1] == "m";
    return is_length ? std::max(number_of(words[0]).value_or(0), 0.0) : 0;
}

}  // namespace

std::vector<std::pair<TfToken, VtValue>> layer_fields(const Evaluator &evaluator) {
    const std::map<std::string, std::string> &metadata = evaluator.metadata();
    const auto text = [&](const char *key) {
        const auto found = metadata.find(key);
        return found == metadata.end() ? std::string() : found->second;
    };
    const double rate = evaluator.time_codes_per_second();
    double first = evaluator.samples().front().code, last = evaluator.samples().back().code;
    // A stage may be longer than its motion; the text ends with the times of the frames that it was written for.
    const auto range = numbers_of(text("time_range"));
    const bool is_range = range.size() == 4 && std::all_of(range.begin(), range.end(), [](auto one) { return one; });
    if (is_range && *range[0] <= *range[1] && std::abs(*range[2] - evaluator.samples().front().time) <= same_time &&
        std::abs(*range[3] - evaluator.samples().back().time) <= same_time) {
        first = *range[0] * rate;
        last = *range[1] * rate;
    }
    std::vector<std::pair<TfToken, VtValue>> found{{SdfFieldKeys->StartTimeCode, VtValue(first)},
                                                   {SdfFieldKeys->EndTimeCode, VtValue(last)},
                                                   {SdfFieldKeys->TimeCodesPerSecond, VtValue(rate)},
                                                   {SdfFieldKeys->FramesPerSecond, VtValue(evaluator.fps())}};
    std::string axis = text("up_axis");
    std::transform(axis.begin(), axis.end(), axis.begin(), [](char one) { return std::toupper(one); });
    const bool has_axis = axis == "Y" || axis == "Z";
    if (has_axis) found.emplace_back(TfToken("upAxis"), VtValue(TfToken(axis)));
    const double metres = metres_of(text("unit"));
    if (metres) found.emplace_back(TfToken("metersPerUnit"), VtValue(metres));
    VtDictionary rest;
    for (const auto &[key, value] : metadata) {
        const bool is_known = key == "time_range" || key == "time_codes_per_second" || (key == "up_axis" && has_axis) ||
                              (key == "unit" && metres);
        if (!is_known) rest[key] = VtValue(value);
    }
    if (!rest.empty()) {
        found.emplace_back(SdfFieldKeys->CustomLayerData, VtValue(VtDictionary{{"pdecodecMetadata", VtValue(rest)}}));
    }
    return found;
}

}  // namespace pdeanim_usd
