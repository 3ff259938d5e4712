// SPDX-License-Identifier: Apache-2.0
// Lists what an edit of a SheetMesh has written, so that the edit can be undone, or repeated on a
// replica of the mesh, in time proportional to the edit.
//
// Contract (tests/runtime/mesh/sheet_edit_test.cpp):
//  1. An editing function calls touch_*() before it writes a slot, or uses the four functions below
//     that take and release slots and call touch_*() themselves.
//  2. undo() leaves the mesh as it was at begin(), in every slot and in the order of the free ones.
//  3. copy_to() makes a replica that was equal at begin() equal again, in the same sense.
//  4. No function but the constructor allocates. A slot is listed once, so the capacity suffices.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "runtime/mesh/flat_table.h"
#include "runtime/mesh/sheet_mesh.h"

namespace trocar::runtime {

class SheetEdit {
 public:
  /// A triangle's slot and what it held at begin().
  struct OldTriangle {
    std::uint32_t slot;
    Triangle corners;  ///< kFreeSlot: it was free
    std::array<std::uint32_t, 3> across;
  };
  struct OldVertex {
    std::uint32_t slot;
    LatticePoint point;
  };

  SheetEdit() = default;
  /// For edits of meshes with no more slots than `mesh`. O(slots).
  explicit SheetEdit(const SheetMesh& mesh);

  /// Starts a new edit of `mesh`: drops what was listed. O(1).
  void begin(const SheetMesh& mesh) noexcept;

  void touch_triangle(const SheetMesh& mesh, std::uint32_t t) noexcept;
  void touch_vertex(const SheetMesh& mesh, std::uint32_t v) noexcept;

  /// A free slot, now with these contents; kNone if there is none.
  std::uint32_t take_triangle(SheetMesh& mesh, const Triangle& corners) noexcept;
  std::uint32_t take_vertex(SheetMesh& mesh, LatticePoint point) noexcept;
  /// The slot is free afterwards. At the end of the edit nothing may refer to it.
  void release_triangle(SheetMesh& mesh, std::uint32_t t) noexcept;
  void release_vertex(SheetMesh& mesh, std::uint32_t v) noexcept;

  /// Every slot written, once, in the order in which they were first written.
  std::span<const OldTriangle> triangles() const noexcept { return triangles_; }
  std::span<const OldVertex> vertices() const noexcept { return vertices_; }

  /// Contract 2; afterwards the edit is as after begin().
  void undo(SheetMesh& mesh) noexcept;
  /// Contract 3. `from` is the mesh that was edited; it is only read.
  void copy_to(const SheetMesh& from, SheetMesh& to) const noexcept;

 private:
  // The stack of free slots: entries below `untouched` are unchanged; `popped` lists the former
  // entries above, the topmost first.
  struct Stack {
    std::size_t untouched = 0;
    std::vector<std::uint32_t> popped;
    void begin(const std::vector<std::uint32_t>& stack) noexcept;
    std::uint32_t pop(std::vector<std::uint32_t>& stack) noexcept;
    void undo(std::vector<std::uint32_t>& stack) const noexcept;
    void copy(const std::vector<std::uint32_t>& from,
              std::vector<std::uint32_t>& to) const noexcept;
  };

  std::vector<OldTriangle> triangles_;
  std::vector<OldVertex> vertices_;
  Stack free_triangles_, free_vertices_;
  FlatTable triangle_listed_, vertex_listed_;  ///< by slot
};

}  // namespace trocar::runtime
