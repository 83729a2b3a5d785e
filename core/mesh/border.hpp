// The border of a growing surface: rings of sides that lack a face across, and which of them is next.
//
// Faces are numbered as they are added, and so are their corners. The side of a corner runs from its vertex to that of the
// next corner of its face. Sides without a face on their other side form rings: every side is followed by one that begins
// where it ends. That is all that holds on any input; on a manifold surface the rings are its borders.
//
// The next side is that where the surface is most nearly closed already, measured by the angles that regular polygons
// would have there (Alliez and Desbrun 2001, "Valence-driven connectivity encoding for 3D meshes", choose by valence).
// Growing in this way, a surface stays without bays, whose shores would meet later at places that cost bits to name.
#pragma once

#include <vector>

#include "base/arithmetic.hpp"

namespace pdeanim {

class Border {
public:
    enum State : i32 { open, closed, inner };  // may have a face across, has none, has one and is in no ring

    struct Side {
        i32 origin = 0;                    // the vertex that it begins at
        i32 before = 0;                    // the corner before in its face
        i32 following = 0, preceding = 0;  // in its ring
        i32 state = open;
        i32 opposite = 0;            // the side across, or -1
        i32 later = 0, earlier = 0;  // neighbours in the queue of its priority, or -1
        i32 priority = 0;            // -1 where it is not queued
    };

    struct Vertex {
        i32 faces = 0;    // corners there
        i32 angle = 0;    // the sum of their angles, in units of 15 degrees
        i32 border = -1;  // a side from there that was in a ring when it was last looked at, or -1
    };

    Border(i64 corners, i64 vertices) : sides(corners), vertices(vertices), queues_(priorities, -1) {}

    // Take the front side of the highest queue, -1 if all are empty.
    i32 next_side();

    // Make the sides of a face that no side leads to a ring of its own; the origins of its corners are set.
    void start_ring(i32 first, i32 size);

    // Put a face across the side `gate`, which is in no queue, and mend the rings. The side of the face's first corner lies
    // across the gate; its corners `begin` to `end` - 1 are at vertices that the gate says nothing about: where such a
    // vertex is in a ring already, the rings are cut and joined crosswise.
    void attach(i32 gate, i32 first, i32 size, i32 begin, i32 end);

    std::vector<Side> sides;
    std::vector<Vertex> vertices;

private:
    // Queues: a vertex of five triangles, 5 * 4, beside another of as many is at 60; the last one holds all above.
    static constexpr i32 priorities = 128;
    static constexpr i32 most_angle = 1 << 16;  // far above all queues: sums stay numbers of 32 bits in any file

    void enqueue(i32 side);
    void dequeue(i32 side);
    void place_corners(i32 first, i32 size);
    void link(i32 side, i32 following);
    bool is_one_edge(i32 side, i32 following) const;
    void join(i32 side, i32 following);
    void requeue(i32 side);

    std::vector<i32> queues_;  // the first side of each, or -1
    i32 highest_ = 0;          // no queue above this one holds any
};

}  // namespace pdeanim
