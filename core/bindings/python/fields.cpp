// Chunks of fields (FDAT): values that change on vertices, faces, corners, objects or cells.
#include <nanobind/stl/optional.h>

#include <optional>

#include "bindings/python/bindings.hpp"
#include "sections/fields/field_chunk.hpp"

namespace pdeanim::bindings {

namespace {

// An array of shape (frames, rows, components).
template <class T> using Block = nb::ndarray<const T, nb::ndim<3>, nb::c_contig, nb::device::cpu>;

template <class T> nb::object to_block(std::vector<T> &&values, i64 frames, i64 rows, i64 components) {
    auto *kept = new std::vector<T>(std::move(values));
    nb::capsule owner(kept, [](void *pointer) noexcept { delete static_cast<std::vector<T> *>(pointer); });
    const std::array<std::size_t, 3> shape = {static_cast<std::size_t>(frames), static_cast<std::size_t>(rows),
                                              static_cast<std::size_t>(components)};
    return nb::cast(nb::ndarray<nb::numpy, T, nb::ndim<3>>(kept->data(), 3, shape.data(), owner));
}

void make_rows(FieldRows *rows, int domain, const nb::list &parts) {
    require(domain >= 0 && domain < domain_count, "a domain is 0 to 4: vertex, face, corner, object or cell");
    const std::vector<ConnectivityView> views = views_of(parts);
    nb::gil_scoped_release release;
    new (rows) FieldRows(Domain{static_cast<u8>(domain)}, views);
}

FieldRows some_rows(const FieldRows &rows, const Flat<i64> &numbers) {
    const std::span<const i64> chosen(numbers.data(), numbers.size());
    std::vector<i32> places(rows.count(), -1);
    for (std::size_t i = 0; i < chosen.size(); ++i) {
        require(chosen[i] >= 0 && chosen[i] < rows.count() && (i == 0 || chosen[i] > chosen[i - 1]),
                "numbers of rows must exist, in ascending order");
        places[chosen[i]] = static_cast<i32>(i);
    }
    FieldRows found(Domain::object, {});
    for (const i64 row : chosen) {
        for (const i32 neighbour : rows.of(row)) {
            if (places[neighbour] >= 0) found.neighbours.push_back(places[neighbour]);
        }
        found.starts.push_back(static_cast<i64>(found.neighbours.size()));
    }
    return found;
}

FieldCoding checked_coding(const FieldRows &rows, const Block<i64> &values, int levels, int step) {
    require(static_cast<i64>(values.shape(1)) == rows.count() && values.shape(2) >= 1,
            "values must be of the given rows");
    require(levels >= 0 && levels <= most_field_levels && step >= 1 && step <= 255 && step % 2 == 1,
            "levels are 0 to 8, a step is odd and below 256");
    return {static_cast<u8>(levels), static_cast<u8>(step)};
}

std::span<const i64> checked_numbers(const Block<i64> &numbers, const char *message) {
    const std::span<const i64> found(numbers.data(), numbers.size());
    for (const i64 number : found) require(size_of(number) <= largest_field_value, message);
    return found;
}

nb::bytes py_encode_field_chunk(const FieldRows &rows, const Block<i64> &values, const std::optional<Block<u8>> &kinds,
                                int levels, int step) {
    const FieldCoding coding = checked_coding(rows, values, levels, step);
    require(!kinds || kinds->size() == values.size(), "kinds must be those of the values");
    std::vector<u8> data;
    {
        nb::gil_scoped_release release;
        const std::span<const u8> own_kinds(kinds ? kinds->data() : nullptr, kinds ? kinds->size() : 0);
        for (const u8 kind : own_kinds) require(kind < field_kinds, "a kind is 0 to 3");
        data = encode_field_chunk(rows, checked_numbers(values, "a value exceeds 2^36"), own_kinds,
                                  static_cast<i64>(values.shape(0)), static_cast<int>(values.shape(2)), coding);
    }
    return to_bytes(data);
}

nb::bytes py_encode_transformed_field_chunk(const FieldRows &rows, const Block<i64> &values,
                                            const Block<i64> &functions, const Block<i64> &coefficients,
                                            const Flat<u8> &digits, int levels, int step) {
    const FieldCoding coding = checked_coding(rows, values, levels, step);
    const std::size_t count = digits.size();
    require(count >= 1 && count <= FieldTransform::most_functions && count <= values.shape(0) &&
                functions.shape(0) == values.shape(0) && functions.shape(1) == 1 && functions.shape(2) == count &&
                coefficients.shape(0) == values.shape(1) && coefficients.shape(1) == values.shape(2) &&
                coefficients.shape(2) == count,
            "values, functions, coefficients and digits do not fit together");
    std::vector<u8> data;
    {
        nb::gil_scoped_release release;
        const std::span<const i64> of_time = checked_numbers(functions, "a function exceeds 2^36");
        FieldTransform transform{.digits = {digits.data(), digits.data() + count},
                                 .functions = {of_time.begin(), of_time.end()},
                                 .coefficients = {coefficients.data(), coefficients.data() + coefficients.size()}};
        for (std::size_t i = 0; i < transform.coefficients.size(); ++i) {
            const int own = transform.digits[i % count];
            require(own <= FieldTransform::most_digits && size_of(transform.coefficients[i]) <= i64{1} << own,
                    "a coefficient is out of range");
        }
        data = encode_transformed_field_chunk(rows, checked_numbers(values, "a value exceeds 2^36"),
                                              static_cast<i64>(values.shape(0)), static_cast<int>(values.shape(2)),
                                              coding, std::move(transform));
    }
    return to_bytes(data);
}

nb::object py_decode_field_chunk(const FieldRows &rows, const nb::bytes &data, i64 frames, int components) {
    require(frames >= 0 && components >= 1, "frames and components are counts");
    std::vector<i64> values;
    std::vector<u8> kinds;
    FieldCoding coding;
    {
        nb::gil_scoped_release release;
        values.resize(frames * rows.count() * components);
        coding = decode_field_chunk(rows, view(data), frames, components, values, kinds);
    }
    const nb::object kinds_found =
        kinds.empty() ? nb::object(nb::none()) : to_block(std::move(kinds), frames, rows.count(), components);
    return named("FieldChunk", to_block(std::move(values), frames, rows.count(), components), kinds_found,
                 static_cast<int>(coding.step));
}

}  // namespace

void bind_fields(nb::module_ &module) {
    using namespace nb::literals;
    add_tuple(module, "FieldChunk", "values kinds step");
    nb::class_<FieldRows>(module, "FieldRows", "Rows of a field, and which of them are neighbours.")
        .def("__init__", &make_rows, "domain"_a, "parts"_a)
        .def_prop_ro("count", &FieldRows::count)
        .def("some", &some_rows, "numbers"_a);
    module.def("encode_field_chunk", &py_encode_field_chunk, "rows"_a, "values"_a, "kinds"_a.none(), "levels"_a,
               "step"_a);
    module.def("encode_transformed_field_chunk", &py_encode_transformed_field_chunk, "rows"_a, "values"_a,
               "functions"_a, "coefficients"_a, "digits"_a, "levels"_a, "step"_a);
    module.def("decode_field_chunk", &py_decode_field_chunk, "rows"_a, "data"_a, "frames"_a, "components"_a);
}

}  // namespace pdeanim::bindings
