#include "sections/connectivity/connectivity.hpp"

#include <algorithm>
#include <memory>
#include <span>
#include <string>

#include "base/errors.hpp"
#include "entropy/numbers.hpp"
#include "sections/connectivity/order.hpp"
#include "sections/connectivity/surface.hpp"

namespace pdeanim {

namespace {

// Codes polygons in their original order, as differences of vertex numbers.
//
// This costs least for lines and for meshes that a program numbered row by row, and works for any polygons. A polygon
// is a sequence of numbers: its size, unless all polygons have the same size; the difference of its first corner from
// the first corner of the previous polygon; the difference of each other corner from the corner before it. A number is
// coded in the first of these ways that applies: as the prediction of the match model, as the vertex after the highest
// one so far, as a literal. The statistics of one object are kept for the next.
class PolygonModel {
public:
    PolygonModel() { new_.fill(std::vector<BitModel>(1 << new_history_bits)); }

    // Code the polygons of one object: `sizes` and `corners` are read when encoding and written when decoding.
    // CorruptError if the polygons are not valid. common_size: size of every polygon, or 0 if sizes differ; smallest:
    // smallest valid size of a polygon. Corners are below `vertices`.
    template <Mode mode> void code(RangeCoder<mode> &coder, i32 common_size, i32 smallest, i64 vertices,
                                   std::span<i32> sizes, std::span<i32> corners) {
        constexpr const char *broken = "refers to a missing vertex, or has faces that do not fit";
        i64 highest = -1, first = 0;
        std::size_t used = 0;
        int new_history = 0;
        for (std::size_t polygon = 0; polygon < sizes.size(); ++polygon) {
            i64 size = common_size;
            if (common_size == 0) {
                if (const auto found = match_.code(coder, size_phase, sizes[polygon])) {
                    size = *found;
                } else {
                    size = smallest + sizes_.code(coder, static_cast<i64>(sizes[polygon]) - smallest);
                }
                match_.add(size);
                sizes[polygon] = static_cast<i32>(size);
            }
            const i64 left = static_cast<i64>(sizes.size() - 1 - polygon);
            if (size < smallest || size > static_cast<i64>(corners.size() - used) - smallest * left)
                throw CorruptError(broken);
            i64 before = first;
            for (i64 corner = 0; corner < size; ++corner) {
                const int phase = static_cast<int>(least<i64>(corner, last_corner_phase));
                i64 vertex = corners[used], difference = vertex - before;
                if (const auto found = match_.code(coder, phase, difference)) {
                    difference = *found;
                } else {
                    const bool is_new = coder.bit(new_[phase][new_history], vertex == highest + 1);
                    new_history = (2 * new_history + is_new) & ((1 << new_history_bits) - 1);
                    difference = is_new ? highest + 1 - before : differences_[phase].code(coder, difference);
                }
                match_.add(difference);
                vertex = before + difference;
                if (vertex < 0 || vertex >= vertices) throw CorruptError(broken);
                corners[used++] = static_cast<i32>(vertex);
                highest = most(highest, vertex);
                before = vertex;
                if (corner == 0) first = vertex;
            }
        }
        if (used != corners.size()) throw CorruptError(broken);
    }

private:
    static constexpr int last_corner_phase = 3;  // corners 0 to 2 have their own phases; the others share this one
    static constexpr int size_phase = 4, new_history_bits = 5;

