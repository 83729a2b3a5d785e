// Section SOLD: the cells of objects whose solids are kept (27 of the specification), in the order of the source.
//
// A node is coded in one of four ways: as a difference that repeats, as in cells that a program numbered row by row; as
// the next new node; as a node of one of the latest cells at the node before, since cells share sides; or as a literal.
#pragma once

#include <span>
#include <vector>

#include "mesh/corner_table.hpp"

namespace pdeanim {

// Return section SOLD; empty if no object has cells.
std::vector<u8> encode_cells(std::span<const ConnectivityView> parts);

// Undo `encode_cells`, and add the cells to the objects. most_nodes: largest number of nodes of all cells, LimitError
// for more. CorruptError if the section is damaged.
void decode_cells(std::span<const u8> data, std::span<Connectivity> parts, i64 most_nodes);

}  // namespace pdeanim
