// SPDX-License-Identifier: Apache-2.0
// A region of a sheet around the tool: its mesh, its equilibrium, and its shape.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <span>
#include <vector>

#include "formats/base/result.h"
#include "formats/mesh/cut.h"
#include "formats/mesh/local_refinement.h"
#include "formats/mesh/sheet_mesh.h"
#include "formats/mesh/slice_mesh.h"
#include "runtime/haptics/membrane/network.h"

namespace trocar::runtime {

// Copies the part of a sheet around the tool into a separate mesh. From this copy, region.h makes a
// region: it cuts the tool's outline out and refines the mesh. The stiffness under the tool is
// computed on the region.

/// A circle around the tool, in lattice steps.
struct Circle {
  Eigen::Vector2d centre = Eigen::Vector2d::Zero();
  double radius = 0;
};
/// Returns the circle whose centre is the mean of the tool's corners and whose radius is the
/// distance of the farthest corner. For a regular polygon this is the circumscribed circle.
/// `tool` must not be empty.
Circle circle_around(const Ring& tool) noexcept;

/// A directed edge of the sheet with the copied part on its left and the rest of the sheet
/// on its right.
struct OuterEdge {
  LatticePoint from, to;
  // NOLINTNEXTLINE(modernize-use-nullptr): clang-tidy 14 takes the comparison with 0 for a pointer
  friend auto operator<=>(const OuterEdge&, const OuterEdge&) = default;
};

struct SheetPart {
  SliceMesh mesh;                                    ///< a valid mesh
  std::vector<std::array<std::uint32_t, 3>> across;  ///< neighbours, as in SheetMesh::across
  std::vector<std::uint32_t> parent;                 ///< slot of each vertex in the sheet
  std::vector<OuterEdge> outer;  ///< the part's border to the rest of the sheet, in ascending order
};

/// Returns the part of the sheet around `circle`. The part consists of the triangles `seeds`, and
/// of every near triangle that is connected with the seeds through near triangles. A triangle is
/// near if its distance from the disc within `circle` is less than `radius` lattice steps.
/// (`radius` is not Circle::radius.) The search starts at the seeds, in their order, and goes
/// outwards from triangle to triangle (breadth first). So the same arguments give the same part, in
/// the same order. `queue` is scratch memory. O(part log part).
SheetPart part_around(const SheetMesh& sheet, std::span<const std::uint32_t> seeds,
                      const Circle& circle, double radius, std::vector<std::uint32_t>& queue);

// Factors the matrix of a network's free nodes as L D L^T (L is lower triangular, D diagonal), so
// that the equations for the displacements can be solved quickly. The method is an up-looking
// factorisation along the elimination tree (Davis, "Algorithm 849", 2005), in the approximate
// minimum degree order that Eigen computes.
//
// Eigen's SimplicialLDLT could replace this class, but its results differ from those of this
// class in the last bits. Recordings with the force law `network` depend on these results, and a
// new version of the program should make the same recordings with the virtual clock as the old
// version. This is why the class is kept. Its speed alone would not justify keeping it: one run of
// `deformation_bench --benchmark_filter='factor|solve|answer'` compared the class with Eigen (medians).
//  - To factor the matrix of 100 to 10,000 nodes, Eigen takes 1.1 to 1.2 times as long as this
//    class. For 40,000 nodes it takes the same time.
//  - To solve the equations, Eigen takes 1.2 to 1.4 times as long.
//  - To compute the response of a sheet to the tool at a new position (sheet_law.h), the program
//    with Eigen would take 1.03 times as long.
//  - To calibrate a sheet's stiffness (sheet_law.h), it would take 1.02 times as long.

/// A factorisation. After make() it does not change, so any thread may read it. The unknowns are
/// the displacements of the free nodes, in the order of elimination.
class SparseFactor {
 public:
  SparseFactor() = default;

  /// Factors the rows and columns of the network's matrix that belong to free nodes. `kind`: kind
  /// of each node, network.size() elements. The matrix is positive definite even if springs have
  /// negative stiffness (network.h, law 2). Rounding, or a foundation of stiffness 0, can
  /// nevertheless make a pivot (an element of D) zero or negative. The function then returns false,
  /// and the factor is empty. Otherwise it returns true. Allocates. O(n^1.5) for the n free nodes
  /// of a planar mesh.
  bool make(const Network& network, std::span<const NodeKind> kind);

