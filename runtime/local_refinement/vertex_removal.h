// SPDX-License-Identifier: Apache-2.0
// Removes an inner vertex from a SheetMesh. If the mesh is constrained Delaunay (point_insertion.h
// has the definition), it stays so. The triangles around the vertex form a polygon. The polygon is
// then filled by ears: an ear is a triangle of three successive corners of the polygon. An ear is
// used only if its circumcircle contains no other corner (the simple form of Devillers, 1999). All
// geometric tests are exact.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "runtime/sheet_mesh/sheet_edit.h"
#include "runtime/sheet_mesh/sheet_mesh.h"

namespace trocar::runtime {

/// plan() plans a removal, and remove() carries out the removal planned last. Neither allocates.
/// O(k^3) for k triangles around the vertex.
class VertexRemoval {
 public:
  /// A vertex with more triangles around it than this is not removed.
  static constexpr std::size_t kMaxDegree = 24;

  /// Plans the removal of the vertex at corner `corner` of triangle t. Returns false if the vertex
  /// lies on the sheet's boundary, if it has more than kMaxDegree triangles, or if ears with empty
  /// circumcircles do not fill the polygon.
  bool plan(const SheetMesh& mesh, std::uint32_t t, std::uint32_t corner) noexcept;
  /// After plan(): star() lists the triangles around the vertex. ear(0) to ear(ears() - 1) are the
  /// triangles that would replace them.
  std::span<const std::uint32_t> star() const noexcept { return {star_.data(), degree_}; }
  std::size_t ears() const noexcept { return degree_ - 2; }
  const Triangle& ear(std::size_t number) const noexcept { return ears_[number].corners; }

  /// Removes the vertex. Its slot and the slots of two triangles are free afterwards.
  void remove(SheetMesh& mesh, SheetEdit& edit) noexcept;

  /// After remove(): the slots of the triangles that fill the polygon, and the two freed slots.
  std::span<const std::uint32_t> filled() const noexcept { return {star_.data(), degree_ - 2}; }
  std::span<const std::uint32_t> freed() const noexcept { return {&star_[degree_ - 2], 2}; }

 private:
  // The neighbour beyond an edge. If is_ear is true, the neighbour is the ear `number`, and the
  // common edge is edge 2 of that ear. If is_ear is false, the neighbour is the triangle `number`
  // of the mesh, or there is none (kNoSlot).
  struct Beyond {
    bool is_ear;
    std::uint32_t number;
  };
  struct Ear {
    Triangle corners;
    std::array<Beyond, 2> across;  // neighbours beyond edges 0 and 1
  };

  bool is_ear(const SheetMesh& mesh, std::size_t previous, std::size_t at, std::size_t next,
              std::size_t size) const noexcept;

  std::size_t degree_ = 0;
  std::uint32_t vertex_ = kNoSlot;
  std::array<std::uint32_t, kMaxDegree> star_{};  // triangle slots
  // The part of the polygon that is not filled yet: its corners, counter-clockwise, and for each
  // corner the neighbour beyond the edge to the next corner.
  std::array<std::uint32_t, kMaxDegree> polygon_{};
  std::array<Beyond, kMaxDegree> beyond_{};
  std::array<Ear, kMaxDegree> ears_{};
  Beyond last_{};  // neighbour beyond edge 2 of the last ear
};

}  // namespace trocar::runtime