    std::array<std::vector<BitModel>, MatchModel::phases> new_;
    std::array<SignedModel, MatchModel::phases> differences_;
    NumberModel sizes_;
    MatchModel match_;
};

constexpr i64 most_corners_of_object = (i64{1} << 31) - 1;  // corners are numbered by int32

// Coding a surface and its order may cost this many times as much as coding polygons, and is still preferred: it
// separates the shape of a mesh from its numbering.
constexpr double surface_preference = 1.1;

enum Kind { faces, lines };
constexpr i32 smallest[] = {3, 1};  // smallest number of corners of a face, and of points of a line

// How the faces of an object are coded.
struct Choice {
    bool is_surface = false, has_border = false, has_order = false;
};

// A model of some hundred kilobytes that is created at its first use. Copying this copies the model.
template <class Model> class Lazy {
public:
    Lazy() = default;
    Lazy(const Lazy &other) : model_(other.model_ ? std::make_unique<Model>(*other.model_) : nullptr) {}
    Lazy &operator=(Lazy other) {
        model_ = std::move(other.model_);
        return *this;
    }
    Model &operator*() {
        if (!model_) model_ = std::make_unique<Model>();
        return *model_;
    }
    Model *operator->() { return &**this; }

private:
    std::unique_ptr<Model> model_;
};

// Statistics of all parts of the coder.
struct Models {
    std::array<std::array<NumberModel, 3>, 2>
        heads;  // for faces and for lines: their number, their common size or 0, number of corners
    std::array<BitModel, 3> choices;
    Lazy<SurfaceModel> surface;
    Lazy<OrderModel> order;
    Lazy<PolygonModel> polygons[2];
};

i32 common_size(std::span<const i32> sizes) {
    const bool is_common = std::all_of(sizes.begin(), sizes.end(), [&](i32 size) { return size == sizes[0]; });
    return !sizes.empty() && is_common ? sizes[0] : 0;
}

struct Head {
    i64 count, size, corners;
};

template <Mode mode> Head code_head(RangeCoder<mode> &coder, Models &models, Kind kind, Head head) {
    auto &[count, size, corners] = models.heads[kind];
    head.count = count.code(coder, head.count);
    if (head.count == 0) return {0, 0, 0};
    head.size = size.code(coder, head.size);
    // The product of two numbers of 32 bits; unsigned, so that it is defined even if it is refused later.
    const u64 product = static_cast<u64>(head.count) * static_cast<u64>(head.size);
    head.corners = head.size ? static_cast<i64>(product) : corners.code(coder, head.corners);
    return head;
}

template <Mode mode> Choice code_choice(RangeCoder<mode> &coder, Models &models, Choice choice) {
    choice.is_surface = coder.bit(models.choices[0], choice.is_surface);
    choice.has_border = choice.is_surface && coder.bit(models.choices[1], choice.has_border);
    choice.has_order = choice.is_surface && coder.bit(models.choices[2], choice.has_order);
    return choice;
}

template <Mode mode> void encode_polygons(RangeCoder<mode> &coder, PolygonModel &model, Kind kind, i64 vertices,
                                          std::span<const i32> sizes, std::span<const i32> indices) {
    std::vector<i32> own_sizes(sizes.begin(), sizes.end()), corners(indices.begin(), indices.end());
    model.code(coder, common_size(sizes), smallest[kind], vertices, std::span<i32>(own_sizes), std::span<i32>(corners));
}

// Return whether faces and vertices of the source already have the order in which they are coded.
bool is_coded_order(const CodedSurface &coded, const SourceOrder &order, std::span<const i32> used) {
    i32 first = 0;
    for (std::size_t face = 0; face < order.firsts.size(); ++face) {
        if (order.firsts[face] != first) return false;
        first += coded.sizes[face];
    }
    for (std::size_t vertex = 0; vertex < order.numbers.size(); ++vertex) {
        if (order.numbers[vertex] != static_cast<i32>(vertex) || used[vertex] != static_cast<i32>(vertex)) return false;
    }
    return true;
}

enum class Order { kept, left_out, free };  // free: any order is acceptable, so none is coded

// Choose the cheaper coding for each object. The models learn as they will when coding.
std::vector<Choice> choose(std::span<const ConnectivityView> parts, Order wanted) {
    std::vector<Choice> choices;
    Models models;
    for (const ConnectivityView &part : parts) {
        Choice choice;
        if (!part.face_sizes.empty()) {
            const SourceMesh mesh(part.face_sizes, part.face_indices);
            Lazy<SurfaceModel> surface = models.surface;
            Lazy<OrderModel> order = models.order;
            Lazy<PolygonModel> polygons = models.polygons[faces];
            RangeCoder<Mode::measure> of_surface, of_polygons;
            SourceOrder source;
            const CodedSurface coded = surface->encode(of_surface, mesh, true, source);
            const bool has_order =
                wanted == Order::kept || (wanted == Order::left_out && !is_coded_order(coded, source, mesh.used()));
            if (has_order) order->encode(of_surface, coded, source, mesh.used());
            encode_polygons(of_polygons, *polygons, faces, part.vertices, part.face_sizes, part.face_indices);
            if (of_surface.bits() <= surface_preference * of_polygons.bits()) {
                choice = {true, coded.has_border(), has_order};
                models.surface = std::move(surface);
                models.order = std::move(order);
            } else {
                models.polygons[faces] = std::move(polygons);
            }
        }
        choices.push_back(choice);
    }
    return choices;
}

// Check the head of an object's faces or lines. before: corners that the heads before it declare.
void check_head(Kind kind, const Head &head, i64 before, i64 most_corners) {
    // The product of two 32-bit numbers may overflow a signed 64-bit number: divide instead.
    const bool overflows = head.size && head.count > most_corners_of_object / head.size;
    if ((head.size && head.size < smallest[kind]) || overflows || head.corners > most_corners_of_object ||
        head.count > head.corners / smallest[kind]) {
        const char *what = kind == faces ? " faces" : " lines";
        throw CorruptError(Section("CONN"), "declares " + std::to_string(head.count) + what + ", which is impossible");
    }
    if (head.corners > most_corners - before) {
        throw LimitError("section CONN declares at least " + std::to_string(before + head.corners) +
                         " corners, more than the memory limit allows");
    }
}

}  // namespace

std::pair<std::vector<u8>, std::vector<u8>> encode_connectivity(std::span<const ConnectivityView> parts,
                                                                bool keep_order) {
    const std::vector<Choice> choices = choose(parts, keep_order ? Order::kept : Order::left_out);
    RangeCoder<Mode::encode> conn, ordr;
    Models models;
    for (std::size_t p = 0; p < parts.size(); ++p) {
        const ConnectivityView &part = parts[p];
        for (const Kind kind : {faces, lines}) {
            const auto sizes = kind == faces ? part.face_sizes : part.line_sizes;
            const auto indices = kind == faces ? part.face_indices : part.line_indices;
            const i64 count = static_cast<i64>(sizes.size()), corners = static_cast<i64>(indices.size());
            code_head(conn, models, kind, {count, common_size(sizes), corners});
            if (sizes.empty()) continue;
            if (kind == faces) {
                code_choice(conn, models, choices[p]);
                if (choices[p].is_surface) {
                    const SourceMesh mesh(sizes, indices);
                    SourceOrder order;
                    const CodedSurface coded = models.surface->encode(conn, mesh, choices[p].has_border, order);
                    if (choices[p].has_order) models.order->encode(ordr, coded, order, mesh.used());
                    continue;
                }
            }
            encode_polygons(conn, *models.polygons[kind], kind, part.vertices, sizes, indices);
        }
    }
    return {conn.finish(), ordr.finish()};
}

std::vector<CodedOrder> coded_orders(std::span<const ConnectivityView> parts) {
    const std::vector<Choice> choices = choose(parts, Order::free);
    std::vector<CodedOrder> orders(parts.size());
    for (std::size_t p = 0; p < parts.size(); ++p) {
        if (!choices[p].is_surface) continue;
        const ConnectivityView &part = parts[p];
        const SourceMesh mesh(part.face_sizes, part.face_indices);
        RangeCoder<Mode::measure> coder;
        SurfaceModel model;
        SourceOrder source;
        const CodedSurface coded = model.encode(coder, mesh, choices[p].has_border, source);
        CodedOrder &order = orders[p];
        for (const i32 number : source.numbers) order.vertices.push_back(mesh.used()[number]);
        std::vector<bool> is_used(part.vertices);
        for (const i32 vertex : mesh.used()) is_used[vertex] = true;
        for (i64 vertex = 0; vertex < part.vertices; ++vertex) {
            if (!is_used[vertex]) order.vertices.push_back(static_cast<i32>(vertex));
        }
        // For each face of the source, find the coded corner that comes first in it, and from that the face's coded
        // corners.
        std::vector<i32> starts(coded.sizes.size() + 1), face_of(coded.border.sides.size());
        for (std::size_t face = 0; face < coded.sizes.size(); ++face) {
            starts[face + 1] = starts[face] + coded.sizes[face];
            for (i32 corner = starts[face]; corner < starts[face + 1]; ++corner)
                face_of[corner] = static_cast<i32>(face);
        }
        order.faces.resize(coded.sizes.size());
        order.corners.resize(coded.border.sides.size());
        i32 begin = 0;
        for (std::size_t face = 0; face < source.firsts.size(); ++face) {
            const i32 first = source.firsts[face], at = face_of[first], size = coded.sizes[at];
            order.faces[at] = static_cast<i32>(face);
            for (i32 place = 0; place < size; ++place) {
                order.corners[starts[at] + (first - starts[at] + place) % size] = begin + place;
            }
            begin += size;
        }
    }
    return orders;
}

std::vector<Connectivity> decode_connectivity(std::span<const u8> conn_bytes, std::span<const u8> ordr_bytes,
                                              std::span<const i64> vertices, i64 most_corners) {
    RangeCoder<Mode::decode> conn(conn_bytes), ordr(ordr_bytes);
    Models models;
    std::vector<Connectivity> parts;
    bool any_order = false;
    i64 corners = 0;
    for (const i64 count_of_vertices : vertices) {
        Connectivity part;
        part.vertices = count_of_vertices;
        for (const Kind kind : {faces, lines}) {
            const Head head = code_head(conn, models, kind, {0, 0, 0});
            if (head.count == 0) continue;
            check_head(kind, head, corners, most_corners);
            corners += head.corners;
            try {
                if (kind == faces) {
                    const Choice choice = code_choice(conn, models, {});
                    if (choice.is_surface) {
                        const CodedSurface coded =
                            models.surface->decode(conn, static_cast<i32>(head.size), choice.has_border, head.count,
                                                   head.corners, part.vertices);
                        if (!choice.has_order) {
                            part.face_sizes = coded.sizes;
                            for (const Border::Side &side : coded.border.sides)
                                part.face_indices.push_back(side.origin);
                            continue;
                        }
                        any_order = true;
                        try {
                            Faces found = models.order->decode(ordr, coded, part.vertices);
                            part.face_sizes = std::move(found.sizes);
                            part.face_indices = std::move(found.indices);
                        } catch (const CorruptError &error) {
                            throw CorruptError(Section("ORDR"), std::string(error.what()) + ", at its byte " +
                                                                    std::to_string(ordr.byte()));
                        }
                        continue;
                    }
                }
                std::vector<i32> sizes(head.count, static_cast<i32>(head.size)), indices(head.corners);
                models.polygons[kind]->code(conn, static_cast<i32>(head.size), smallest[kind], part.vertices,
                                            std::span<i32>(sizes), std::span<i32>(indices));
                (kind == faces ? part.face_sizes : part.line_sizes) = std::move(sizes);
                (kind == faces ? part.face_indices : part.line_indices) = std::move(indices);
            } catch (const CorruptError &error) {
                if (!error.section.empty()) throw;
                throw CorruptError(Section("CONN"),
                                   std::string(error.what()) + ", at its byte " + std::to_string(conn.byte()));
            }
        }
        parts.push_back(std::move(part));
    }
    conn.check_finished("CONN");
    if (!ordr_bytes.empty() && !any_order) {
        throw CorruptError(Section("ORDR"), "orders faces that section CONN does not have");
    }
    ordr.check_finished("ORDR");
    return parts;
}

}  // namespace pdeanim
