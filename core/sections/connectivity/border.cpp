#include "sections/connectivity/surface.hpp"

namespace pdeanim {

namespace {

// Return the interior angle of a regular polygon in units of 15 degrees, rounded down: 4 for a triangle, 6 for a
// square.
constexpr i32 corner_angle(i32 size) {
    const i32 counted = least(size, 24);
    return 12 + static_cast<i32>(floor_divide(-24, counted));
}

}  // namespace

void Border::dequeue(i32 side) {
    const i32 priority = sides[side].priority;
    if (priority < 0) return;
    const i32 later = sides[side].later, earlier = sides[side].earlier;
    if (earlier >= 0) {
        sides[earlier].later = later;
    } else {
        queues_[priority] = later;
    }
    if (later >= 0) sides[later].earlier = earlier;
    sides[side].priority = -1;
}

// Move an open side to the front of the queue of its current priority, unless it is in that queue already.
void Border::enqueue(i32 side) {
    const i32 angle = vertices[sides[side].origin].angle;
    const i32 other = vertices[sides[sides[side].following].origin].angle;
    const i32 priority = least(2 * most(angle, other) + least(angle, other), priorities - 1);
    if (sides[side].priority == priority) return;
    dequeue(side);
    const i32 front = queues_[priority];
    sides[side].later = front;
    sides[side].earlier = -1;
    sides[side].priority = priority;
    if (front >= 0) sides[front].earlier = side;
    queues_[priority] = side;
    highest_ = most(highest_, priority);
}

i32 Border::next_side() {
    while (highest_ > 0 && queues_[highest_] < 0) --highest_;
    const i32 side = queues_[highest_];
    if (side >= 0) dequeue(side);
    return side;
}

// Count the corners of a new face at their vertices. None of its sides has an opposite side yet.
void Border::place_corners(i32 first, i32 size) {
    const i32 angle = corner_angle(size);
    i32 before = first + size - 1;
    for (i32 side = first; side < first + size; ++side) {
        Side &own = sides[side];
        own.before = before;
        own.state = open;
        own.opposite = own.priority = -1;
        Vertex &vertex = vertices[own.origin];
        ++vertex.faces;
        vertex.angle = least(vertex.angle + angle, most_angle);
        before = side;
    }
}

void Border::link(i32 side, i32 following) {
    sides[side].following = following;
    sides[following].preceding = side;
}

void Border::start_ring(i32 first, i32 size) {
    place_corners(first, size);
    for (i32 side = first; side < first + size; ++side) {
        link(sides[side].before, side);
        vertices[sides[side].origin].border = side;
    }
    for (i32 side = first; side < first + size; ++side) enqueue(side);
}

// Return whether a side and the one that follows it can be the two sides of one edge.
bool Border::is_one_edge(i32 side, i32 following) const {
    return side != following && sides[side].state == open && sides[following].state == open &&
           sides[side].origin == sides[sides[following].following].origin;
}

// Make a side and the one that follows it the two sides of one edge, and take both out of their ring.
void Border::join(i32 side, i32 following) {
    const i32 before = sides[side].preceding, after = sides[following].following;
    sides[side].state = sides[following].state = inner;
    sides[side].opposite = following;
    sides[following].opposite = side;
    dequeue(side);
    dequeue(following);
    if (before != following) {
        link(before, after);
        vertices[sides[after].origin].border = after;
        requeue(before);
        requeue(after);
    }
}

void Border::requeue(i32 side) {
    if (sides[side].state == open) enqueue(side);
}

void Border::attach(i32 gate, i32 first, i32 size, i32 begin, i32 end) {
    const i32 before = sides[gate].preceding, after = sides[gate].following;
    place_corners(first, size);
    sides[gate].state = sides[first].state = inner;
    sides[gate].opposite = first;
    sides[first].opposite = gate;
    i32 last = first + 1;  // takes the position of the gate in the ring
    link(last, after == gate ? last : after);
    if (before != gate) {
        link(before, last);
        vertices[sides[after].origin].border = after;
    }
    vertices[sides[last].origin].border = last;
    for (i32 place = 2; place < size; ++place) {
        const i32 side = first + place;
        Vertex &vertex = vertices[sides[side].origin];
        link(side, sides[last].following);
        link(last, side);
        if (begin <= place && place < end && vertex.border >= 0 && sides[vertex.border].state != inner) {
            const i32 crossing = vertex.border;
            link(sides[crossing].preceding, side);
            link(last, crossing);
        }
        vertex.border = side;
        last = side;
    }
    for (i32 side = first + 1; side < first + size; ++side) {
        if (is_one_edge(sides[side].preceding, side)) {
            join(sides[side].preceding, side);
        } else if (is_one_edge(side, sides[side].following)) {
            join(side, sides[side].following);
        }
    }
    for (i32 side = first + 1; side < first + size; ++side) {
        if (sides[side].state != open) continue;
        enqueue(side);
        // The caller's loop queues the other sides of this face.
        const i32 preceding = sides[side].preceding, following = sides[side].following;
        if (preceding != side - 1) requeue(preceding);
        if (following != side + 1) requeue(following);
    }
}

}  // namespace pdeanim
