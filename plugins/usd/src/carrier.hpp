// The scene around the motion, section SCEN: the files of a USD stage without the arrays that the other sections hold.
#pragma once

#include <map>
#include <memory>
#include <string>
#include <vector>

#include "usd_headers.hpp"

namespace pdeanim_usd {

// An array of a layer that the decoder restores.
struct CutArray {
    SdfPath attribute;
    int object;
    std::string array, part;  // "faceVertexCounts", "faceVertexIndices" or an attribute, and which of its arrays
};

// A sample of a layer that a field restores.
struct CutSample {
    std::string file, field;
    SdfPath attribute;
    int object;
    double code, time;  // [time codes], [s]
    std::size_t rows;
};

class Carrier {
public:
    // Read section SCEN of a file, `size` bytes at `offset`. Raise Failure if it is damaged, or if what it unpacks to takes more
    // than `max_memory` bytes.
    Carrier(std::shared_ptr<ArAsset> asset, std::uint64_t offset, std::uint64_t size, std::uint64_t max_memory);

    // Whether the scene is a USD stage.
    bool is_usd() const { return family_ == "usd"; }

    // Whether a file is in the scene, by its path below the folder of the root layer.
    bool has(const std::string &name) const { return streams_.contains("files/" + name); }

    // Return the content of a file. Raise Failure if it is damaged.
    std::string content(const std::string &name) const { return unpacked("files/" + name); }

    // Count memory that showing the scene takes [bytes]. Raise Failure if all of it is more than the limit.
    void reserve(std::uint64_t bytes) const;

    // Path of the root layer below its folder.
    const std::string &root() const { return root_; }
    const std::vector<CutSample> &samples() const { return samples_; }

    // Return the arrays that a layer lacks.
    std::vector<CutArray> arrays_of(const std::string &file) const;

private:
    struct Stream {
        std::uint64_t offset, packed, size;
        std::uint32_t checksum;
    };

    std::string unpacked(const std::string &name) const;
    void read_cuts();

    std::shared_ptr<ArAsset> asset_;
    std::uint64_t max_memory_;
    mutable std::uint64_t reserved_ = 0;
    std::string family_, root_;
    std::map<std::string, Stream> streams_;
    std::multimap<std::string, CutArray> arrays_;
    std::vector<CutSample> samples_;
};

}  // namespace pdeanim_usd
