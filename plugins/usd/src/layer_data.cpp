#include "layer_data.hpp"

#include <algorithm>

namespace pdeanim_usd {

namespace {

// Find the times around a time: it itself, as values between samples are evaluated, not interpolated.
bool bracket(double first, double last, double time, double *lower, double *upper) {
    *lower = *upper = std::clamp(time, first, last);
    return true;
}

bool store(SdfAbstractDataValue *into, const VtValue &value) { return !into || into->StoreValue(value); }

bool store(VtValue *into, const VtValue &value) {
    if (into) *into = value;
    return true;
}

}  // namespace

void LayerData::add_series(const SdfPath &path, Series series) {
    // An empty map says that there are samples to everybody who lists the attribute's fields.
    if (series.quantity != Quantity::sampled) Set(path, SdfFieldKeys->TimeSamples, VtValue(SdfTimeSampleMap()));
    series_.emplace(path, std::move(series));
}

const Series *LayerData::find(const SdfPath &path) const {
    const auto found = series_.find(path);
    return found == series_.end() ? nullptr : &found->second;
}

const Series *LayerData::find_evaluated(const SdfPath &path) const {
    const Series *found = find(path);
    return found && found->quantity != Quantity::sampled ? found : nullptr;
}

const Series *LayerData::find_at(const SdfPath &path, double time) const {
    const Series *found = find(path);
    return found && (found->quantity != Quantity::sampled || found->times.contains(time)) ? found : nullptr;
}

VtValue LayerData::value_at(const Series &series, const SdfPath &path, double time) const {
    try {
        return evaluator_->value(series, time);
    } catch (const std::exception &error) {
        TF_RUNTIME_ERROR("%s: <%s> at time code %g: %s", evaluator_->clip().path().c_str(), path.GetText(), time,
                         error.what());
        // USD asks again, and again, for a value that is missing, but not for a blocked one.
        return VtValue(SdfValueBlock());
    }
}

VtValue LayerData::all_samples(const Series &series, const SdfPath &path) const {
    SdfTimeSampleMap samples;
    for (const double code : *series.codes) QueryTimeSample(path, code, &samples[code]);
    return VtValue::Take(samples);
}

bool LayerData::Has(const SdfPath &path, const TfToken &field, SdfAbstractDataValue *value) const {
    const Series *series = value && field == SdfFieldKeys->TimeSamples ? find(path) : nullptr;
    return series ? store(value, all_samples(*series, path)) : SdfData::Has(path, field, value);
}

bool LayerData::Has(const SdfPath &path, const TfToken &field, VtValue *value) const {
    const Series *series = value && field == SdfFieldKeys->TimeSamples ? find(path) : nullptr;
    return series ? store(value, all_samples(*series, path)) : SdfData::Has(path, field, value);
}

bool LayerData::HasSpecAndField(const SdfPath &path, const TfToken &field, SdfAbstractDataValue *value,
                                SdfSpecType *type) const {
    *type = GetSpecType(path);
    return *type != SdfSpecTypeUnknown && Has(path, field, value);
}

bool LayerData::HasSpecAndField(const SdfPath &path, const TfToken &field, VtValue *value, SdfSpecType *type) const {
    *type = GetSpecType(path);
    return *type != SdfSpecTypeUnknown && Has(path, field, value);
}

VtValue LayerData::Get(const SdfPath &path, const TfToken &field) const {
    const Series *series = field == SdfFieldKeys->TimeSamples ? find(path) : nullptr;
    return series ? all_samples(*series, path) : SdfData::Get(path, field);
}

const std::type_info &LayerData::GetTypeid(const SdfPath &path, const TfToken &field) const {
    const bool varies = field == SdfFieldKeys->TimeSamples && find(path);
    return varies ? typeid(SdfTimeSampleMap) : SdfData::GetTypeid(path, field);
}

const std::type_info &LayerData::QueryTimeSampleTypeid(const SdfPath &path, double time) const {
    const Series *series = find(path);
    if (series) return series->empty.GetTypeid();
    VtValue value;
    SdfData::QueryTimeSample(path, time, &value);
    return value.GetTypeid();
}

std::set<double> LayerData::ListAllTimeSamples() const {
    std::set<double> found = SdfData::ListAllTimeSamples();
    for (const Sample &one : evaluator_->samples()) found.insert(one.code);
    return found;
}

std::set<double> LayerData::ListTimeSamplesForPath(const SdfPath &path) const {
    const Series *series = find_evaluated(path);
    if (!series) return SdfData::ListTimeSamplesForPath(path);
    return std::set<double>(series->codes->begin(), series->codes->end());
}

bool LayerData::GetBracketingTimeSamples(double time, double *lower, double *upper) const {
    const std::vector<Sample> &samples = evaluator_->samples();
    return bracket(samples.front().code, samples.back().code, time, lower, upper);
}

std::size_t LayerData::GetNumTimeSamplesForPath(const SdfPath &path) const {
    const Series *series = find_evaluated(path);
    return series ? series->codes->size() : SdfData::GetNumTimeSamplesForPath(path);
}

bool LayerData::GetBracketingTimeSamplesForPath(const SdfPath &path, double time, double *lower, double *upper) const {
    const Series *series = find_evaluated(path);
    if (!series) return SdfData::GetBracketingTimeSamplesForPath(path, time, lower, upper);
    // What is constant in a run changes at its first frame, after the last one that has a sample, too.
    return bracket(series->codes->front(), evaluator_->samples().back().code, time, lower, upper);
}

bool LayerData::GetPreviousTimeSampleForPath(const SdfPath &path, double time, double *previous) const {
    const Series *series = find_evaluated(path);
    if (!series) return SdfData::GetPreviousTimeSampleForPath(path, time, previous);
    const auto after = std::lower_bound(series->codes->begin(), series->codes->end(), time);
    if (after == series->codes->begin()) return false;
    *previous = *std::prev(after);
    return true;
}

bool LayerData::QueryTimeSample(const SdfPath &path, double time, SdfAbstractDataValue *value) const {
    const Series *series = find_at(path, time);
    if (!series) return SdfData::QueryTimeSample(path, time, value);
    return !value || store(value, value_at(*series, path, time));
}

bool LayerData::QueryTimeSample(const SdfPath &path, double time, VtValue *value) const {
    const Series *series = find_at(path, time);
    if (!series) return SdfData::QueryTimeSample(path, time, value);
    return !value || store(value, value_at(*series, path, time));
}

}  // namespace pdeanim_usd
