// The content of a layer: what is constant is stored, what varies is evaluated when it is asked for.
#pragma once

#include <unordered_map>

#include "evaluator.hpp"

namespace pdeanim_usd {

class LayerData : public SdfData {
public:
    explicit LayerData(std::shared_ptr<const Evaluator> evaluator) : evaluator_(std::move(evaluator)) {}

    // Let an attribute vary; its spec must exist.
    void add_series(const SdfPath &path, Series series);

    bool StreamsData() const override { return true; }
    bool IsDetached() const override { return false; }

    bool Has(const SdfPath &path, const TfToken &field, SdfAbstractDataValue *value) const override;
    bool Has(const SdfPath &path, const TfToken &field, VtValue *value) const override;
    bool HasSpecAndField(const SdfPath &path, const TfToken &field, SdfAbstractDataValue *value,
                         SdfSpecType *type) const override;
    bool HasSpecAndField(const SdfPath &path, const TfToken &field, VtValue *value, SdfSpecType *type) const override;
    VtValue Get(const SdfPath &path, const TfToken &field) const override;

    // Types are known without decoding; USD asks for that of every sample, to find blocked ones.
    const std::type_info &GetTypeid(const SdfPath &path, const TfToken &field) const override;
    const std::type_info &QueryTimeSampleTypeid(const SdfPath &path, double time) const;  // 25.8 has none to override

    std::set<double> ListAllTimeSamples() const override;
    std::set<double> ListTimeSamplesForPath(const SdfPath &path) const override;
    bool GetBracketingTimeSamples(double time, double *lower, double *upper) const override;
    std::size_t GetNumTimeSamplesForPath(const SdfPath &path) const override;
    bool GetBracketingTimeSamplesForPath(const SdfPath &path, double time, double *lower, double *upper) const override;
    bool GetPreviousTimeSampleForPath(const SdfPath &path, double time, double *previous) const override;
    bool QueryTimeSample(const SdfPath &path, double time, SdfAbstractDataValue *value) const override;
    bool QueryTimeSample(const SdfPath &path, double time, VtValue *value) const override;

private:
    const Series *find(const SdfPath &path) const;

    // Likewise, but nothing for attributes whose samples stand where the scene has them, or for those of its own samples.
    const Series *find_evaluated(const SdfPath &path) const;
    const Series *find_at(const SdfPath &path, double time) const;

    // Return all samples of an attribute: copies and exports ask for them at once.
    VtValue all_samples(const Series &series, const SdfPath &path) const;

    // Return the value at a time, or report an error that names the file and return a block.
    VtValue value_at(const Series &series, const SdfPath &path, double time) const;

    std::shared_ptr<const Evaluator> evaluator_;
    std::unordered_map<SdfPath, Series, SdfPath::Hash> series_;
};

}  // namespace pdeanim_usd
