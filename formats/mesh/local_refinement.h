// SPDX-License-Identifier: Apache-2.0
// Refinement of a part of a sheet in place: points inserted and removed, triangles queued.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "formats/mesh/sheet_mesh.h"
#include "formats/mesh/steiner_points.h"

namespace trocar {

// Inserts a point into a SheetMesh. If the mesh is constrained Delaunay, it stays so. A sheet is
// constrained Delaunay if, for each edge between two triangles, the two angles opposite the edge
// add up to at most 180 degrees. Only the edges of the sheet's boundary are constraints: a border
// between two materials inside the sheet is not one. The triangles whose circumcircles contain the
// point form the cavity. They are replaced by the star of the point, which consists of the
// triangles between the point and the edges of the cavity's boundary (Bowyer; Watson, 1981). All
// geometric tests are exact.

/// An edge of the cavity's boundary, with the cavity on its left.
struct CavityEdge {
  std::uint32_t from, to;  ///< vertex slots
  std::uint32_t beyond;    ///< the triangle outside the cavity; kNoSlot on the sheet's boundary
  TriangleEdge inside;     ///< the triangle in the cavity, and the index of the edge in it
};

enum class InsertionOutcome {
  kDone,
  /// A part of the cavity's boundary is not visible from the point, so that triangles of the star
  /// would overlap or have no area.
  kNotVisible,
  kCapacity,  ///< the mesh has too few free slots
};

/// find() finds a cavity, and insert() fills the cavity found last. Both take time proportional to
/// the cavity. Only the constructor allocates.
class PointInsertion {
 public:
  /// Largest number of triangles in a cavity. find() returns false for a larger cavity.
  static constexpr std::size_t kMaxCavity = 1024;

  PointInsertion(std::size_t vertex_slots, std::size_t triangle_slots);

  /// Finds the cavity of the point `p`, starting at the triangle `start`. Returns false if the
  /// circumcircle of `start` does not contain p, or if the cavity is too large.
  bool find(const SheetMesh& mesh, std::uint32_t start, LatticePoint p) noexcept;
  std::span<const CavityEdge> boundary() const noexcept { return boundary_; }
  std::span<const std::uint32_t> cavity() const noexcept { return cavity_; }

  /// Replaces the cavity by the star of p. `split` is kNoSlot, or the index in boundary() of an
  /// edge of the sheet's boundary that p splits. In the second case p must lie on that edge or on
  /// the edge's inner side. Two edges that meet at p then replace the split edge, and the area
  /// between the split edge and the two new edges no longer belongs to the sheet. If the result is
  /// not kDone, nothing is changed.
  InsertionOutcome insert(SheetMesh& mesh, SheetEdit& edit, LatticePoint p,
                          std::uint32_t split) noexcept;
  /// The star's triangles after insert(), each with p as its last corner.
  std::span<const std::uint32_t> star() const noexcept { return star_; }
  /// The slot of the vertex that insert() has added.
  std::uint32_t vertex() const noexcept { return vertex_; }

 private:
  std::vector<std::uint32_t> cavity_, star_;
  std::vector<CavityEdge> boundary_;
  std::uint32_t vertex_ = kNoSlot;
  // visited_[t]: number of the last call of find() whose cavity contains the triangle of slot t.
  std::vector<std::uint32_t> visited_;
  // starting_[v]: the triangle of the star whose edge 0 starts at the vertex of slot v.
  std::vector<std::uint32_t> starting_;
  std::uint32_t search_ = 0;  // number of the last call of find()
};

// A priority queue of triangle slots (places of a mesh for triangles). The queue is a heap and
// stores the position of each slot in the heap, so that a slot can be removed and its key can be
// changed. The queue can hold every slot of the mesh, and each slot occurs at most once.

/// The slot with the smallest key comes first; the caller chooses the keys. If keys are equal, the
/// lowest slot comes first. Only the constructor allocates. For n slots in the queue, put() and
/// remove() are O(log n), and clear() is O(n).
class TriangleQueue {
 public:
  explicit TriangleQueue(std::size_t triangle_slots) : position_(triangle_slots, kNoSlot) {
    heap_.reserve(triangle_slots);
  }

  bool empty() const noexcept { return heap_.empty(); }
  std::uint32_t top() const noexcept { return heap_.front().slot; }
  std::int64_t top_key() const noexcept { return heap_.front().key; }

  /// Inserts the slot, or changes its key.
  void put(std::uint32_t slot, std::int64_t key) noexcept {
    if (position_[slot] == kNoSlot) {
      position_[slot] = static_cast<std::uint32_t>(heap_.size());
      heap_.push_back({key, slot});
    } else {
      heap_[position_[slot]].key = key;
    }
    sift(position_[slot]);
  }

