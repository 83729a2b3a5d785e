// Chunks of fields (FDAT): values that change on vertices, faces, corners or objects.
#include <nanobind/stl/optional.h>

#include <optional>

#include "bindings/python/bindings.hpp"
#include "sections/fields/field_chunk.hpp"

namespace pdeanim::bindings {

namespace {

// An array of (frame, row, component).
template <class T> using Block = nb::ndarray<const T, nb::ndim<3>, nb::c_contig, nb::device::cpu>;

template <class T> nb::object to_block(std::vector<T> &&values, i64 frames, i64 rows, i64 components) {
    auto *kept = new std::vector<T>(std::move(values));
    nb::capsule owner(kept, [](void *pointer) noexcept { delete static_cast<std::vector<T> *>(pointer); });
    const std::array<std::size_t, 3> shape = {static_cast<std::size_t>(frames), static_cast<std::size_t>(rows),
                                              static_cast<std::size_t>(components)};
    return nb::cast(nb::ndarray<nb::numpy, T, nb::ndim<3>>(kept->data(), 3, shape.data(), owner));
}

void make_domain(FieldDomain *domain, int site, const nb::list &parts) {
    require(site >= 0 && site < field_sites, "a site is 0 to 3: vertex, face, corner or object");
    const std::vector<ConnectivityView> views = views_of(parts);
    nb::gil_scoped_release release;
    new (domain) FieldDomain(FieldSite{static_cast<u8>(site)}, views);
}

FieldDomain some_rows(const FieldDomain &domain, const Flat<i64> &rows) {
    const std::span<const i64> chosen(rows.data(), rows.size());
    std::vector<i32> places(domain.rows(), -1);
    for (std::size_t i = 0; i < chosen.size(); ++i) {
        require(chosen[i] >= 0 && chosen[i] < domain.rows() && (i == 0 || chosen[i] > chosen[i - 1]),
                "rows are those of the domain, in ascending order");
        places[chosen[i]] = static_cast<i32>(i);
    }
    FieldDomain found(FieldSite::object, {});
    for (const i64 row : chosen) {
        for (const i32 neighbour : domain.of(row)) {
            if (places[neighbour] >= 0) found.neighbours.push_back(places[neighbour]);
        }
        found.starts.push_back(static_cast<i64>(found.neighbours.size()));
    }
    return found;
}

nb::bytes py_encode_field_chunk(const FieldDomain &domain, const Block<i64> &values,
                                const std::optional<Block<u8>> &kinds, int levels, int step) {
    require(static_cast<i64>(values.shape(1)) == domain.rows() && values.shape(2) >= 1 &&
                (!kinds || kinds->size() == values.size()),
            "values and kinds must be of the domain's rows");
    require(levels >= 0 && levels <= most_field_levels && step >= 1 && step <= 255 && step % 2 == 1,
            "levels are 0 to 8, a step is odd and below 256");
    std::vector<u8> data;
    {
        nb::gil_scoped_release release;
        const std::span<const i64> all(values.data(), values.size());
        for (std::size_t i = 0; kinds && i < kinds->size(); ++i) {
            require(kinds->data()[i] < field_kinds, "a kind is 0 to 3");
        }
        for (const i64 value : all) require(size_of(value) <= largest_field_value, "a value exceeds 2^36");
        data = encode_field_chunk(domain, all,
                                  kinds ? std::span<const u8>(kinds->data(), kinds->size()) : std::span<const u8>(),
                                  static_cast<i64>(values.shape(0)), static_cast<int>(values.shape(2)),
                                  {static_cast<u8>(levels), static_cast<u8>(step)});
    }
    return to_bytes(data);
}

nb::bytes py_encode_transformed_field_chunk(const FieldDomain &domain, const Block<i64> &values,
                                            const Block<i64> &functions, const Block<i64> &coefficients,
                                            const Flat<u8> &digits, int levels, int step) {
    const std::size_t count = digits.size();
    require(count >= 1 && count <= FieldTransform::most_functions && count <= values.shape(0) &&
                functions.shape(0) == values.shape(0) && functions.shape(1) == 1 && functions.shape(2) == count &&
                coefficients.shape(0) == values.shape(1) && coefficients.shape(1) == values.shape(2) &&
                coefficients.shape(2) == count && static_cast<i64>(values.shape(1)) == domain.rows(),
            "values, functions, coefficients and digits do not fit together");
    require(levels >= 0 && levels <= most_field_levels && step >= 1 && step <= 255 && step % 2 == 1,
            "levels are 0 to 8, a step is odd and below 256");
    std::vector<u8> data;
    {
        nb::gil_scoped_release release;
        FieldTransform transform{.digits = {digits.data(), digits.data() + count},
                                 .functions = {functions.data(), functions.data() + functions.size()},
                                 .coefficients = {coefficients.data(), coefficients.data() + coefficients.size()}};
        for (std::size_t i = 0; i < transform.coefficients.size(); ++i) {
            const int own = transform.digits[i % count];
            require(own <= FieldTransform::most_digits && size_of(transform.coefficients[i]) <= i64{1} << own,
                    "a coefficient is out of range");
        }
        for (std::size_t i = 0; i < functions.size(); ++i) {
            require(size_of(functions.data()[i]) <= largest_field_value, "a function exceeds 2^36");
        }
        for (std::size_t i = 0; i < values.size(); ++i) {
            require(size_of(values.data()[i]) <= largest_field_value, "a value exceeds 2^36");
        }
        data = encode_transformed_field_chunk(domain, {values.data(), values.size()}, static_cast<i64>(values.shape(0)),
                                              static_cast<int>(values.shape(2)),
                                              {static_cast<u8>(levels), static_cast<u8>(step)}, std::move(transform));
    }
    return to_bytes(data);
}

nb::object py_decode_field_chunk(const FieldDomain &domain, const nb::bytes &data, i64 frames, int components) {
    require(frames >= 0 && components >= 1, "frames and components are counts");
    std::vector<i64> values;
    std::vector<u8> kinds;
    FieldCoding coding;
    {
        nb::gil_scoped_release release;
        values.resize(frames * domain.rows() * components);
        coding = decode_field_chunk(domain, view(data), frames, components, values, kinds);
    }
    const nb::object kinds_found =
        kinds.empty() ? nb::object(nb::none()) : to_block(std::move(kinds), frames, domain.rows(), components);
    return named("FieldChunk", to_block(std::move(values), frames, domain.rows(), components), kinds_found,
                 static_cast<int>(coding.step));
}

}  // namespace

void bind_fields(nb::module_ &module) {
    using namespace nb::literals;
    add_tuple(module, "FieldChunk", "values kinds step");
    nb::class_<FieldDomain>(module, "FieldDomain", "Rows of a field, and which of them are neighbours.")
        .def("__init__", &make_domain, "site"_a, "parts"_a)
        .def_prop_ro("rows", &FieldDomain::rows)
        .def("some", &some_rows, "rows"_a);
    module.def("encode_field_chunk", &py_encode_field_chunk, "domain"_a, "values"_a, "kinds"_a.none(), "levels"_a,
               "step"_a);
    module.def("encode_transformed_field_chunk", &py_encode_transformed_field_chunk, "domain"_a, "values"_a,
               "functions"_a, "coefficients"_a, "digits"_a, "levels"_a, "step"_a);
    module.def("decode_field_chunk", &py_decode_field_chunk, "domain"_a, "data"_a, "frames"_a, "components"_a);
}

}  // namespace pdeanim::bindings
