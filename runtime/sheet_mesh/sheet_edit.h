// SPDX-License-Identifier: Apache-2.0
// Lists the slots (elements of the arrays of a SheetMesh) that an edit of the mesh has written.
// With these lists the edit can be undone, or repeated on a second copy of the mesh (a replica).
// The time for this is proportional to the number of listed slots, not to the size of the mesh.
//
// Contract (tests/runtime/sheet_mesh/sheet_edit_test.cpp):
//  1. Precondition: a function that edits the mesh calls touch_*() before it writes to a slot. It
//     takes and releases slots only by take_*() and release_*(), which update the lists.
//  2. undo() restores the mesh exactly as it was at begin(): every slot and the order of
//     the free slots.
//  3. If a replica was equal to the mesh at begin(), SheetChange::copy_to() makes the replica equal
//     to the edited mesh: every slot and the order of the free slots.
//  4. Only the constructor allocates. Each slot is listed at most once, so the capacity suffices.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "runtime/sheet_mesh/flat_table.h"
#include "runtime/sheet_mesh/sheet_mesh.h"

namespace trocar::runtime {

/// The slots that an edit has written. Together with the edited mesh, they suffice to repeat the
/// edit on a replica.
struct SheetChange {
  /// A triangle's slot and its content before the edit.
  struct OldTriangle {
    std::uint32_t slot;
    Triangle corners;  ///< kFreeSlot if the slot was free
    std::array<std::uint32_t, 3> across;
  };
  /// A vertex's slot and its content before the edit.
  struct OldVertex {
    std::uint32_t slot;
    LatticePoint point;
  };

  std::vector<OldTriangle> triangles;  ///< each slot once, in the order in which they were listed
  std::vector<OldVertex> vertices;     ///< each slot once, in the order in which they were listed
  /// SheetMesh::free_triangles and SheetMesh::free_vertices are stacks of free slots. These two
  /// numbers say how many entries at the bottom of each stack the edit has not changed.
  std::size_t untouched_free_triangles = 0, untouched_free_vertices = 0;

  /// Repeats the edit on the replica `to` (contract 3). `from` is the mesh that was edited.
  void copy_to(const SheetMesh& from, SheetMesh& to) const noexcept;
};

class SheetEdit {
 public:
  using OldTriangle = SheetChange::OldTriangle;
  using OldVertex = SheetChange::OldVertex;

  SheetEdit() = default;
  /// Allocates memory for edits of meshes with no more slots than `mesh`. O(slots).
  explicit SheetEdit(const SheetMesh& mesh)
      : SheetEdit(mesh.vertices.size(), mesh.triangles.size()) {}
  SheetEdit(std::size_t vertex_slots, std::size_t triangle_slots);

  /// Starts a new edit of `mesh` and clears the lists. O(1).
  void begin(const SheetMesh& mesh) noexcept;

  /// Call this before you write to a slot. Lists the slot with its content, unless the slot is
  /// already listed.
  void touch_triangle(const SheetMesh& mesh, std::uint32_t t) noexcept;
  void touch_vertex(const SheetMesh& mesh, std::uint32_t v) noexcept;

  /// Takes a free slot, writes the given content to it, and returns its index. Returns kNoSlot if
  /// there is no free slot.
  std::uint32_t take_triangle(SheetMesh& mesh, const Triangle& corners) noexcept;
  std::uint32_t take_vertex(SheetMesh& mesh, LatticePoint point) noexcept;
  /// Frees the slot. The caller must ensure that nothing refers to the slot at the end of the edit.
  void release_triangle(SheetMesh& mesh, std::uint32_t t) noexcept;
  void release_vertex(SheetMesh& mesh, std::uint32_t v) noexcept;

  /// The slots that were written since begin(), each once, in the order in which they were listed.
  std::span<const OldTriangle> triangles() const noexcept { return change_.triangles; }
  std::span<const OldVertex> vertices() const noexcept { return change_.vertices; }
  const SheetChange& change() const noexcept { return change_; }

  /// Undoes the edit (contract 2) and calls begin() for a new edit.
  void undo(SheetMesh& mesh) noexcept;

 private:
  // Pops a slot from a stack of free slots. `untouched` is SheetChange::untouched_free_triangles or
  // untouched_free_vertices. `popped` lists the entries that the stack had at begin() and that have
  // been popped since then, topmost first.
  static std::uint32_t pop(std::vector<std::uint32_t>& stack, std::size_t& untouched,
                           std::vector<std::uint32_t>& popped) noexcept;

  SheetChange change_;
  std::vector<std::uint32_t> popped_triangles_, popped_vertices_;
  FlatTable triangle_listed_, vertex_listed_;  ///< slots that are already listed
};

}  // namespace trocar::runtime
