#include "decode/run_sections.hpp"

#include <algorithm>
#include <cmath>
#include <latch>
#include <thread>

#include "decode/fields.hpp"
#include "mesh/curves.hpp"
#include "sections/connectivity/cells.hpp"
#include "sections/connectivity/solids.hpp"
#include "sections/reference/reference.hpp"
#include "sections/spatial/still_vertices.hpp"

namespace pdeanim {

namespace {

// Peak memory that a file declares: per vertex of a mesh (curves, reference frame, positions between frames), per corner
// of its connectivity, and per node of its cells (sides of solids, corners of the inner ones).
constexpr u64 bytes_per_vertex = 600, bytes_per_corner = 128, bytes_per_cell_node = 320;

// Peak memory of an empty group (its row of the table with spare room, the cached group, Python's numbers) and of an
// empty object (lists, a name and arrays, most of it in Python).
constexpr u64 bytes_per_group = 1536, bytes_per_object = 4096;

// Peak memory per byte of a name: the spare room of a string, and Python's four bytes per character.
constexpr u64 bytes_per_name_byte = 6;

// Return the faces of all objects, then their lines as pieces of two corners. The vertices of all objects are numbered
// consecutively.
Polygons polygons_of(std::span<const Connectivity> parts) {
    Polygons mesh;
    std::size_t corners = 0, polygons = 0;  // upper bounds
    for (const Connectivity &part : parts) {
        corners += part.face_indices.size() + 2 * part.line_indices.size();
        polygons += part.face_sizes.size() + part.line_indices.size();
    }
    mesh.vertex.reserve(corners);
    mesh.starts.reserve(polygons + 1);
    i64 shift = 0;
    for (const Connectivity &part : parts) {
        for (const i32 index : part.face_indices) mesh.vertex.push_back(static_cast<i32>(index + shift));
        for (const i32 size : part.face_sizes) mesh.starts.push_back(mesh.starts.back() + size);
        shift += part.vertices;
    }
    mesh.faces = static_cast<i64>(mesh.starts.size()) - 1;
    mesh.vertices = shift;
    shift = 0;
    for (const Connectivity &part : parts) {
        std::size_t at = 0;
        for (const i32 size : part.line_sizes) {
            for (i32 k = 0; k + 1 < size; ++k) {
                mesh.vertex.push_back(static_cast<i32>(part.line_indices[at + k] + shift));
                mesh.vertex.push_back(static_cast<i32>(part.line_indices[at + k + 1] + shift));
                mesh.starts.push_back(mesh.starts.back() + 2);
            }
            at += size;
        }
        shift += part.vertices;
    }
    return mesh;
}

std::vector<ConnectivityView> views_of(std::span<const Connectivity> parts) {
    std::vector<ConnectivityView> found;
    for (const Connectivity &part : parts) found.push_back(view_of(part));
    return found;
}

// Peak memory per element: its node and its share of the node above, their functions and two-scale matrices, and the
// reference frame.
constexpr u64 bytes_per_element = 2048;

// Values of functions of space are kept if they take at most this share (1 / 8) of the remaining memory.
constexpr u64 memory_shares = 8;

}  // namespace

RunSections::RunSections(std::shared_ptr<const File> file, std::size_t run, int threads, Turns &turns)
    : file_(std::move(file)), container_(file_->container_of(run)), memory_(file_->memory()), threads_(threads),
      turns_(turns), sequence_(file_->sequence_of(run)) {
    read_vertex_counts(run);
    memory_.take(bytes_per_vertex * vertices(), std::to_string(vertices()) + " vertices");
    memory_.take(bytes_per_object * objects(), std::to_string(objects()) + " objects");
    table_.emplace(container_, frames(), static_cast<i64>(memory_.left() / bytes_per_group));
    memory_.take(bytes_per_group * table_->groups().size(),
                 std::to_string(table_->groups().size()) + " groups of frames");
    model_ = Model::of_bytes(container_.read("MODL"));
}

// Read the head of section CONN: the number of vertices of each object.
void RunSections::read_vertex_counts(std::size_t run) {
    polygons_ = container_.read("CONN");
    FieldReader fields(polygons_, "CONN");
    const i64 count = fields.count(), most_objects = static_cast<i64>(memory_.left() / bytes_per_object);
    for (i64 object = 0; object < count; ++object) {
        if (object == most_objects) memory_.take(memory_.left() + 1, "too many objects");
        const i64 own = fields.count(), before = first_vertices_.back();
        first_vertices_.push_back(own > Run::most_vertices - before ? Run::most_vertices + 1 : before + own);
    }
    if (vertices() < 1 || vertices() > Run::most_vertices) {
        throw CorruptError(Section("CONN"),
                           "declares no vertices or too many, the most is " + std::to_string(Run::most_vertices));
    }
    const i64 declared = file_->runs()[run].vertices;
    if (declared >= 0 && vertices() != declared) {
        throw CorruptError(Section("CONN"), "declares " + std::to_string(vertices()) + " vertices, section RUNS " +
                                                std::to_string(declared));
    }
    const std::span<const u8> rest = fields.rest();
    polygons_ = std::vector<u8>(rest.begin(), rest.end());
}

i64 RunSections::frame_at(double time) const {
    return std::upper_bound(times().begin(), times().end(), time) - times().begin() - 1;
}

std::span<const double> RunSections::times_of(const Group &group) const {
    return {times().data() + group.first, static_cast<std::size_t>(group.frames)};
}

ClosedForm RunSections::closed_form(std::size_t index) const {
    const Group &group = table_->groups()[index];
    return ClosedForm(times_of(group), group.alpha, group.functions);
}

const std::vector<std::string> &RunSections::names() {
    const auto guard = turns_.take();
    if (!names_) {
        names_ = sequence_.names(objects(), [&](i64 size) {
            memory_.take(bytes_per_name_byte * static_cast<u64>(size), "names of objects");
        });
    }
    return *names_;
}

std::shared_ptr<const std::vector<Connectivity>> RunSections::shared_connectivity() {
    const auto guard = turns_.take();
    if (!connectivity_) {
        std::vector<i64> counts;
        for (i64 object = 0; object < objects(); ++object)
            counts.push_back(first_vertex(object + 1) - first_vertex(object));
        const std::vector<u8> orders = container_.read_optional("ORDR");
        const i64 most = static_cast<i64>(memory_.left() / bytes_per_corner);
        std::vector<Connectivity> found = decode_connectivity(polygons_, orders, counts, most);
        for (const Connectivity &part : found) {
            memory_.take(bytes_per_corner * (part.face_indices.size() + part.line_indices.size()), "corners of faces");
        }
        if (const std::vector<u8> cells = container_.read_optional("SOLD"); !cells.empty()) {
            decode_cells(cells, found, static_cast<i64>(memory_.left() / bytes_per_cell_node));
            u64 nodes = 0;
            for (const Connectivity &part : found) nodes += part.cell_indices.size();
            memory_.take(bytes_per_cell_node * nodes, "nodes of cells");
            predicted_on_ = with_inner_sides(found);
        }
        connectivity_ = std::make_shared<const std::vector<Connectivity>>(std::move(found));
    }
    return connectivity_;
}

std::vector<ConnectivityView> RunSections::views() { return views_of(connectivity()); }

const std::vector<Connectivity> &RunSections::predicted_on() {
    const std::vector<Connectivity> &own = connectivity();
    return predicted_on_ ? *predicted_on_ : own;
}

const Reference &RunSections::reference() {
    const auto guard = turns_.take();
    if (!reference_) {
        const std::vector<u8> data = container_.read("REST");
        FieldReader fields(data, "REST");
        Reference found;
        found.step = fields.real();
        for (double &coordinate : found.origin) coordinate = fields.real();
        const u8 predictor = fields.integer<u8>();
        if (predictor >= reference_kinds) {
            throw CorruptError(Section("REST"), "names predictor " + std::to_string(predictor) +
                                                    ", this decoder has 0 to " + std::to_string(reference_kinds - 1));
        }
        if (predictor & ties_vertices && !(predictor & welds_points)) {
            throw CorruptError(Section("REST"), "ties vertices that it does not weld");
        }
        bool is_sound = found.step > 0.0 && found.step <= limits::largest_step;
        for (const double coordinate : found.origin)
            is_sound = is_sound && std::abs(coordinate) <= limits::largest_step;
        if (!is_sound) throw CorruptError(Section("REST"), "has a quantisation step or an origin out of range");
        DecodedReference decoded = decode_reference(polygons_of(predicted_on()), predictor, fields.rest());
        found.grid = std::move(decoded.grid);
        found.ties = std::move(decoded.ties);
        found.is_smoothed = predictor & smooths_points;
        if (found.is_smoothed) found.step = std::ldexp(found.step, -smooth_bits);
        found.points.reserve(3 * found.grid.size());
        for (const GridPoint &point : found.grid) {
            for (int axis = 0; axis < 3; ++axis) {
                found.points.push_back(found.origin[axis] + static_cast<double>(point[axis]) * found.step);
            }
        }
        reference_ = std::move(found);
    }
    return *reference_;
}

std::shared_ptr<const std::vector<std::vector<Attribute>>> RunSections::shared_attributes() {
    const auto guard = turns_.take();
    if (!attributes_) {
        const std::vector<u8> data = container_.read_optional("ATTR");
        std::vector<std::vector<Attribute>> found(objects());
        if (!data.empty()) {
            const std::vector<GridPoint> &grid = reference().grid;
            TakenMemory taken(memory_);
            found = decode_attributes(data, views(), grid, taken);
            of_attributes_ = std::move(taken);
        }
        attributes_ = std::make_shared<const std::vector<std::vector<Attribute>>>(std::move(found));
    }
    return attributes_;
}

const std::vector<u8> &RunSections::remarks() {
    const auto guard = turns_.take();
    if (!remarks_) remarks_ = file_->container().read_optional("META");
    return *remarks_;
}

std::unique_ptr<GroupsAhead> RunSections::begin_ahead(std::span<const std::size_t> groups) {
    if (space_ || threads_ < 2) return std::make_unique<GroupsAhead>();
    return std::make_unique<GroupsAhead>(container_, *table_, groups);
}

u8 RunSections::reference_kind() const {
    constexpr u64 predictor_offset = 32;
    const SectionEntry &entry = container_.entry("REST");
    std::vector<u8> predictor;
    if (entry.length > predictor_offset) container_.read_range(entry.offset + predictor_offset, 1, predictor);
    return predictor.empty() ? 0 : predictor[0];
}

std::vector<u8> RunSections::still_vertices() const {
    return model_.still.empty() ? std::vector<u8>() : decode_still(model_.still, first_vertices_);
}

std::shared_ptr<const SpaceLayout> RunSections::layout_of(std::shared_ptr<const Patches> patches) const {
    return std::make_shared<const SpaceLayout>(SpaceLayout::of_bytes(model_.form, std::move(patches), model_.layout));
}

// Take the memory for elements, and for building their functions in each thread.
TakenMemory RunSections::take_elements(const Patches &patches) {
    i64 largest = 0;
    for (i64 e = 0; e < patches.count(); ++e) largest = most(largest, patches.size(e));
    const u64 making = ElementFunctions::bytes(largest, model_.form.functions) * static_cast<u64>(threads_);
    return TakenMemory(memory_, bytes_per_element * static_cast<u64>(patches.count()) + making, "patches of vertices");
}

// Patches for a mesh without coincident vertices. They are made while the reference frame is decoded, and then
// coefficients are decoded for them.
struct RunSections::EarlyPatches {
    std::shared_ptr<Patches> patches;  // null if a vertex has no neighbour
    TakenMemory taken;
    std::shared_ptr<const SpaceLayout> layout;
    std::exception_ptr failure;
    std::latch made{1};
    std::jthread thread;  // used if no groups are decoded ahead
};

// Begin to make early patches; null if they would be wrong because vertices are welded, or if no thread is free.
std::shared_ptr<RunSections::EarlyPatches> RunSections::begin_early_patches(GroupsAhead *ahead) {
#if defined(__wasm__)
    constexpr bool has_threads = false;  // a web page downloads this code
#else
    constexpr bool has_threads = true;
#endif
    if (!has_threads || threads_ < 2 || reference_ || reference_kind() & welds_points) return nullptr;
    auto early = std::make_shared<EarlyPatches>();
    const auto make = [this, ahead, own = early.get(), parts = views_of(predicted_on())] {
        GroupCoefficients *coefficients = nullptr;
        try {
            own->patches = early_patches(parts, model_.form.points, still_vertices());
            if (own->patches) {
                own->taken = take_elements(*own->patches);
                own->layout = layout_of(own->patches);
            }
            if (own->layout && ahead) {
                coefficients = ahead->make_coefficients(own->layout, own->taken.another());
            }
        } catch (const CorruptError &) {
            // This is no error: early patches may differ from the real ones, and are then not used.
        } catch (...) {
            own->failure = std::current_exception();
        }
        own->made.count_down();
        if (coefficients) coefficients->decode();
    };
    if (ahead) {
        ahead->insert([make, early] { make(); });
    } else {
        early->thread = std::jthread(make);
    }
    return early;
}

// Return the layout of the space basis of patches. Unless vertices coincide, patches follow from connectivity alone.
// They are then made, and coefficients decoded, while the reference frame is decoded.
std::shared_ptr<const SpaceLayout> RunSections::layout_of_patches(GroupsAhead *ahead) {
    const std::vector<ConnectivityView> parts = views_of(predicted_on());
    const std::shared_ptr<EarlyPatches> early = begin_early_patches(ahead);
    reference();
    if (early) early->made.wait();
    if (early && early->failure) std::rethrow_exception(early->failure);
    std::shared_ptr<Patches> patches = build_patches(parts, reference().grid, model_.form.points, reference().ties,
                                                     still_vertices(), early ? early->patches : nullptr);
    if (early && early->layout && patches == early->patches) {
        of_elements_ = std::move(early->taken);
        return early->layout;
    }
    if (ahead) ahead->drop_coefficients();
    of_elements_ = take_elements(*patches);
    return layout_of(std::move(patches));
}

std::shared_ptr<const SpaceLayout> RunSections::layout_of_curves() {
    const std::vector<ConnectivityView> parts = views_of(predicted_on());
    Curves curves = extract_curves(parts, reference().grid);
    auto pieces = std::make_shared<const Patches>(cut_curves(std::move(curves.order), std::move(curves.starts),
                                                             model_.form.points, reference().ties, still_vertices()));
    of_elements_ = take_elements(*pieces);
    return layout_of(std::move(pieces));
}

const SpaceBasis &RunSections::space(GroupsAhead *ahead) {
    const auto guard = turns_.take();
    if (!space_) {
        auto layout = model_.form.kind == SpaceKind::patch ? layout_of_patches(ahead) : layout_of_curves();
        // Use only the idle processors: a thread without a processor would make the others wait.
        const int threads = most(threads_ - (ahead ? ahead->busy() : 0), 1);
        space_ = std::make_unique<SpaceBasis>(std::move(layout), reference().grid, threads);
        const u64 bytes = static_cast<u64>(space_->bytes_to_keep());
        if (table_->groups().size() > 1 && bytes <= memory_.left() / memory_shares) {
            memory_.take(bytes, "functions of space");
            space_->keep_functions();
        }
    }
    return *space_;
}

}  // namespace pdeanim