  /// Removes the slot. If the slot is not in the queue, nothing happens.
  void remove(std::uint32_t slot) noexcept {
    const std::uint32_t at = position_[slot];
    if (at == kNoSlot) return;
    position_[slot] = kNoSlot;
    const Entry last = heap_.back();
    heap_.pop_back();
    if (at == heap_.size()) return;
    heap_[at] = last;
    position_[last.slot] = at;
    sift(at);
  }

  void clear() noexcept {
    for (const Entry& entry : heap_)
      position_[entry.slot] = kNoSlot;
    heap_.clear();
  }

 private:
  struct Entry {
    std::int64_t key;
    std::uint32_t slot;
    bool operator<(const Entry& other) const noexcept {
      return key != other.key ? key < other.key : slot < other.slot;
    }
  };

  void sift(std::uint32_t at) noexcept {
    for (; at > 0 && heap_[at] < heap_[(at - 1) / 2]; at = (at - 1) / 2)
      exchange(at, (at - 1) / 2);
    while (true) {
      std::uint32_t least = at;
      for (std::uint32_t child = 2 * at + 1; child <= 2 * at + 2 && child < heap_.size(); ++child) {
        if (heap_[child] < heap_[least]) least = child;
      }
      if (least == at) return;
      exchange(at, least);
      at = least;
    }
  }

  void exchange(std::uint32_t i, std::uint32_t j) noexcept {
    std::swap(heap_[i], heap_[j]);
    position_[heap_[i].slot] = i;
    position_[heap_[j].slot] = j;
  }

  std::vector<Entry> heap_;
  std::vector<std::uint32_t> position_;  // per slot: position in the heap, or kNoSlot
};

// Removes an inner vertex from a SheetMesh. If the mesh is constrained Delaunay (as above
// has the definition), it stays so. The triangles around the vertex form a polygon. The polygon is
// then filled by ears: an ear is a triangle of three successive corners of the polygon. An ear is
// used only if its circumcircle contains no other corner (the simple form of Devillers, 1999). All
// geometric tests are exact.

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

// Refines a part of a sheet, in place: inserts vertices until the triangles have a minimum angle,
// where the outline permits it. On request it also limits the size of the triangles, and this limit
// may grow with the distance from a point. The method is Ruppert's Delaunay refinement (1995), with
// Uengoer's off-centres (2004) as positions of new vertices. As in Chew's second algorithm (1993),
// inner vertices can also be removed (contract 3). If a triangle is too large, the new vertex is
// placed so that, where possible, its distance from both ends of the triangle's shortest edge is
// the wanted length of edges (Rebay, 1993).
//
// Contract, for a valid SheetMesh:
//  1. The mesh stays valid. An inner edge (between two triangles) is locally Delaunay if the two
//     angles opposite the edge add up to at most 180 degrees. If every inner edge was locally
//     Delaunay, every inner edge still is.
//  2. Twice the mesh's area falls by exactly `doubled_area_lost`. Without `split_outline` this is
//     0. No point outside the material becomes material.
//  3. Vertices on the boundary stay. Inner vertices may be removed if they make a triangle sharp
//     or a boundary edge obtuse, but not if this refinement has added them. A triangle is sharp if
//     it has an angle below min_angle_deg. A boundary edge is obtuse if the angle opposite the
//     edge is above 90 degrees, so that the edge's spring has a negative stiffness. The SheetEdit
//     lists all slots written.
//  4. Only the seeds (the triangles at which the caller starts the refinement) and new triangles
//     are inspected, so the time does not depend on the size of the sheet.
//  5. The function terminates, at the latest after max_new_vertices new vertices, and never
//     allocates. The same mesh, seeds and options give the same result. If neither `size` nor
//     `split_outline` is used, and the mesh is moved by lattice steps or rotated by right angles,
//     the result moves and rotates with it, bit by bit.
//  6. Without `split_outline` each boundary edge is an old boundary edge or a part of an old one.
//     It is obtuse only if the old edge was obtuse. With `split_outline` and the outcome kDone, no
//     boundary edge of an inspected triangle is obtuse, except edges for which `keep_edge` is true.

struct LocalRefinementOptions {
  /// Smallest angle of a triangle, where the outline permits it; 0 allows any angle. A value above
  /// 30 is treated as 30, because with larger angles the method might not come to an end before it
  /// has added max_new_vertices vertices.
  double min_angle_deg = 20;
  /// Wanted length of edges at the point (x, y). Length and coordinates are in steps. If empty, any
  /// length is allowed. A triangle is too large if its circumradius is above kMaxRadius times the
  /// wanted length at its centroid. At the outline, triangles that are too large may remain. Their
  /// size alone is no reason to split a boundary edge.
  FunctionRef<double(double x, double y)> size;
  std::uint32_t max_new_vertices = 256;  ///< refinement stops after this many new vertices
  /// True: a boundary edge may be split at a lattice point beside the edge, less than a step from
  /// the edge on the material's side. The sheet then loses a little area, so this is meant for
  /// temporary meshes. False: a boundary edge is split only at a lattice point on the edge, so that
  /// the outline does not change.
  bool split_outline = false;
  /// Returns true for a boundary edge that must not be split, for example because a part of a sheet
  /// was copied and the edge is the part's border to the rest of the sheet. `from` and `to` are the
  /// edge's ends, in the direction in which the edge runs in its triangle. If empty, any boundary
  /// edge may be split.
  FunctionRef<bool(std::uint32_t from, std::uint32_t to)> keep_edge;
};
/// Largest allowed circumradius of a triangle, as a fraction of the wanted length of edges. (In an
/// equilateral triangle the circumradius is 0.58 times the edge length.)
inline constexpr double kMaxRadius = 0.8;

enum class LocalRefinementOutcome {
  kDone,              ///< finished: `sharp` and `obtuse_edges` are 0
  kLimitedByOutline,  ///< finished, but `sharp` or `obtuse_edges` is above 0
  kBudget,            ///< stopped after max_new_vertices new vertices
  kCapacity,          ///< stopped: no slot of the mesh is free, or the scratch memory is too small
};

struct LocalRefinementResult {
  LocalRefinementOutcome outcome = LocalRefinementOutcome::kDone;
  std::uint32_t vertices_added = 0;
  std::uint32_t vertices_removed = 0;
  std::int64_t doubled_area_lost = 0;  ///< twice the area that the mesh lost, steps^2, >= 0
  std::uint32_t inspected = 0;         ///< number of inspected triangles that exist at the end
  std::uint32_t sharp = 0;             ///< inspected triangles with an angle below min_angle_deg
  std::uint32_t sharp_at_outline = 0;  ///< sharp triangles that remain because of the outline
  std::uint32_t sharp_at_lattice = 0;  ///< sharp triangles that remain because of rounding
  std::uint32_t too_large = 0;         ///< inspected triangles larger than `size` allows
  /// Number of obtuse boundary edges (contract 3) of inspected triangles, not counting edges for
  /// which keep_edge is true.
  std::uint32_t obtuse_edges = 0;
};

/// Scratch memory that is reused from one refinement to the next, for meshes with at most the given
/// numbers of slots. Construction takes O(slots).
class LocalRefinementWorkspace {
 public:
  LocalRefinementWorkspace(std::size_t vertex_slots, std::size_t triangle_slots);
  explicit LocalRefinementWorkspace(const SheetMesh& mesh)
      : LocalRefinementWorkspace(mesh.vertices.size(), mesh.triangles.size()) {}

