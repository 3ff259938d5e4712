// SPDX-License-Identifier: Apache-2.0
// Lists the slots (elements of the arrays of a SheetMesh) that an edit of the mesh has written.
// With these lists the edit can be undone, or repeated on a second copy of the mesh (a replica).
// The time for this is proportional to the number of listed slots, not to the size of the mesh.
//
// Contract (tests/runtime/sheet_mesh/sheet_edit_test.cpp):
//  1. Precondition: a function that edits the mesh calls touch_*() before it writes to a slot. It
//     takes and releases slots only by take_*() and release_*(), which update the lists.
//  2. undo() restores the mesh of begin() exactly: every slot and the order of the free slots.
//  3. If a replica was equal to the mesh at begin(), copy_to() makes the replica equal to the
//     edited mesh: every slot and the order of the free slots.
//  4. Only the constructor allocates. Each slot is listed at most once, so the capacity suffices.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "runtime/sheet_mesh/flat_table.h"
#include "runtime/sheet_mesh/sheet_mesh.h"

namespace trocar::runtime {

class SheetEdit {
 public:
  /// A triangle's slot and its content at begin().
  struct OldTriangle {
    std::uint32_t slot;
    Triangle corners;  ///< kFreeSlot if the slot was free
    std::array<std::uint32_t, 3> across;
  };
  /// A vertex's slot and its content at begin().
  struct OldVertex {
    std::uint32_t slot;
    LatticePoint point;
  };

  SheetEdit() = default;
  /// Allocates memory for edits of meshes with no more slots than `mesh`. O(slots).
  explicit SheetEdit(const SheetMesh& mesh);

  /// Starts a new edit of `mesh` and clears the lists. O(1).
  void begin(const SheetMesh& mesh) noexcept;

  /// Call this before you write to a slot. Lists the slot with its content, unless the slot is
  /// already listed.
  void touch_triangle(const SheetMesh& mesh, std::uint32_t t) noexcept;
  void touch_vertex(const SheetMesh& mesh, std::uint32_t v) noexcept;

  /// Takes a free slot, writes the given content to it, and returns its index. Returns kNone if
  /// there is no free slot.
  std::uint32_t take_triangle(SheetMesh& mesh, const Triangle& corners) noexcept;
  std::uint32_t take_vertex(SheetMesh& mesh, LatticePoint point) noexcept;
  /// Frees the slot. The caller must ensure that nothing refers to the slot at the end of the edit.
  void release_triangle(SheetMesh& mesh, std::uint32_t t) noexcept;
  void release_vertex(SheetMesh& mesh, std::uint32_t v) noexcept;

  /// The slots that were written since begin(), each once, in the order in which they were listed.
  std::span<const OldTriangle> triangles() const noexcept { return triangles_; }
  std::span<const OldVertex> vertices() const noexcept { return vertices_; }

  /// Undoes the edit (contract 2) and calls begin() for a new edit.
  void undo(SheetMesh& mesh) noexcept;
  /// Repeats the edit on the replica `to` (contract 3). `from` is the mesh that was edited.
  void copy_to(const SheetMesh& from, SheetMesh& to) const noexcept;

 private:
  // The changes to a stack of free slots since begin(). The lowest `untouched` entries of the stack
  // are unchanged. `popped` lists all other entries that the stack had at begin(), topmost first.
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
  FlatTable triangle_listed_, vertex_listed_;  ///< slots that are already listed
};

}  // namespace trocar::runtime
