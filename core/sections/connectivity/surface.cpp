#include "sections/connectivity/surface.hpp"

#include <algorithm>
#include <numeric>

#include "base/errors.hpp"

namespace pdeanim {

namespace {

// Number of steps along the border in which a known vertex is searched; keeps the time linear.
constexpr int farthest = 200;
constexpr i32 last_told_size = 10;  // sizes up to this are coded by yes or no, larger ones as numbers

}  // namespace

SourceMesh::SourceMesh(std::span<const i32> sizes, std::span<const i32> indices) : sizes_(sizes) {
    const i64 corners = static_cast<i64>(indices.size());
    used_.assign(indices.begin(), indices.end());
    std::sort(used_.begin(), used_.end());
    used_.erase(std::unique(used_.begin(), used_.end()), used_.end());
    const i64 count = static_cast<i64>(used_.size());
    vertex_.resize(corners);
    face_.resize(corners);
    if (used_.back() - used_.front() + 1 == count) {
        for (i64 c = 0; c < corners; ++c) vertex_[c] = indices[c] - used_.front();
    } else {
        for (i64 c = 0; c < corners; ++c) {
            vertex_[c] = static_cast<i32>(std::lower_bound(used_.begin(), used_.end(), indices[c]) - used_.begin());
        }
    }
    std::vector<i64> side(corners), reverse(corners);
    i64 first = 0;
    for (i64 face = 0; face < static_cast<i64>(sizes.size()); ++face) {
        firsts_.push_back(static_cast<i32>(first));
        for (i64 place = 0; place < sizes[face]; ++place) {
            const i64 corner = first + place, next = first + (place + 1) % sizes[face];
            face_[corner] = static_cast<i32>(face);
            side[corner] = vertex_[corner] * count + vertex_[next];
            reverse[corner] = vertex_[next] * count + vertex_[corner];
        }
        first += sizes[face];
    }
    members_.resize(corners);
    std::iota(members_.begin(), members_.end(), 0);
    std::stable_sort(members_.begin(), members_.end(), [&](i32 a, i32 b) { return side[a] < side[b]; });
    std::vector<i64> sides;
    for (i64 k = 0; k < corners; ++k) {
        if (k == 0 || side[members_[k]] != sides.back()) {
            sides.push_back(side[members_[k]]);
            group_starts_.push_back(static_cast<i32>(k));
        }
    }
    group_starts_.push_back(static_cast<i32>(corners));
    across_.resize(corners);
    for (i64 c = 0; c < corners; ++c) {
        const auto found = std::lower_bound(sides.begin(), sides.end(), reverse[c]);
        across_[c] = found != sides.end() && *found == reverse[c] ? static_cast<i32>(found - sides.begin()) : -1;
    }
}

// The state of the encoder for one mesh.
struct SurfaceEncoding {
    explicit SurfaceEncoding(const SourceMesh &source)
        : mesh(source), next_of_group(source.group_starts_), is_coded(source.faces()), numbers(source.used_.size(), -1),
          corner_of(source.corners()) {}

    // Return the first corner whose face is not coded and whose side runs opposite to this corner's side; -1 if there
    // is none.
    i32 face_across(i32 corner) {
        const i32 group = mesh.across_[corner];
        if (group < 0) return -1;
        for (; next_of_group[group] < mesh.group_starts_[group + 1]; ++next_of_group[group]) {
            const i32 member = mesh.members_[next_of_group[group]];
            if (!is_coded[mesh.face_[member]]) return member;
        }
        return -1;
    }

    // Return the first corner of the next face that is not coded.
    i32 next_seed() {
        while (is_coded[seed]) ++seed;
        return mesh.firsts_[seed];
    }

    i32 size_of_face(i32 corner) const { return mesh.sizes_[mesh.face_[corner]]; }

    // Record that the face of `corner` is coded: its corners, beginning with `corner`, get the numbers from `first` on.
    void take(i32 corner, i32 first) {
        const i32 face = mesh.face_[corner], begin = mesh.firsts_[face], size = mesh.sizes_[face];
        is_coded[face] = true;
        for (i32 place = 0; place < size; ++place) corner_of[first + place] = begin + (corner - begin + place) % size;
    }