 private:
  friend class LocalRefiner;
  PointInsertion insertion_;
  VertexRemoval removal_;
  TriangleQueue queue_;
  // Notes of LocalRefiner. All elements are 0 between refinements.
  std::vector<std::uint8_t> marks_;   // marks_[t]: bits of triangle slot t, such as "inspected"
  std::vector<std::uint8_t> is_new_;  // is_new_[v] is 1 if this refinement added vertex slot v
};

/// Refines `mesh` around the triangles `seeds`. Seeds whose slots are not in use are skipped.
/// Precondition: SheetEdit::begin() has been called for this mesh. `edit` may already list earlier
/// changes. The time is O(k log k) for k triangles that are seeds or new, plus O(entries of
/// `edit`).
LocalRefinementResult refine_locally(SheetMesh& mesh, SheetEdit& edit,
                                     std::span<const std::uint32_t> seeds,
                                     const LocalRefinementOptions& options,
                                     LocalRefinementWorkspace& workspace) noexcept;

// Chooses the position at which refinement splits a boundary edge of a sheet. Near an acute corner
// the positions lie on circles around the corner. Without these circles, the splits of the two
// edges at the corner might make each other necessary without end.

/// Returns the wanted position of the next split of the boundary edge `e`. Repeated splits divide
/// the edge into about `parts` (at least 2) equal parts. Exception: if exactly one end of the edge
/// is an acute corner (kAcuteCorner_deg), `parts` has no effect, and the position lies on a circle
/// around that corner. The radius of the circle, in steps, is a power of two, so that both edges at
/// the corner are split on the same circles. O(triangles at the edge's ends).
SplitAim aim_split(const SheetMesh& mesh, TriangleEdge e, int parts) noexcept;

}  // namespace trocar
