// SPDX-License-Identifier: Apache-2.0
// Builds the overlay, which is the second stage of a cut. The cavity is the set of triangles that
// the cut replaces (cavity.h). The overlay combines the boundary of the cavity and the tool's
// outline into one PSLG (planar straight-line graph), whose points are on the lattice and whose
// edges do not cross.
//
// If a tool edge crosses the sheet's boundary, the crossing need not be a lattice point. Both
// edges are therefore bent through a lattice point next to the crossing. The method is iterated
// snap rounding after Hobby 1999 and Halperin and Packer 2002, except that only edges that cross
// are bent. Contract:
//  1. The four lattice points around a crossing are candidates for the bend. The bend is the
//     nearest candidate on the material's side of the sheet's boundary, so that the boundary only
//     recedes. If no candidate lies on the material's side, the bend is the nearest candidate.
//     (Example: the material between two boundary edges is thinner than a lattice step, and bending
//     makes these two edges cross.)
//  2. The algorithm terminates. A bend replaces an edge by two edges in the edge's bounding box.
//     The Manhattan length of an edge is the sum of its horizontal and its vertical extent. The
//     Manhattan lengths of the two new edges are positive and add up to that of the replaced edge.
//     So the sum of the squares of all Manhattan lengths, an integer, decreases with every bend.
//  3. Edges shared with kept triangles (triangles outside the cavity) are never bent. If a bend
//     would move an edge of a kept triangle, or would cover a part of this triangle, `absorb` lists
//     the triangle, and the caller adds it to the cavity and starts again.
//  4. If no edges cross, nothing is bent.
//  5. If sheet and tool are moved by lattice steps or rotated by right angles, the overlay moves
//     and rotates with them and is otherwise the same. The overlay is also the same if the
//     triangles of the sheet or the corners of the tool are listed in another order. To achieve
//     this, two things are decided in the canonical rotation of cavity and tool
//     (rotation_by_moments()): the order in which edges are treated, and the choice between equally
//     near candidates (item 1). Item 5 does not hold if the canonical rotation is ambiguous, for
//     example because cavity and tool are symmetric under a rotation.
#pragma once

#include <cstdint>
#include <vector>

#include "formats/mesh/canonical_rotation.h"
#include "formats/mesh/cavity.h"

namespace trocar {

/// A straight edge of the overlay from point `a` to point `b`. Several edges of the cavity's
/// boundary and of the tool's outline, or parts of such edges, can run between these two points;
/// one strand stands for all of them.
struct Strand {
  LatticePoint first, second;  ///< points[a] and points[b]; `first` is smaller (by x, then y)
  std::uint32_t a, b;          ///< indices into Overlay::points
  /// Number of boundary edges of the cavity from a to b, minus the number of those from b to a.
  std::int32_t cavity = 0;
  /// Number of edges of the tool's outline from a to b, minus the number of those from b to a.
  std::int32_t tool = 0;
  std::uint32_t kept = kNoSlot;  ///< kept triangle that has this edge; kNoSlot: there is none
  bool kept_right = false;       ///< the kept triangle is on the right of a -> b
  bool gone = false;             ///< the strand has been split and replaced by two others
};

struct Overlay {
  /// Vertices on the cavity's boundary, corners of the tool, bends, and those vertices inside the
  /// cavity that the cut keeps.
  std::vector<LatticePoint> points;
  /// Strands that are not `gone` do not cross, and no point lies inside one of them.
  std::vector<Strand> strands;
  CanonicalRotation rotation;          ///< canonical rotation of cavity and tool (contract 5)
  std::vector<std::uint32_t> absorb;   ///< after kAgain: triangles to add to the cavity
  FlatTable point_at;                  ///< key: coordinates; value: index into `points`
  FlatTable strand_at;                 ///< key: a and b; value: the latest strand between them
  std::vector<std::uint32_t> pending;  ///< scratch: strands to be tested for crossings

  /// The Cavity::boundary_vertices, as indices in `points`.
  std::vector<std::uint32_t> boundary_point;
  /// Strand of each edge of Cavity::boundary before any split. If the edge was split, the strand is
  /// `gone`.
  std::vector<std::uint32_t> boundary_strand;

  void allocate(std::size_t max_triangles, std::size_t max_points, std::size_t max_strands);
  static std::uint64_t key(LatticePoint p) noexcept {
    return pair_key(static_cast<std::uint32_t>(p.x), static_cast<std::uint32_t>(p.y));
  }
};

/// Builds the overlay. If it returns kAgain, only `absorb` is valid. O(c^2), where c is the number
/// of edges of the cavity's boundary and of the tool together; for a puncture c is a few dozen.
StageOutcome build_overlay(const SheetMesh& mesh, const TriangleGrid& grid, const Cavity& cavity,
                           Overlay& out) noexcept;

}  // namespace trocar