    i32 vertex(i32 corner) const { return mesh.vertex_[corner_of[corner]]; }

    SourceOrder order() const {
        std::vector<i32> places(corner_of.size());
        for (std::size_t corner = 0; corner < corner_of.size(); ++corner) {
            places[corner_of[corner]] = static_cast<i32>(corner);
        }
        SourceOrder found;
        for (const i32 first : mesh.firsts_) found.firsts.push_back(places[first]);
        found.numbers.resize(numbers.size());
        for (std::size_t v = 0; v < numbers.size(); ++v) found.numbers[numbers[v]] = static_cast<i32>(v);
        return found;
    }

    const SourceMesh &mesh;
    std::vector<i32> next_of_group;
    std::vector<bool> is_coded;
    std::vector<i32> numbers;    // coded number of each vertex, or -1
    std::vector<i32> corner_of;  // source corner of each coded corner
    i32 seed = 0;
};

template <Mode mode> class SurfaceCoder {
public:
    SurfaceCoder(RangeCoder<mode> &coder, SurfaceModel &model, CodedSurface &surface, SurfaceEncoding *source)
        : coder_(coder), model_(model), border_(surface.border), sides_(border_.sides), surface_(surface),
          source_(source) {}

    void code(i32 common_size, bool has_border) {
        const i64 faces = static_cast<i64>(surface_.sizes.size()), most_corners = static_cast<i64>(sides_.size());
        i64 corners = 0;
        i32 known = 0;
        for (i64 face = 0; face < faces; ++face) {
            i32 gate, source = -1;
            while (true) {
                gate = border_.next_side();
                if (gate < 0) break;
                if constexpr (encoding) source = source_->face_across(source_->corner_of[gate]);
                if (!has_border || !code_border(gate, source < 0)) break;
                sides_[gate].state = Border::closed;
            }
            i32 size = common_size;
            if constexpr (encoding) {
                if (gate < 0) source = source_->next_seed();
                if (size == 0) size = source_->size_of_face(source);
            }
            if (common_size == 0) size = code_size(gate, size);
            surface_.sizes[face] = size;
            if (corners + size > most_corners - 3 * (faces - 1 - face)) broken();
            const i32 first = static_cast<i32>(corners);
            if constexpr (encoding) source_->take(source, first);
            i32 begin = 0, end = size;
            if (gate >= 0) {
                sides_[first].origin = sides_[sides_[gate].following].origin;
                sides_[first + 1].origin = sides_[gate].origin;
                code_closing(gate, first, size, begin, end);
            }
            for (i32 place = begin; place < end; ++place) {
                i32 vertex = -1;
                if constexpr (encoding) vertex = source_->numbers[source_->vertex(first + place)];
                vertex = code_vertex(gate, place, known, vertex);
                if (vertex < 0 || vertex >= static_cast<i32>(border_.vertices.size())) broken();
                if (vertex == known) {
                    ++known;
                    if constexpr (encoding) source_->numbers[source_->vertex(first + place)] = vertex;
                }
                sides_[first + place].origin = vertex;
            }
            if (gate >= 0) {
                border_.attach(gate, first, size, begin, end);
            } else {
                border_.start_ring(first, size);
            }
            corners += size;
        }
        if (corners != most_corners) broken();
        surface_.vertex_count = known;
    }

private:
    static constexpr bool encoding = mode != Mode::decode;
    static constexpr int F = SurfaceModel::F, A = SurfaceModel::A, S = SurfaceModel::S;

    [[noreturn]] void broken() const { throw CorruptError("holds a surface that does not fit its faces and vertices"); }

    int faces(i32 vertex) const { return least(border_.vertices[vertex].faces, i32{SurfaceModel::most_faces}); }
    int angle(i32 vertex) const { return least(border_.vertices[vertex].angle / 2, i32{SurfaceModel::most_angle}); }

    // Return the number of corners of the face that has the side `gate`, at most most_size.
    int inner_size(i32 gate) const {
        int size = 1;
        for (i32 corner = sides_[gate].before; corner != gate && size < SurfaceModel::most_size; ++size) {
            corner = sides_[corner].before;
        }
        return size;
    }

    // Code whether there is no face across `gate`.
    bool code_border(i32 gate, bool is_closed) {
        const i32 before = sides_[gate].preceding, after = sides_[gate].following;
        const int beside = 2 * (sides_[before].state == Border::closed) + (sides_[after].state == Border::closed);
        const int from = faces(sides_[gate].origin), to = faces(sides_[after].origin);
        const bool bit = coder_.template mixed<3>(
            {&model_.border_[(from * F + to) * 4 + beside], &model_.border_recent_[model_.borders_],
             &model_.border_beside_[beside * 8 + (model_.borders_ & 7)]},
            model_.border_weights_.data(), is_closed);
        model_.borders_ = (2 * model_.borders_ + bit) & 255;
        return bit;
    }

    // Code the number of corners of the face across `gate`; if `gate` is -1, of a face that begins a new component.
    i32 code_size(i32 gate, i32 size) {
        int inner = 0, from_faces = 0, to_faces = 0, from_angle = 0, to_angle = 0;
        if (gate >= 0) {
            const i32 start = sides_[gate].origin, stop = sides_[sides_[gate].following].origin;
            inner = inner_size(gate);
            from_faces = faces(start), to_faces = faces(stop);
            from_angle = angle(start), to_angle = angle(stop);
        }
        const int last = least(model_.last_size_, i32{SurfaceModel::most_size});
        const int before = least(model_.size_before_, i32{SurfaceModel::most_size});
        i32 told = 3;
        for (; told <= last_told_size; ++told) {
            auto &models = model_.sizes_[least(told - 3, SurfaceModel::told_sizes - 1)];
            if (coder_.template mixed<3>({&models.angles[from_angle * A + to_angle], &models.recent[last * S + before],
                                          &models.faces[(from_faces * F + to_faces) * S + inner]},
                                         models.weights.data(), size == told)) {
                break;
            }
        }
        if (told > last_told_size) {
            const i64 more = model_.large_size_.code(coder_, size - told);
            if (more > static_cast<i64>(sides_.size())) broken();
            told += static_cast<i32>(more);
        }
        model_.size_before_ = model_.last_size_;
        model_.last_size_ = told;
        return told;
    }

    // Code which corners of the face across `gate` lie at the border's vertices before and after the gate. The others
    // are `begin` to `end` - 1.
    void code_closing(i32 gate, i32 first, i32 size, i32 &begin, i32 &end) {
        const i32 start = sides_[gate].origin, stop = sides_[sides_[gate].following].origin;
        const i32 neighbour_after = sides_[sides_[sides_[gate].following].following].origin;
        const int opposite = faces(sides_[sides_[gate].before].origin);
        begin = 2, end = size;
        i32 refused = -1;
        int closings = 0;
        for (int way = 0; way < 2; ++way) {
            i32 border = way ? sides_[gate].following : sides_[gate].preceding;
            // If the candidate is a corner of the face, no more corners close in this direction.
            i32 closing = way ? stop : start, other = way ? start : stop;
            int closed = 0;
            while (begin < end && border != gate && sides_[border].state == Border::open) {
                const i32 candidate = way ? sides_[sides_[border].following].origin : sides_[border].origin;
                if (begin == end - 1 && candidate == refused) break;
                const int special = way ? closings : candidate == neighbour_after;
                const i32 place = first + (way ? end - 1 : begin);
                const int around = angle(closing) * S + least(size, i32{SurfaceModel::most_size});
                auto &models = model_.closings_[way];
                bool closes = false;
                if constexpr (encoding) closes = source_->numbers[source_->vertex(place)] == candidate;
                if (!coder_.template mixed<3>({&models.beyond[(faces(closing) * F + faces(candidate)) * 2 + special],
                                               &models.opposite[(faces(closing) * F + opposite) * F + faces(other)],
                                               &models.recent[around * 64 + model_.closed_recently_]},
                                              models.weights.data(), closes)) {
                    refused = candidate;
                    break;
                }
                sides_[place].origin = candidate;
                if (way) {
                    --end;
                    border = sides_[border].following;
                } else {
                    ++begin;
                    border = sides_[border].preceding;
                }
                other = closing;
                closing = candidate;
                closed = 1;
            }
            closings = 2 * closings + closed;
        }
        model_.closed_recently_ = (4 * model_.closed_recently_ + closings) & 63;
    }

    // Return the distance of a vertex from `gate` along its ring; 0 if it is farther than `farthest` steps. The
    // vertices after the gate are at 1, 3, 5, ..., those before it at 2, 4, 6, ...
    i32 distance_of(i32 gate, i32 vertex) const {
        i32 ahead = sides_[gate].following, behind = gate;
        for (i32 step = 1; step <= farthest; ++step) {
            ahead = sides_[ahead].following;
            behind = sides_[behind].preceding;
            if (sides_[ahead].origin == vertex) return 2 * step - 1;
            if (sides_[behind].origin == vertex) return 2 * step;
        }
        return 0;
    }

    i32 vertex_at(i32 gate, i64 distance) const {
        i32 ahead = sides_[gate].following, behind = gate;
        for (i64 step = 0; step < (distance + 1) / 2; ++step) {
            ahead = sides_[ahead].following;
            behind = sides_[behind].preceding;
        }
        return sides_[distance % 2 ? ahead : behind].origin;
    }

    // Code the vertex of a corner that does not close the border. Return `known` if the vertex is new (-1 when
    // encoding), else the earlier vertex.
    i32 code_vertex(i32 gate, i32 place, i32 known, i32 vertex) {
        const bool anew = gate < 0;
        if (coder_.bit(model_.new_vertex_[4 * anew + least(place, 3)], vertex < 0)) return known;
        if (!anew) {
            const i64 distance = model_.distance_.code(coder_, encoding ? distance_of(gate, vertex) : 0);
            if (distance > 2 * farthest) broken();
            if (distance) return vertex_at(gate, distance);
        }
        const i64 back = model_.number_.code(coder_, static_cast<i64>(known) - 1 - vertex);
        if (back >= known) broken();
        return static_cast<i32>(known - 1 - back);
    }

    RangeCoder<mode> &coder_;
    SurfaceModel &model_;
    Border &border_;
    std::vector<Border::Side> &sides_;
    CodedSurface &surface_;
    SurfaceEncoding *source_;
};

SurfaceModel::SurfaceModel() : border_(F * F * 4), border_recent_(256), border_beside_(32) {}

template <Mode mode> CodedSurface SurfaceModel::encode(RangeCoder<mode> &coder, const SourceMesh &mesh, bool has_border,
                                                       SourceOrder &order) {
    CodedSurface surface(mesh.faces(), mesh.corners(), static_cast<i64>(mesh.used().size()));
    SurfaceEncoding source(mesh);
    const auto sizes = mesh.sizes();
    const bool is_common = std::all_of(sizes.begin(), sizes.end(), [&](i32 size) { return size == sizes[0]; });
    SurfaceCoder<mode>(coder, *this, surface, &source).code(is_common ? sizes[0] : 0, has_border);
    order = source.order();
    return surface;
}

template CodedSurface SurfaceModel::encode(RangeCoder<Mode::encode> &, const SourceMesh &, bool, SourceOrder &);
template CodedSurface SurfaceModel::encode(RangeCoder<Mode::measure> &, const SourceMesh &, bool, SourceOrder &);

CodedSurface SurfaceModel::decode(RangeCoder<Mode::decode> &coder, i32 common_size, bool has_border, i64 faces,
                                  i64 corners, i64 vertices) {
    CodedSurface surface(faces, corners, least(vertices, corners));
    SurfaceCoder<Mode::decode>(coder, *this, surface, nullptr).code(common_size, has_border);
    return surface;
}

}  // namespace pdeanim
