// SPDX-License-Identifier: GPL-3.0-or-later
// Properties of the sheet on random meshes with holes, needles and features of the lattice's size:
// the spring network, its energy, the cut, the quality pass, the region of a force, coverage
// and the placing of slices.
// Long because all tests of this file share its fixtures.
#include <cmath>
#include <map>
#include <numbers>

#include "formats/mesh/cut.h"
#include "formats/mesh/local_refinement.h"
#include "formats/mesh/mesh_validity.h"
#include "formats/mesh/triangulation.h"
#include "runtime/haptics/membrane/network.h"
#include "runtime/haptics/membrane/region.h"
#include "runtime/haptics/membrane/sheet_law.h"
#include "runtime/haptics/sheet.h"
#include "tests/properties/property_fixture.h"
#include "tests/properties/property_outlines.h"
#include "tests/reference/deformation/network_checks.h"
#include "tests/reference/deformation/region_part.h"
#include "tests/support/delaunay_fixture.h"
#include "tests/support/random_geometry.h"
#include "tests/support/test_lattice.h"
#include "tests/support/whole_cut.h"

namespace trocar::runtime {
namespace {

using test::canonical;
using test::has_ties;
using test::Motion;

using trocar::test::kLattice;
constexpr Membrane kMembrane{20, 1e6};

/// A constrained Delaunay mesh with up to four holes. A quarter of them are only a few lattice
/// steps large, where most crossings must be rounded. A quarter are meshes of random outlines:
/// needles, slits, circles, stress cases of meshing.
SliceMesh any_sheet() {
  Random random(test::any_seed());
  const int kind = random.between(0, 3);
  if (kind == 1) {
    const auto made = trocar::triangulate(test::any_outline());
    RC_ASSERT(static_cast<bool>(made));
    RC_PRE(!made->mesh.triangles.empty());
    return made->mesh;
  }
  const bool is_tiny = kind == 0;
  for (;;) {
    if (is_tiny) {
      const int cells = random.between(1, 4), cell = 2 * random.between(1, 6);
      SliceMesh mesh = test::square_mesh({-cells * cell / 2, -cells * cell / 2}, cell, cells);
      for (int cuts = random.between(1, 3); cuts > 0 && !mesh.triangles.empty(); --cuts) {
        const auto done = cut(mesh, any_tool(random, random.point(-cell, cell), cell));
        if (done) mesh = done->mesh;
      }
      if (!mesh.triangles.empty()) return mesh;
      continue;
    }
    SliceMesh out = to_slice_mesh(random_sheet(random, 0, 0));
    if (!out.triangles.empty()) return out;
  }
}

// In m, up to some tenths of a millimetre; some exactly equal.
std::vector<double> any_displacements(std::size_t size) {
  Random random(test::any_seed());
  std::vector<double> out;
  for (std::size_t i = 0; i < size; ++i)
    out.push_back(1e-4 * (random.between(0, 3) == 0 ? random.between(-2, 2) : random.unit()));
  return out;
}

/// Triangles in a random order, each (if `from_other_corners`) starting at a random corner, and
/// vertices renumbered.
struct Permuted {
  SliceMesh mesh;
  std::vector<std::uint32_t> number;  ///< new number of each vertex
};
Permuted permuted(const SliceMesh& mesh, bool from_other_corners = true) {
  std::mt19937_64 random(test::any_seed());
  Permuted out{mesh, std::vector<std::uint32_t>(mesh.vertices.size())};
  std::vector<std::uint32_t>& number = out.number;
  for (std::uint32_t i = 0; i < number.size(); ++i)
    number[i] = i;
  for (std::size_t i = number.size(); i > 1; --i)
    std::swap(number[i - 1], number[random() % i]);
  for (std::size_t i = 0; i < number.size(); ++i)
    out.mesh.vertices[number[i]] = mesh.vertices[i];
  std::vector<Triangle>& triangles = out.mesh.triangles;
  for (Triangle& t : triangles) {
    for (std::uint32_t& v : t)
      v = number[v];
    if (from_other_corners) std::rotate(t.begin(), t.begin() + random() % 3, t.end());
  }
  for (std::size_t i = triangles.size(); i > 1; --i)
    std::swap(triangles[i - 1], triangles[random() % i]);
  return out;
}

// ---- the network ----

RC_GTEST_PROP(Network, IsSymmetricAndPositiveOnADelaunayMesh, ()) {
  const SliceMesh sheet = any_sheet();
  const Network network = make_network(sheet, kLattice, kMembrane);
  std::map<std::pair<std::uint32_t, std::uint32_t>, double> spring;
  for (std::uint32_t i = 0; i < network.size(); ++i) {
    RC_ASSERT(network.foundation_N_per_m[i] > 0);
    for (std::uint32_t k = network.first[i]; k < network.first[i + 1]; ++k) {
      RC_ASSERT(network.neighbour[k] != i);
      const bool ascends = k == network.first[i] || network.neighbour[k - 1] < network.neighbour[k];
      RC_ASSERT(ascends);
      RC_ASSERT(
          spring.emplace(std::pair(i, network.neighbour[k]), network.stiffness_N_per_m[k]).second);
    }
  }
  for (const auto& [ends, stiffness] : spring)
    RC_ASSERT(spring.at({ends.second, ends.first}) == stiffness);
  RC_ASSERT(is_constrained_delaunay(sheet));
  RC_ASSERT(network.signs.negative_interior == 0U);
  RC_ASSERT(spring.size() == 2 * std::size_t{network.signs.interior + network.signs.boundary});
}

RC_GTEST_PROP(Network, HasTheBedStiffnessOfItsArea, ()) {
  const SliceMesh sheet = any_sheet();
  const Network network = make_network(sheet, kLattice, kMembrane);
  double bed = 0;
  for (const double f : network.foundation_N_per_m)
    bed += f;
  const double step_m = kLattice.step_m();
  const double right = kMembrane.foundation_N_per_m3 * 0.5 *
                       static_cast<double>(doubled_area(sheet)) * step_m * step_m;
  RC_ASSERT(std::abs(bed / right - 1) < 1e-12);
  // A uniform displacement stretches no spring, exactly.
  const std::vector<double> w(network.size(), 1e-3);
  for (std::size_t i = 0; i < network.size(); ++i)
    RC_ASSERT(reaction_N(network, w, i) == network.foundation_N_per_m[i] * 1e-3);
}

RC_GTEST_PROP(Network, EnergyIsPositiveAndFallsWhenTrianglesAreRemoved, ()) {
  const SliceMesh sheet = any_sheet();
  const std::vector<double> w = any_displacements(sheet.vertices.size());
  const double whole = energy_J(make_network(sheet, kLattice, kMembrane), w);
  RC_ASSERT(whole >= 0);
  SliceMesh part = sheet;
  std::mt19937_64 random(test::any_seed());
  std::erase_if(part.triangles, [&](const Triangle&) { return random() % 4 == 0; });
  const double of_part = energy_J(make_network(part, kLattice, kMembrane), w);
  RC_ASSERT(of_part >= -1e-12 * whole);
  RC_ASSERT(of_part <= whole * (1 + 1e-12));
}

RC_GTEST_PROP(Network, IsInvariantUnderMotions, ()) {
  const SliceMesh sheet = any_sheet();
  const Motion m = test::any_motion();
  const Network here = make_network(sheet, kLattice, kMembrane),
                there = make_network(m(sheet), kLattice, kMembrane);
  RC_ASSERT(here.first == there.first);
  RC_ASSERT(here.neighbour == there.neighbour);
  RC_ASSERT(here.stiffness_N_per_m == there.stiffness_N_per_m);
  RC_ASSERT(here.foundation_N_per_m == there.foundation_N_per_m);
}

RC_GTEST_PROP(Network, DoesNotDependOnTheInputOrder, ()) {
  const SliceMesh sheet = any_sheet();
  const Permuted other = permuted(sheet);
  const Network here = make_network(sheet, kLattice, kMembrane),
                there = make_network(other.mesh, kLattice, kMembrane);
  RC_ASSERT(here.size() == there.size());
  RC_ASSERT(here.neighbour.size() == there.neighbour.size());
  for (std::uint32_t i = 0; i < here.size(); ++i) {
    const std::uint32_t j = other.number[i];
    // A sum over the triangles around a node, rounded in their order.
    RC_ASSERT(std::abs(there.foundation_N_per_m[j] / here.foundation_N_per_m[i] - 1) < 1e-14);
    RC_ASSERT(there.first[j + 1] - there.first[j] == here.first[i + 1] - here.first[i]);
    for (std::uint32_t k = here.first[i]; k < here.first[i + 1]; ++k) {
      const auto begin = there.neighbour.begin() + there.first[j],
                 end = there.neighbour.begin() + there.first[j + 1],
                 at = std::lower_bound(begin, end, other.number[here.neighbour[k]]);
      const bool found = at != end && *at == other.number[here.neighbour[k]];
      RC_ASSERT(found);
      RC_ASSERT(there.stiffness_N_per_m[static_cast<std::size_t>(at - there.neighbour.begin())] ==
                here.stiffness_N_per_m[k]);
    }
  }
}

// A sweep with full damping is one of Gauss-Seidel: each node moves to its least energy.
RC_GTEST_PROP(Propagation, NeverRaisesTheEnergy, ()) {
  const SliceMesh sheet = any_sheet();
  const Network network = make_network(sheet, kLattice, kMembrane);
  std::vector<NodeKind> kind(network.size(), NodeKind::kFree);
  std::mt19937_64 random(test::any_seed());
  kind[random() % kind.size()] = NodeKind::kTool;
  for (std::size_t held = random() % 4; held > 0; --held) {
    NodeKind& one = kind[random() % kind.size()];
    if (one == NodeKind::kFree) one = NodeKind::kBorder;
  }
  const PropagationPlan plan = plan_propagation(network, kind, {1000, 1, 1.0});
  PropagationState state = make_propagation_state(network, plan);
  propagate(network, plan, 1e-3, state);
  double energy = energy_J(network, state.w_m);
  for (int sweep = 0; sweep < 50; ++sweep) {
    propagate(network, plan, 1e-3, state);
    const double next = energy_J(network, state.w_m);
    RC_ASSERT(next <= energy * (1 + 1e-12));
    energy = next;
  }
}

// ---- the cut ----

CutResult made_cut(const SliceMesh& sheet, const Ring& tool) {
  auto made = cut(sheet, tool);
  RC_ASSERT(static_cast<bool>(made));
  return std::move(*made);
}

Ring any_tool_on(const SliceMesh& sheet) {
  Random random(test::any_seed());
  const LatticePoint at = sheet.vertices[static_cast<std::size_t>(
      random.between(0, static_cast<int>(sheet.vertices.size()) - 1))];
  if (random.between(0, 2) == 0) {
    // Along rows and columns of the sheet: many cocircular points.
    const int step = random.between(1, 200), x = at.x - step * random.between(0, 3),
              y = at.y - step * random.between(0, 3), w = step * random.between(1, 5),
              h = step * random.between(1, 5);
    return {{x, y}, {x + w, y}, {x + w, y + h}, {x, y + h}};
  }
  const auto [low, high] = std::minmax_element(sheet.vertices.begin(), sheet.vertices.end(),
                                               [](auto a, auto b) { return a.x < b.x; });
  return any_tool(random, at, random.between(2, std::clamp(high->x - low->x, 3, 1500)));
}

RC_GTEST_PROP(Cut, IsEquivariantUnderTranslations, ()) {
  const SliceMesh sheet = any_sheet();
  const Ring tool = any_tool_on(sheet);
  const Motion m = test::any_translation();
  const CutResult here = made_cut(sheet, tool), there = made_cut(m(sheet), m(tool));
  RC_ASSERT(there.doubled_area_removed == here.doubled_area_removed);
  RC_ASSERT(canonical(there.mesh) == canonical(m(here.mesh)));
  RC_ASSERT(canonical(there.hole) == canonical(m(Pslg{here.hole}).rings));
}

// Hole, area and triangles are equal to the bit, with all crossings. `up_to_ties`: triangles may
// differ where Delaunay has ties.
void expect_equal(const SliceMesh& sheet, const Ring& tool, const CutResult& here,
                  const std::vector<Ring>& hole, const SliceMesh& mesh, const CutResult& there,
                  bool up_to_ties) {
  const bool crossing = rounding_bound(boundary_rings(sheet).rings, tool) > 0;
  const bool ties = has_ties(here.mesh);
  RC_TAG(std::string(crossing ? "crossing" : "apart or inside") + (ties ? ", with ties" : ""));
  RC_ASSERT(here.doubled_area_removed == there.doubled_area_removed);
  RC_ASSERT(canonical(hole) == canonical(there.hole));
  if (up_to_ties) {
    RC_ASSERT(test::decided_edges(mesh) == test::decided_edges(there.mesh));
  } else {
    RC_ASSERT(canonical(mesh) == canonical(there.mesh));
  }
}

RC_GTEST_PROP(Cut, IsEquivariantUnderRotations, ()) {
  const SliceMesh sheet = any_sheet();
  const Ring tool = any_tool_on(sheet);
  const Motion m = test::any_motion();
  const CutResult here = made_cut(sheet, tool), there = made_cut(m(sheet), m(tool));
  expect_equal(sheet, tool, here, m(Pslg{here.hole}).rings, m(here.mesh), there, false);
}

RC_GTEST_PROP(Cut, DoesNotDependOnTheFirstCornerOfTheTool, ()) {
  const SliceMesh sheet = any_sheet();
  Ring tool = any_tool_on(sheet);
  const CutResult here = made_cut(sheet, tool);
  std::rotate(tool.begin(), tool.begin() + 1, tool.end());
  expect_equal(sheet, tool, here, here.hole, here.mesh, made_cut(sheet, tool), true);
}

RC_GTEST_PROP(Cut, DoesNotDependOnTheOrderOfTheSheet, ()) {
  const SliceMesh sheet = any_sheet();
  const Ring tool = any_tool_on(sheet);
  const CutResult here = made_cut(sheet, tool), there = made_cut(permuted(sheet).mesh, tool);
  expect_equal(sheet, tool, here, here.hole, here.mesh, there, true);
}

// ---- the quality pass, the region that a force is computed on, and the force ----

Motion any_translation_or_motion() {
  return *rc::gen::arbitrary<bool>() ? test::any_translation() : test::any_motion();
}

// Repeats the steps of a puncture: the hole is cut, then the quality pass improves the triangles
// around it.
SliceMesh improved(const SliceMesh& sheet, const Ring& tool) {
  SheetMesh mesh = *make_sheet_mesh(sheet, 200, 400);
  const std::size_t slots = mesh.triangles.size();
  CutWorkspace work({slots, mesh.vertices.size() + 200, 3 * slots + 200});
  SheetEdit edit(mesh);
  const CutReport report = cut_in_place(mesh, TriangleGrid(mesh), tool, work, edit);
  RC_ASSERT(report.outcome != CutOutcome::kBug);
  RC_ASSERT(report.outcome != CutOutcome::kInvalidTool);
  RC_ASSERT(report.outcome != CutOutcome::kCapacity);
  LocalRefinementWorkspace refinement(mesh);
  LocalRefinementOptions options;
  options.min_angle_deg = 20;
  refine_locally(mesh, edit, work.stitch.created, options, refinement);
  return to_slice_mesh(mesh);
}

RC_GTEST_PROP(QualityPass, IsEquivariantUnderMotions, ()) {
  const SliceMesh sheet = any_sheet();
  const Ring tool = any_tool_on(sheet);
  const Motion m = any_translation_or_motion();
  const SliceMesh here = improved(sheet, tool), there = improved(m(sheet), m(tool));
  RC_TAG(std::string(m.quarters == 0 ? "translated" : "rotated"));
  RC_ASSERT(canonical(there) == canonical(m(here)));
}

// The queue breaks ties between triangles of equal size by the lowest slot: another order of
// the sheet may give another mesh, but an equally good one.
RC_GTEST_PROP(QualityPass, IsAsGoodInEveryOrderOfTheSheet, ()) {
  const SliceMesh sheet = any_sheet();
  const Ring tool = any_tool_on(sheet);
  const SliceMesh here = improved(sheet, tool), there = improved(permuted(sheet).mesh, tool);
  RC_ASSERT(doubled_area(there) == doubled_area(here));
  RC_ASSERT(is_constrained_delaunay(there));
  RC_TAG(std::string(test::decided_edges(there) == test::decided_edges(here) ? "the same"
                                                                             : "another mesh"));
}

/// The motion of a point that is not on the lattice; rounded.
Eigen::Vector2d moved(const Motion& m, Eigen::Vector2d p) {
  for (int i = 0; i < m.quarters; ++i)
    p = Eigen::Vector2d(-p.y(), p.x());
  return p + Eigen::Vector2d(m.by.x, m.by.y);
}

Region region(const SliceMesh& sheet, const Ring& tool, double radius_m) {
  const auto made = make_sheet_mesh(sheet, 0, 0);
  RegionWorkspace workspace;
  ResponseOptions options;
  options.error_bound = 0;
  options.region.radius_m = radius_m;
  options.region.grading.max_new_vertices = 300;
  auto out =
      prepare_region(*made, find_seeds(*made, tool), tool, kLattice, kMembrane, options, workspace);
  RC_ASSERT(static_cast<bool>(out));
  return std::move(*out);
}

// If the order of the sheet changes, the area under the tool is exactly equal; the force is equal
// up to rounding if the triangles are the same, else within the error of grading (region.h).
RC_GTEST_PROP(Region, HasTheSameForceInEveryOrderOfTheSheet, ()) {
  const SliceMesh sheet = any_sheet();
  const Ring tool = any_tool_on(sheet);
  const double radius_m = *rc::gen::element(1e-3, 5e-3, 1e9);
  const Region here = region(sheet, tool, radius_m),
               there = region(permuted(sheet).mesh, tool, radius_m);
  RC_ASSERT(there.mesh.under_tool.area_steps2 == here.mesh.under_tool.area_steps2);
  const bool same = canonical(there.mesh.mesh) == canonical(here.mesh.mesh);
  RC_TAG(std::string(same ? "the same triangles" : "other triangles"));
  const double is = there.response.stiffness_N_per_m, right = here.response.stiffness_N_per_m;
  RC_ASSERT(std::abs(is - right) <= (same ? 1e-9 : 0.05) * right);
}

RC_GTEST_PROP(Region, IsEquivariantUnderMotions, ()) {
  const SliceMesh sheet = any_sheet();
  const Ring tool = any_tool_on(sheet);
  const Motion m = any_translation_or_motion();
  const double radius_m = *rc::gen::element(1e-3, 5e-3, 1e9);
  const Region here = region(sheet, tool, radius_m), there = region(m(sheet), m(tool), radius_m);
  RC_TAG(std::string(m.quarters == 0 ? "translated" : "rotated"));
  RC_ASSERT(canonical(there.mesh.mesh) == canonical(m(here.mesh.mesh)));
  RC_ASSERT(there.mesh.kind == here.mesh.kind);
  RC_ASSERT(there.solution.w == here.solution.w);
  RC_ASSERT(there.response.stiffness_N_per_m == here.response.stiffness_N_per_m);
  if (here.response.stiffness_N_per_m == 0) return;  // no force, no point of action
  RC_ASSERT((there.response.centre_steps - moved(m, here.response.centre_steps)).norm() < 1e-6);
}

// ---- contact: share of the tool outline over material ----

Sheet sheet_of(const SliceMesh& mesh) {
  Sheet out;
  out.mesh = *make_sheet_mesh(mesh, 0, 0);
  out.index_mesh();
  return out;
}

/// A convex tool on the sheet, and a hole of the same shape near it.
struct ToolAndHole {
  Tool tool;
  LatticeOutline outline, hole;
  int holes = 0;  ///< 0: without the hole
};
ToolAndHole any_tool_and_hole(const SliceMesh& mesh) {
  Random random(test::any_seed());
  SceneTool shape;
  const LatticePoint centre = mesh.vertices[random.between(0, 1 << 20) % mesh.vertices.size()];
  const Ring ring = convex(random, centre, random.between(10, 1500), random.between(3, 12));
  shape.sides = static_cast<int>(ring.size());
  ToolAndHole out;
  out.tool = make_tool(shape);
  out.outline.size = shape.sides;
  std::copy(ring.begin(), ring.end(), out.outline.points.begin());
  out.hole = out.outline;
  const LatticePoint off = random.point(-300, 300);
  for (int i = 0; i < out.hole.size; ++i)
    out.hole.points[i] = {out.hole.points[i].x + off.x, out.hole.points[i].y + off.y};
  out.holes = random.between(0, 1);
  return out;
}
Overlap overlap_of(const SliceMesh& mesh, const ToolAndHole& with) {
  return overlap(sheet_of(mesh), with.tool, with.outline, std::span(&with.hole, with.holes));
}

// Equal to the bit for another order of triangles; up to rounding for other first corners.
RC_GTEST_PROP(Overlap, DoesNotDependOnTheInputOrder, ()) {
  const SliceMesh mesh = any_sheet();
  const ToolAndHole with = any_tool_and_hole(mesh);
  const Overlap here = overlap_of(mesh, with), there = overlap_of(permuted(mesh, false).mesh, with),
                from_others = overlap_of(permuted(mesh).mesh, with);
  RC_ASSERT(there.coverage == here.coverage);
  RC_ASSERT(there.centroid_steps == here.centroid_steps);
  RC_ASSERT(std::abs(from_others.coverage - here.coverage) < 1e-12);
  RC_ASSERT((from_others.centroid_steps - here.centroid_steps).norm() < 1e-6);
}

RC_GTEST_PROP(Overlap, IsEquivariantUnderMotions, ()) {
  const SliceMesh mesh = any_sheet();
  const Motion m = any_translation_or_motion();
  const ToolAndHole with = any_tool_and_hole(mesh);
  ToolAndHole moved_with = with;
  for (LatticeOutline* what : {&moved_with.outline, &moved_with.hole}) {
    for (int i = 0; i < what->size; ++i)
      what->points[i] = m(what->points[i]);
  }
  const Overlap here = overlap_of(mesh, with), there = overlap_of(m(mesh), moved_with);
  RC_TAG(std::string(m.quarters == 0 ? "translated" : "rotated") + (here.coverage == 0 ? ", beside"
                                                                    : here.coverage == 1
                                                                        ? ", inside"
                                                                        : ", in part"));
  RC_ASSERT(here.coverage == there.coverage);
  RC_ASSERT((there.centroid_steps - moved(m, here.centroid_steps)).norm() < 1e-6);
}

// ---- placing: the tool's outline in the frame of the slice, slices in the scene ----

double any_share(double low, double high) {
  return low + (high - low) * test::any_in(0, 1'000'001) * 1e-6;
}

// If the slice is translated by lattice steps, or the plate is rotated about the placed anchor, the
// outline moves accordingly. Its corners are rounded; exact ties of rounding do not occur.
RC_GTEST_PROP(Outline, IsEquivariantUnderMotionsOfPlateAndSlice, ()) {
  SceneTool shape;
  shape.sides = test::any_in(3, 13);
  shape.radius_m = any_share(0.0005, 0.01);
  shape.tilt_deg = any_share(0, 30);
  shape.tilt_azimuth_deg = any_share(0, 360);
  const Tool tool = make_tool(shape);
  PlanarTransform transform;
  transform.lattice = kLattice;
  transform.at_m = {any_share(-0.02, 0.02), any_share(-0.02, 0.02)};
  const double rotation_rad = any_share(0, 6.28);
  transform.cosine = std::cos(rotation_rad), transform.sine = std::sin(rotation_rad);
  const Pose plate{{any_share(-0.02, 0.02), any_share(-0.02, 0.02), any_share(0.1, 0.2)},
                   from_rotation_vector({any_share(-0.2, 0.2), any_share(-0.2, 0.2), 0.5})};
  const double z_m = any_share(0.1, 0.2);
  const LatticeOutline here = outline_on_lattice(tool, plate, transform, z_m);
  RC_ASSERT(here.size == shape.sides);

  const Motion m{test::any_in(0, 4),
                 {test::any_in(-100'000, 100'000), test::any_in(-100'000, 100'000)}};
  PlanarTransform moved_slice = transform;
  moved_slice.anchor_mm = kLattice.step_mm() * Eigen::Vector2d(m.by.x, m.by.y);
  // The plate rotated about the point where the slice is placed.
  const Pose about{{transform.at_m.x(), transform.at_m.y(), 0},
                   Eigen::Quaterniond(Eigen::AngleAxisd(m.quarters * std::numbers::pi / 2,
                                                        Eigen::Vector3d::UnitZ()))};
  const Pose rotated = about * inverse(Pose{about.p_m, Eigen::Quaterniond::Identity()}) * plate;
  const LatticeOutline there = outline_on_lattice(tool, rotated, moved_slice, z_m);
  RC_ASSERT(to_ring(there) == m(to_ring(here)));
}

// A slice translated by lattice steps is placed at the same position by its centroid, for any order
// of its triangles. The scene's slices are sorted, the topmost first.
RC_GTEST_PROP(Placing, DoesNotDependOnTranslationAndOrderOfTheSlice, ()) {
  const SliceMesh mesh = any_sheet();
  const Motion m{0, {test::any_in(-1'000'000, 1'000'000), test::any_in(-1'000'000, 1'000'000)}};
  Scene scene = test::descent_scene({0.12, 0.19}, 0.2, 0.1, 0.015);
  scene.placement.anchor_mm.reset();
  scene.placement.rotation_deg = any_share(0, 360);
  Scene other = scene;
  std::swap(other.slices[0], other.slices[test::any_in(0, 2)]);
  const Permuted given = permuted(mesh);
  const auto here = place_slices(scene, test::asset_of(mesh, 2), "here"),
             there = place_slices(other, test::asset_of(m(given.mesh), 2), "there");
  const bool both = here && there;
  RC_ASSERT(both);
  for (std::size_t k = 0; k < 2; ++k) {
    const Sheet &is = *(*there)[k], &was = *(*here)[k];
    RC_ASSERT(is.slice_index == was.slice_index);
    RC_ASSERT(is.z_m == was.z_m);
    RC_ASSERT(canonical(to_slice_mesh(is.mesh)) == canonical(m(to_slice_mesh(was.mesh))));
    const Eigen::Vector2d p_m(0.003, -0.001);
    RC_ASSERT((is.transform.to_lattice(p_m) - moved(m, was.transform.to_lattice(p_m))).norm() <
              1e-6);
  }
}

}  // namespace
}  // namespace trocar::runtime
