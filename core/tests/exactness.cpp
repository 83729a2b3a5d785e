// Writes the data that a build decodes from files, so that builds can be compared: exactness FOLDER FILE...
//
// For each file NAME, these must be the same in every decoder: NAME.polygons, NAME.reference and NAME.coefficients have
// the integers whose digests are in the manifest; NAME.rest has names, attributes, times, fields, and every bit read,
// with its probability; NAME.error has the class of the error, its byte, frame and text, if the file is refused.
// NAME.points has the margin by which positions may differ (float64), then the positions (float32) of each run, at its
// frames and then between them.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

#include "decode/animation.hpp"

namespace {

using namespace pdeanim;

class Output {
public:
    explicit Output(const std::filesystem::path &path) : file_(path, std::ios::binary) {}

    template <class T> void write(const std::vector<T> &values) {
        file_.write(reinterpret_cast<const char *>(values.data()), values.size() * sizeof(T));
    }

    // Write the number of values first, so that two lists never run into each other.
    template <class T> void list(const std::vector<T> &values) {
        write(std::vector<i64>{static_cast<i64>(values.size())});
        write(values);
    }

    void list(const std::string &text) { list(std::vector<char>(text.begin(), text.end())); }

private:
    std::ofstream file_;
};

std::vector<i32> bits;  // each bit read and its probability

void write_polygons(const std::vector<Connectivity> &parts, Output &out) {
    for (const Connectivity &part : parts) {
        const auto write = [&](const std::vector<i32> &sizes, const std::vector<i32> &indices) {
            auto corner = indices.begin();
            for (const i32 size : sizes) {
                out.write(std::vector<i64>{size});
                out.write(std::vector<i64>(corner, corner + size));
                corner += size;
            }
        };
        write(part.face_sizes, part.face_indices);
        write(part.line_sizes, part.line_indices);
        auto node = part.cell_indices.begin();
        for (std::size_t cell = 0; cell < part.cell_sizes.size(); ++cell) {
            const i32 size = part.cell_sizes[cell];
            out.write(std::vector<i64>{size + 1, part.cell_shapes[cell]});
            out.write(std::vector<i64>(node, node + size));
            node += size;
        }
    }
}

// Write the quantised values, row after row, one row per function of space.
void write_coefficients(Animation &animation, Output &out) {
    for (std::size_t k = 0; k < animation.sections().table().groups().size(); ++k) {
        std::vector<i64> steps;
        const double step = animation.sections().table().groups()[k].step;
        for (const double value : animation.fields().coefficients(k)) steps.push_back(std::llround(value / step));
        out.write(steps);
    }
}

void write_rest(Animation &animation, Output &out) {
    for (const std::string &name : animation.sections().names()) out.list(name);
    for (const std::vector<Attribute> &own : animation.sections().attributes()) {
        for (const Attribute &attribute : own) {
            out.list(attribute.name);
            out.list(attribute.values);
            out.list(attribute.indices.value_or(std::vector<i32>()));
            for (const std::string &label : attribute.labels) out.list(label);
        }
    }
    out.list(animation.sections().times());
}

// Write the values of the fields that no group computes from positions: positions may differ.
void write_fields(Animation &animation, Output &out) {
    StoredFields &fields = animation.stored_fields();
    for (std::size_t k = 0; k < fields.headers().size(); ++k) {
        const FieldHeader &header = fields.headers()[k];
        out.list(header.name);
        if (std::ranges::any_of(header.groups, [](const FieldGroup &group) { return is_computed(group.code); }))
            continue;
        const i64 frames = animation.sections().frames();
        std::vector<u8> values(frames * fields.rows(k) * header.components * size_of_type(header.type));
        fields.read(k, 0, frames, values);
        out.list(values);
    }
}

// Append the positions of a run, and raise the margin to the difference that 19 of the specification allows for them.
void add_points(Animation &animation, double &margin, std::vector<float> &points) {
    for (const Group &group : animation.sections().table().groups()) {
        margin = std::max(margin, animation.sections().model().residual_step * (group.is_single ? 0x1p-11 : 0x1p-20));
    }
    std::vector<double> times = animation.sections().times();
    for (i64 frame = 1; frame < animation.sections().frames(); ++frame)
        times.push_back((times[frame - 1] + times[frame]) / 2);
    std::vector<float> own(times.size() * 3 * animation.sections().vertices());
    animation.evaluator().evaluate(Quantity::positions, times, std::nullopt, own);
    points.insert(points.end(), own.begin(), own.end());
}

void decode(const std::filesystem::path &folder, const std::filesystem::path &path) {
    std::ifstream file(path, std::ios::binary);
    const std::vector<char> read(std::istreambuf_iterator<char>(file), {});
    const std::vector<u8> data(read.begin(), read.end());
    const auto beside = [&](const char *ending) { return folder / (path.stem().string() + ending); };
    const auto refuse = [&](const char *kind, const std::exception &error, i64 byte, i64 frame) {
        std::ofstream(beside(".error"), std::ios::binary)
            << kind << ' ' << byte << ' ' << frame << ' ' << error.what() << '\n';
    };
    bits.clear();
    try {
        Animation::Options options;
        options.threads = 1;  // several threads would record bits in another order
        const auto file = std::make_shared<const File>(std::make_unique<MemorySource>(data), File::usual_memory);
        for (std::size_t run = 0; run < file->runs().size(); ++run) Animation(file, run, options).verify();
        bits.clear();
        Output polygons(beside(".polygons")), reference(beside(".reference")), coefficients(beside(".coefficients")),
            rest(beside(".rest")), positions(beside(".points"));
        double margin = 0.0;
        std::vector<float> points;
        for (std::size_t run = 0; run < file->runs().size(); ++run) {
            Animation animation(file, run, options);
            animation.verify();
            write_polygons(animation.sections().connectivity(), polygons);
            reference.write(animation.sections().reference().grid);
            write_coefficients(animation, coefficients);
            write_rest(animation, rest);
            write_fields(animation, rest);
            add_points(animation, margin, points);
        }
        positions.write(std::vector<double>{margin});
        positions.write(points);
        rest.list(bits);
    } catch (const CorruptError &error) {
        refuse("corrupt", error, error.offset, error.frame);
    } catch (const LimitError &error) {
        refuse("limit", error, -1, -1);
    }
}

}  // namespace

void pdeanim::note_bit(i32 probability, bool bit) { bits.insert(bits.end(), {probability, bit}); }

int main(int count, char **arguments) {
    if (count < 3) {
        std::fprintf(stderr, "usage: %s FOLDER FILE...\n", arguments[0]);
        return EXIT_FAILURE;
    }
    for (int k = 2; k < count; ++k) decode(arguments[1], arguments[k]);
    return EXIT_SUCCESS;
}