  std::size_t size() const noexcept { return inverse_pivot_.size(); }
  /// Number of entries of L below the diagonal.
  std::size_t entries() const noexcept { return row_.size(); }

  /// The node of each unknown, as an index in the network.
  std::span<const std::uint32_t> nodes() const noexcept { return node_; }

  /// Solves the equations. `x` has one element for each unknown: the force on its node in N when
  /// the function is called, and the displacement of its node in m when the function returns. Does
  /// not allocate. O(entries()).
  void solve(std::span<double> x) const noexcept;

 private:
  std::vector<std::uint32_t> node_;    ///< node of each unknown
  std::vector<std::uint32_t> first_;   ///< column k of L: elements first_[k] to first_[k + 1] - 1
  std::vector<std::uint32_t> row_;     ///< row of each element of L below the diagonal
  std::vector<double> value_;          ///< value of each element of L below the diagonal
  std::vector<double> inverse_pivot_;  ///< 1 / D for each unknown
};

// Computes the equilibrium of the spring network of a region, which is the part of a sheet around
// the tool. The tool nodes (NodeKind::kTool) are held at the tool's depth. The ring is the region's
// border to the rest of the sheet. Its nodes (NodeKind::kBorder) are held at 0, although they would
// move a little in the whole sheet. solve_local() also bounds the error that this causes.
//
// Let w be the equilibrium of the whole sheet's network and v the equilibrium of the region, both
// for tool depth 1. Let F_w and F_v be the forces on the tool in these two equilibria. Let g_m be
// the force of the springs on ring node m in the equilibrium v, positive in the direction in which
// the tool pushes:
//   g_m = sum of k_mj v_j over the neighbours j of m that are not on the ring.
//
// Laws:
//  1. F_w <= F_v, because the ring is an additional support. F_w >= F_n, where F_n is the force on
//     the tool if the ring nodes are free and the sheet beyond the ring is omitted. Both
//     inequalities hold even if some springs have a negative stiffness, because the springs of a
//     triangle together never store a negative energy.
//  2. Let M be the maximum of w on the ring, and let v be 0 beyond the ring. If no spring has a
//     negative stiffness, then 0 <= w - v <= M everywhere (maximum principle, network.h). A bound B
//     on M follows from the balance of forces at the ring node where w = M. Beyond the ring, w is
//     at most M. Inside the ring, w is at most v + M p, where p is the equilibrium with the ring at
//     1 and the tool at 0. The balance of forces therefore gives M <= B with
//       B = max over the ring nodes m of g_m / (f_m + s_m),
//     where f_m is the stiffness of the foundation (the springs that hold each node at its rest
//     position, network.h) at m, and s_m is the sum of k_mj (1 - p_j) over the neighbours j of m
//     that are not on the ring.
//  3. By reciprocity (the network's matrix is symmetric), F_v - F_w = sum over the ring nodes m of
//     g_m w_m. So F_v - F_w is at most B times the sum of all g_m.

/// Bounds on the errors that arise because the ring is held at 0, in the symbols of the laws above.
struct RingBounds {
  double force = 0;         ///< upper bound of (F_v - F_w) / F_v; in [0, 1]
  double displacement = 0;  ///< upper bound of max |w - v| / depth; in [0, 1]
  /// True if no spring at a free node of the region is negative. Both bounds are then proved,
  /// provided that no spring beyond the ring is negative either. If false, `displacement` is only
  /// an estimate, but `force` is proved all the same, because it then follows from law 1:
  /// (F_v - F_n) / F_v.
  bool proved = true;
};

/// Equilibrium of a region for tool depth 1.
struct LocalSolution {
  SparseFactor factor;
  /// Displacement of each node (v of the laws above): 1 at the tool nodes, 0 at the ring nodes.
  std::vector<double> w;
  double stiffness_N_per_m = 0;  ///< sum of the tool nodes' reactions
  /// Both bounds are 0 if there are no ring nodes, if LocalOptions::bounds is false, or if the
  /// stiffness is not positive.
  RingBounds bounds;
};

struct LocalOptions {
  bool bounds = true;  ///< if false, the bounds are not computed, which saves time
};

/// Solves a region. `kind`: kind of each node, network.size() elements. Returns true if the region
/// is solved. If the matrix is not positive definite, returns false, and
/// `solution` is unspecified. The function allocates, so the haptic thread must not call it.
bool solve_local(const Network& network, std::span<const NodeKind> kind, LocalSolution& solution,
                 const LocalOptions& options = {});

// Makes a region: the mesh of the part of a sheet around the tool. A worker thread makes a region
// to compute the stiffness at one tool position (sheet_law.h). The tool's outline is cut out of the
// mesh as for a puncture, because the tool is rigid and the sheet under the tool does not bend. The
// mesh is refined towards the tool, where the sheet is steepest.
//
// Contract:
//  1. With radius R, the mesh contains every point of the sheet that meets three conditions. The
//     point is nearer than R to the tool's circle (circle_around()). It is connected with
//     the tool through such points. And it is not under the tool.
//  2. The ring is the border between the region and the rest of the sheet. Each boundary edge of
//     the mesh lies on the tool, on the ring, or on the sheet's outline. Nodes on the tool are
//     kTool, nodes on the ring are kBorder, and all other nodes are kFree (NodeKind). A node of
//     the sheet's outline is kTool as well if it is nearer to the tool than 2 lattice steps or 2 %
//     of the tool's circumradius, because the gap between outline and tool is a thin wedge there.
//     No ring node is nearer to the circle than R. With infinite R there is no ring. Edges on the
//     ring are whole edges of the sheet, so there is no gap between the region's mesh and the rest
//     of the sheet.
//  3. `under_tool` is the material under the tool. Its area is exactly the area that was removed
//     when the tool was cut out.
//  4. The time is proportional to the size of the region, not to the size of the sheet.
//  5. If sheet and tool are moved by lattice steps or rotated by right angles, the region is
//     moved and rotated with them, and is otherwise the same to the bit. This does not hold if
//     the tool and the sheet around it have no unique canonical rotation, for example because
//     they are symmetric (formats/mesh/canonical_rotation.h).

/// Size of the triangles. At the tool, the edge length is `at_tool` times the tool's circumradius.
/// At the distance d from the tool, the edge length is larger by `grade` times d. If the membrane
/// is calibrated (sheet_law.h) and the decay length is at least 1.5 circumradii, the defaults
/// give about 200 free nodes. The stiffness under a hexagon then differs by at most 1 % from the
/// exact stiffness. If the hexagon is near an edge or a hole of the sheet, the difference is mostly
/// at most 1.5 % (deformation_accuracy_test.cpp).
struct Grading {
  bool graded = true;  ///< if false, no refinement: only the cut changes the sheet's triangles
  double at_tool = 0.33;
  double grade = 0.4;
  std::uint32_t max_new_vertices = 2000;  ///< largest number of vertices that refinement adds
};

struct RegionOptions {
  double radius_m = std::numeric_limits<double>::infinity();  ///< R, positive
  Grading grading;
};

/// The part of the sheet under the tool. This part moves with the tool, so its Winkler foundation
/// acts on the tool directly.
struct MaterialUnderTool {
  double area_steps2 = 0;
  /// First moment of the area: the area times the vector from RegionMesh::origin to its centroid.
  Eigen::Vector2d moment_steps3 = Eigen::Vector2d::Zero();
};

struct RegionMesh {
  SliceMesh mesh;              ///< valid; empty if the tool misses or covers the sheet
  std::vector<NodeKind> kind;  ///< kind of each vertex
  LatticePoint origin;         ///< point near the tool's centre, to which moments refer
  MaterialUnderTool under_tool;
};

/// Scratch memory that is reused from one region to the next, so that later regions allocate
/// little. Only one thread at a time may use a workspace.
struct RegionWorkspace {
  std::vector<std::uint32_t> queue;                  ///< slots of triangles
  std::size_t vertex_slots = 0, triangle_slots = 0;  ///< capacity of the three members below
  SheetEdit edit;
  CutWorkspace cut;
  std::optional<LocalRefinementWorkspace> refinement;
};

/// Makes the region of a tool position. Preconditions: `sheet` is valid, and `seeds` includes the
/// slots of all triangles that contain a point of the tool (triangle_grid.h finds these triangles).
/// Seeds that do not overlap the tool are ignored. `tool`: as for cut()
/// (formats/mesh/cut.h). If no part of the tool lies over material, the mesh is empty, and
/// the area of `under_tool` is 0. Errors: those of cut(); also kRefused if the tool has fewer than
/// three corners, or if the radius is not positive.
Result<RegionMesh> make_region(const SheetMesh& sheet, std::span<const std::uint32_t> seeds,
                               const Ring& tool, const Lattice& lattice,
                               const RegionOptions& options, RegionWorkspace& workspace);

/// Returns the seeds whose triangles have an area in common with the tool, in the same order. A
/// seed that occurs several times in `seeds` is returned as many times.
std::vector<std::uint32_t> seeds_under_tool(const SheetMesh& sheet,
                                            std::span<const std::uint32_t> seeds, const Ring& tool);

// Computes the shape of a sheet and the force on the tool by force propagation. A scene can choose
// this approximate method instead of the default solver.
// Sources: the paper (II.C, which follows its reference [5]); Choi, Sun, Heng and Zou,
// "Deformable simulation using force propagation model with finite element optimization",
// Computers & Graphics 28, 2004.
//
// The published descriptions agree on the following. The object is a network of mass points and
// springs. A node that the tool moves passes force on to its neighbours, and each neighbour passes
// force on to its own neighbours. Nodes are thus activated breadth first from the contact. The
// depth of a node is the smallest number of springs between the node and the contact. Only nodes up
// to a given depth move, so the cost depends on this depth and not on the size of the object. The
// active nodes move by an explicit step with damping.
//
// The published descriptions leave the following open. It is chosen here:
//  - Springs and Winkler foundation are those of network.h. So the result differs from the
//    network's equilibrium only because the depth and the number of steps are limited.
//  - The tool's nodes have depth 0. Nodes deeper than the given depth do not move (w = 0).
//  - The step is the semi-implicit Euler step, which moves a node with its new velocity. A
//    sweep applies the step to the active nodes in the order of activation, and uses the new
//    positions of nodes activated earlier. In one sweep the force therefore travels outwards
//    through all active nodes.
//  - Let k_ij be the stiffness of the spring between the nodes i and j, and f_i the stiffness of
//    the Winkler foundation at node i (network.h). The stiffness at node i is then
//    k_i = f_i + sum of k_ij over j. The mass of node i is m_i = k_i dt^2, where dt is the duration
//    of a sweep. With this mass every node has the same stability limit.
//    The motion before the equilibrium is numerical: it does not show how tissue would move.
// With these choices the step of node i is
//   v_i <- (1 - damping) v_i - r_i / k_i,   w_i <- w_i + v_i   (v in m per sweep)
// where r_i is reaction_N() of network.h. A fixed point of this step is the equilibrium with
// limited depth. With damping = 1 the step is the Gauss-Seidel iteration.

/// Smallest damping: plan_propagation() raises a smaller one to this value. A damping of less than
/// 0.5 can be unstable. In a long chain of equal springs without foundation, for example, all nodes
/// can move together, and their velocity is then multiplied by 2 (1 - damping) in each sweep (von
/// Neumann's stability analysis).
inline constexpr double kMinDamping = 0.55;

struct PropagationOptions {
  int depth = 6;   ///< largest depth of a node that moves; >= 1
  int sweeps = 4;  ///< number of sweeps per call of propagate(); >= 1
  /// Fraction of its velocity that a node loses in a sweep; clamped to [kMinDamping, 1].
  double damping = 0.7;
};

/// The nodes that move, in the order of activation. All calls of propagate() use the same plan.
struct PropagationPlan {
  std::vector<std::uint32_t> tool;                ///< nodes of depth 0
  std::vector<std::uint32_t> active;              ///< nodes of depth 1 .. options.depth
  std::vector<double> inverse_stiffness_m_per_N;  ///< 1 / k_i of each active node
  PropagationOptions options;
};

/// State that changes with each call of propagate(). make_propagation_state() makes it.
struct PropagationState {
  std::vector<double> w_m;                   ///< displacement of each node of the network
  std::vector<double> velocity_m_per_sweep;  ///< one value per active node
};

/// Makes the plan. `kind`: kind of each node, network.size() elements. Nodes of the kind kBorder
/// never move. Allocates.
PropagationPlan plan_propagation(const Network& network, std::span<const NodeKind> kind,
                                 const PropagationOptions& options);
/// Makes a state in which nothing is deformed. Allocates.
PropagationState make_propagation_state(const Network& network, const PropagationPlan& plan);

/// Runs plan.options.sweeps sweeps. The tool's nodes are held at the displacement `depth_m` (here a
/// length in m, not a number of springs). Returns the sum of the tool nodes' reactions in N. This
/// sum does not contain the force of the foundation under the tool, which the caller has to add.
/// Does not allocate. O(springs of active nodes) per sweep.
double propagate(const Network& network, const PropagationPlan& plan, double depth_m,
                 PropagationState& state) noexcept;

}  // namespace trocar::runtime
