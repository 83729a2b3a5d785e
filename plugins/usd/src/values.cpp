#include "values.hpp"

#include <map>
#include <tuple>

namespace pdeanim_usd {

namespace {

template <class Row> ArrayType type_of(const SdfValueTypeName &name) {
    return {name.GetAsToken(), sizeof(Row),
            [](const void *data, std::size_t count) { return VtValue(array_of<Row>(data, count)); }};
}

}  // namespace

std::string NumberType::name() const {
    if (kind == 'b') return "bool";
    const std::string bits = std::to_string(8 * bytes);
    return (kind == 'f' ? "float" : kind == 'i' ? "int" : "uint") + bits;
}

NumberType number_type(pdeanim_type type) {
    switch (type) {
        case PDEANIM_FLOAT32: return {'f', 4};
        case PDEANIM_FLOAT64: return {'f', 8};
        case PDEANIM_INT32: return {'i', 4};
        case PDEANIM_INT64: return {'i', 8};
        default: return {'u', 1};
    }
}

NumberType number_type(pdeanim_field_type type) {
    switch (type) {
        case PDEANIM_FIELD_FLOAT32: return {'f', 4};
        case PDEANIM_FIELD_FLOAT64: return {'f', 8};
        case PDEANIM_FIELD_INT8: return {'i', 1};
        case PDEANIM_FIELD_INT16: return {'i', 2};
        case PDEANIM_FIELD_INT32: return {'i', 4};
        case PDEANIM_FIELD_INT64: return {'i', 8};
        case PDEANIM_FIELD_UINT8: return {'u', 1};
        case PDEANIM_FIELD_UINT16: return {'u', 2};
        case PDEANIM_FIELD_UINT32: return {'u', 4};
        case PDEANIM_FIELD_UINT64: return {'u', 8};
        default: return {'b', 1};
    }
}

const ArrayType *array_type(const std::string &role, NumberType type, std::int64_t columns) {
    using Key = std::tuple<std::string, char, std::size_t, std::int64_t>;
    const auto &names = *SdfValueTypeNames;
    static const std::map<Key, ArrayType> types{
        {{"", 'f', 4, 1}, type_of<float>(names.FloatArray)},
        {{"", 'f', 4, 2}, type_of<GfVec2f>(names.Float2Array)},
        {{"", 'f', 4, 3}, type_of<GfVec3f>(names.Float3Array)},
        {{"", 'f', 4, 4}, type_of<GfVec4f>(names.Float4Array)},
        {{"", 'f', 8, 1}, type_of<double>(names.DoubleArray)},
        {{"", 'f', 8, 2}, type_of<GfVec2d>(names.Double2Array)},
        {{"", 'f', 8, 3}, type_of<GfVec3d>(names.Double3Array)},
        {{"", 'f', 8, 4}, type_of<GfVec4d>(names.Double4Array)},
        {{"", 'i', 4, 1}, type_of<int>(names.IntArray)},
        {{"", 'i', 4, 2}, type_of<GfVec2i>(names.Int2Array)},
        {{"", 'i', 4, 3}, type_of<GfVec3i>(names.Int3Array)},
        {{"", 'i', 4, 4}, type_of<GfVec4i>(names.Int4Array)},
        {{"", 'i', 8, 1}, type_of<int64_t>(names.Int64Array)},
        {{"", 'u', 1, 1}, type_of<unsigned char>(names.UCharArray)},
        {{"color", 'f', 4, 3}, type_of<GfVec3f>(names.Color3fArray)},
        {{"color", 'f', 4, 4}, type_of<GfVec4f>(names.Color4fArray)},
        {{"uv", 'f', 4, 2}, type_of<GfVec2f>(names.TexCoord2fArray)},
        {{"uv", 'f', 4, 3}, type_of<GfVec3f>(names.TexCoord3fArray)},
        {{"vector", 'f', 4, 3}, type_of<GfVec3f>(names.Vector3fArray)},
        {{"normal", 'f', 4, 3}, type_of<GfVec3f>(names.Normal3fArray)},
    };
    const auto found = types.find({role, type.kind, type.bytes, columns});
    return found == types.end() ? nullptr : &found->second;
}

const ArrayType &scalar_type(NumberType type) {
    static const std::map<std::pair<char, std::size_t>, ArrayType> types{
        {{'u', 4}, type_of<unsigned>(SdfValueTypeNames->UIntArray)},
        {{'u', 8}, type_of<uint64_t>(SdfValueTypeNames->UInt64Array)},
        {{'b', 1}, type_of<bool>(SdfValueTypeNames->BoolArray)},
    };
    if (const ArrayType *found = array_type("", type, 1)) return *found;
    const auto found = types.find({type.kind, type.bytes});
    return found == types.end() ? *array_type("", {'i', 4}, 1) : found->second;
}

std::vector<char> rows_in_order(const void *data, std::size_t row_bytes, const std::vector<std::int32_t> &order) {
    std::vector<char> found;
    found.reserve(order.size() * row_bytes);
    for (const std::int32_t row : order) {
        const char *first = static_cast<const char *>(data) + row * row_bytes;
        found.insert(found.end(), first, first + row_bytes);
    }
    return found;
}

std::vector<std::int32_t> reversed_corners(std::span<const std::int32_t> face_sizes) {
    std::vector<std::int32_t> found;
    for (const std::int32_t size : face_sizes) {
        const auto end = static_cast<std::int32_t>(found.size()) + size;
        for (std::int32_t k = 1; k <= size; ++k) found.push_back(end - k);
    }
    return found;
}

std::vector<std::int32_t> as_int32(const void *data, std::size_t count, NumberType type) {
    std::vector<std::int32_t> found(count);
    const auto fill = [&]<class Number>(const Number *numbers) {
        for (std::size_t i = 0; i < count; ++i) found[i] = static_cast<std::int32_t>(numbers[i]);
    };
    if (type.kind == 'u') {
        if (type.bytes == 1) fill(static_cast<const std::uint8_t *>(data));
        if (type.bytes == 2) fill(static_cast<const std::uint16_t *>(data));
    } else {
        if (type.bytes == 1) fill(static_cast<const std::int8_t *>(data));
        if (type.bytes == 2) fill(static_cast<const std::int16_t *>(data));
        if (type.bytes == 4) fill(static_cast<const std::int32_t *>(data));
        if (type.bytes == 8) fill(static_cast<const std::int64_t *>(data));
    }
    return found;
}

}  // namespace pdeanim_usd
