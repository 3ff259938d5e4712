// SPDX-License-Identifier: Apache-2.0
// Properties of the sheet on random meshes with holes, needles and features of the lattice's size:
// the spring network, its energy, and the cut under the lattice's motions.
#include <cmath>
#include <map>

#include "formats/mesh_validity.h"
#include "runtime/contact/overlap.h"
#include "runtime/deformation/network.h"
#include "runtime/deformation/propagation.h"
#include "runtime/deformation/region.h"
#include "runtime/deformation/response.h"
#include "runtime/remesh/cut.h"
#include "runtime/remesh/local_refinement.h"
#include "tests/delaunay_fixture.h"
#include "tests/property_fixture.h"
#include "tests/random_geometry.h"

namespace trocar::runtime {
namespace {

using test::canonical;
using test::has_ties;
using test::Motion;

constexpr Lattice kLattice{8};
constexpr Membrane kMembrane{20, 1e6};

/// Constrained Delaunay, with up to four holes; a fourth of them of the lattice's own size, where
/// most crossings lie half way between its points.
SliceMesh any_sheet() {
  Random random(test::any_seed());
  const bool is_tiny = random.between(0, 3) == 0;
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

// In m, of tenths of a millimetre; some exactly alike.
std::vector<double> any_displacements(std::size_t size) {
  Random random(test::any_seed());
  std::vector<double> out;
  for (std::size_t i = 0; i < size; ++i)
    out.push_back(1e-4 * (random.between(0, 3) == 0 ? random.between(-2, 2) : random.unit()));
  return out;
}

// ---- the network ----

RC_GTEST_PROP(Network, IsSymmetricAndOfADelaunayMeshPositive, ()) {
  const SliceMesh sheet = any_sheet();
  const Network network = make_network(sheet, kLattice, kMembrane);
  std::map<std::pair<std::uint32_t, std::uint32_t>, double> spring;
  for (std::uint32_t i = 0; i < network.size(); ++i) {
    RC_ASSERT(network.bed_N_per_m[i] > 0);
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

RC_GTEST_PROP(Network, WeighsWhatItsSheetWeighs, ()) {
  const SliceMesh sheet = any_sheet();
  const Network network = make_network(sheet, kLattice, kMembrane);
  double bed = 0;
  for (const double f : network.bed_N_per_m)
    bed += f;
  const double step_m = kLattice.step_m();
  const double right =
      kMembrane.bed_N_per_m3 * 0.5 * static_cast<double>(doubled_area(sheet)) * step_m * step_m;
  RC_ASSERT(std::abs(bed / right - 1) < 1e-12);
  // Moved as a whole it stretches nothing: exactly.
  const std::vector<double> w(network.size(), 1e-3);
  for (std::size_t i = 0; i < network.size(); ++i)
    RC_ASSERT(reaction_N(network, w, i) == network.bed_N_per_m[i] * 1e-3);
}

RC_GTEST_PROP(Network, EnergyIsPositiveAndLessWithoutATriangle, ()) {
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

RC_GTEST_PROP(Network, MovesWithItsSheet, ()) {
  const SliceMesh sheet = any_sheet();
  const Motion m = test::any_motion();
  const Network here = make_network(sheet, kLattice, kMembrane),
                there = make_network(m(sheet), kLattice, kMembrane);
  RC_ASSERT(here.first == there.first);
  RC_ASSERT(here.neighbour == there.neighbour);
  RC_ASSERT(here.stiffness_N_per_m == there.stiffness_N_per_m);
  RC_ASSERT(here.bed_N_per_m == there.bed_N_per_m);
}

// With full damping a sweep is Gauss and Seidel's: each node goes to the least energy there is.
RC_GTEST_PROP(Propagation, NeverRaisesTheEnergy, ()) {
  const SliceMesh sheet = any_sheet();
  const Network network = make_network(sheet, kLattice, kMembrane);
  std::vector<NodeKind> kind(network.size(), NodeKind::kFree);
  std::mt19937_64 random(test::any_seed());
  kind[random() % kind.size()] = NodeKind::kTool;
  for (std::size_t held = random() % 4; held > 0; --held) {
    NodeKind& one = kind[random() % kind.size()];
    if (one == NodeKind::kFree) one = NodeKind::kRing;
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

Ring any_tool_on(const SliceMesh& sheet) {
  Random random(test::any_seed());
  const LatticePoint at = sheet.vertices[static_cast<std::size_t>(
      random.between(0, static_cast<int>(sheet.vertices.size()) - 1))];
  if (random.between(0, 2) == 0) {
    // Along the sheet's own rows and columns: points on one circle everywhere.
    const int step = random.between(1, 200), x = at.x - step * random.between(0, 3),
              y = at.y - step * random.between(0, 3), w = step * random.between(1, 5),
              h = step * random.between(1, 5);
    return {{x, y}, {x + w, y}, {x + w, y + h}, {x, y + h}};
  }
  const auto [low, high] = std::minmax_element(sheet.vertices.begin(), sheet.vertices.end(),
                                               [](auto a, auto b) { return a.x < b.x; });
  return any_tool(random, at, random.between(2, std::clamp(high->x - low->x, 3, 1500)));
}

RC_GTEST_PROP(Cut, MovesWithSheetAndTool, ()) {
  const SliceMesh sheet = any_sheet();
  const Ring tool = any_tool_on(sheet);
  const auto here = cut(sheet, tool);
  RC_ASSERT(static_cast<bool>(here));
  const Motion m = test::any_translation();
  const auto there = cut(m(sheet), m(tool));
  RC_ASSERT(static_cast<bool>(there));
  RC_ASSERT(there->doubled_area_removed == here->doubled_area_removed);
  RC_ASSERT(canonical(there->mesh) == canonical(m(here->mesh)));
  RC_ASSERT(canonical(there->hole) == canonical(m(Pslg{here->hole}).rings));
}

// To the bit: the same hole, the same area and the same triangles, crossings and all.
// `up_to_ties`: but where Delaunay leaves a choice.
void expect_alike(const SliceMesh& sheet, const Ring& tool, const CutResult& here,
                  const std::vector<Ring>& hole, const SliceMesh& mesh, const CutResult& there,
                  bool up_to_ties) {
  const bool crossing = rounding_bound(boundary_rings(sheet).rings, tool) > 0;
  const bool ties = has_ties(here.mesh);
  RC_TAG(std::string(crossing ? "crossing" : "apart or inside") + (ties ? ", with ties" : ""));
  RC_ASSERT(here.doubled_area_removed == there.doubled_area_removed);
  RC_ASSERT(canonical(hole) == canonical(there.hole));
  if (!ties || !up_to_ties) RC_ASSERT(canonical(mesh) == canonical(there.mesh));
}

RC_GTEST_PROP(Cut, TurnsWithSheetAndTool, ()) {
  const SliceMesh sheet = any_sheet();
  const Ring tool = any_tool_on(sheet);
  const auto here = cut(sheet, tool);
  RC_ASSERT(static_cast<bool>(here));
  const Motion m = test::any_motion();
  const auto there = cut(m(sheet), m(tool));
  RC_ASSERT(static_cast<bool>(there));
  expect_alike(sheet, tool, *here, m(Pslg{here->hole}).rings, m(here->mesh), *there, false);
}

RC_GTEST_PROP(Cut, DoesNotDependOnTheFirstCorner, ()) {
  const SliceMesh sheet = any_sheet();
  Ring tool = any_tool_on(sheet);
  const auto here = cut(sheet, tool);
  RC_ASSERT(static_cast<bool>(here));
  std::rotate(tool.begin(), tool.begin() + 1, tool.end());
  const auto there = cut(sheet, tool);
  RC_ASSERT(static_cast<bool>(there));
  expect_alike(sheet, tool, *here, here->hole, here->mesh, *there, true);
}

// Triangles in another order, each from another corner, vertices with other numbers.
SliceMesh given_otherwise(const SliceMesh& mesh) {
  std::mt19937_64 random(test::any_seed());
  std::vector<std::uint32_t> number(mesh.vertices.size());
  for (std::uint32_t i = 0; i < number.size(); ++i)
    number[i] = i;
  for (std::size_t i = number.size(); i > 1; --i)
    std::swap(number[i - 1], number[random() % i]);
  SliceMesh out = mesh;
  for (std::size_t i = 0; i < number.size(); ++i)
    out.vertices[number[i]] = mesh.vertices[i];
  for (Triangle& t : out.triangles) {
    for (std::uint32_t& v : t)
      v = number[v];
    std::rotate(t.begin(), t.begin() + random() % 3, t.end());
  }
  for (std::size_t i = out.triangles.size(); i > 1; --i)
    std::swap(out.triangles[i - 1], out.triangles[random() % i]);
  return out;
}

RC_GTEST_PROP(Cut, RemovesTheSameInWhateverOrderTheSheetIs, ()) {
  const SliceMesh sheet = any_sheet();
  const Ring tool = any_tool_on(sheet);
  const auto here = cut(sheet, tool), there = cut(given_otherwise(sheet), tool);
  const bool both = here && there;
  RC_ASSERT(both);
  expect_alike(sheet, tool, *here, here->hole, here->mesh, *there, true);
}

// ---- the region that a force is computed on, and the force ----

Motion any_translation_or_turn() {
  return *rc::gen::arbitrary<bool>() ? test::any_translation() : test::any_motion();
}

// As after a puncture: the hole, and then better triangles around it.
RC_GTEST_PROP(QualityPass, MovesWithSheetAndTool, ()) {
  const SliceMesh sheet = any_sheet();
  const Ring tool = any_tool_on(sheet);
  const Motion m = any_translation_or_turn();
  const auto improved = [](const SliceMesh& of, const Ring& outline) {
    SheetMesh mesh = *make_sheet_mesh(of, 1000, 2000);
    const std::size_t slots = mesh.triangles.size();
    CutWorkspace work({slots, mesh.vertices.size() + 1000, 3 * slots + 1000});
    SheetEdit edit(mesh);
    const CutReport report = cut_in_place(mesh, TriangleGrid(mesh), outline, work, edit);
    RC_ASSERT(report.outcome != CutOutcome::kBug);
    RC_ASSERT(report.outcome != CutOutcome::kNotATool);
    LocalRefinementWorkspace refinement(mesh);
    LocalRefinementOptions options;
    options.min_angle_deg = 20;
    refine_locally(mesh, edit, work.stitch.created, options, refinement);
    return to_slice_mesh(mesh);
  };
  const SliceMesh here = improved(sheet, tool), there = improved(m(sheet), m(tool));
  RC_TAG(std::string(m.quarters == 0 ? "moved" : "turned"));
  RC_ASSERT(canonical(there) == canonical(m(here)));
}

/// Of a point that is not on the lattice: rounded, as far away as it is.
Eigen::Vector2d moved(const Motion& m, Eigen::Vector2d p) {
  for (int i = 0; i < m.quarters; ++i)
    p = Eigen::Vector2d(-p.y(), p.x());
  return p + Eigen::Vector2d(m.by.x, m.by.y);
}

RC_GTEST_PROP(Region, MovesWithSheetAndTool, ()) {
  const SliceMesh sheet = any_sheet();
  const Ring tool = any_tool_on(sheet);
  const Motion m = any_translation_or_turn();
  const double radius_m = *rc::gen::element(1e-3, 5e-3, 1e9);
  const auto region = [&](const SliceMesh& mesh, const Ring& outline) {
    const auto made = make_sheet_mesh(mesh, 0, 0);
    RegionWorkspace workspace;
    ResponseOptions options;
    options.error_bound = 0;
    options.region.radius_m = radius_m;
    options.region.grading.max_new_vertices = 300;
    return prepare_region(*made, find_seeds(*made, outline), outline, kLattice, kMembrane, options,
                          workspace);
  };
  const auto here = region(sheet, tool), there = region(m(sheet), m(tool));
  const bool both = here && there;
  RC_ASSERT(both);
  RC_TAG(std::string(m.quarters == 0 ? "moved" : "turned"));
  RC_ASSERT(canonical(there->mesh.mesh) == canonical(m(here->mesh.mesh)));
  RC_ASSERT(there->mesh.kind == here->mesh.kind);
  RC_ASSERT(there->solution.w == here->solution.w);
  RC_ASSERT(there->response.stiffness_N_per_m == here->response.stiffness_N_per_m);
  if (here->response.stiffness_N_per_m == 0) return;  // nothing acts anywhere
  RC_ASSERT((there->response.centre_steps - moved(m, here->response.centre_steps)).norm() < 1e-6);
}

// ---- contact: what of the tool stands on material ----

RC_GTEST_PROP(Overlap, MovesWithSheetAndTool, ()) {
  const SliceMesh mesh = any_sheet();
  const Motion m = any_translation_or_turn();
  Random random(test::any_seed());
  SceneTool shape;
  shape.sides = random.between(3, 12);
  const auto sheet_of = [](const SliceMesh& of) {
    Sheet out;
    out.mesh = *make_sheet_mesh(of, 0, 0);
    out.grid = TriangleGrid(out.mesh);
    return out;
  };
  const LatticePoint centre = mesh.vertices[random.between(0, 1 << 20) % mesh.vertices.size()];
  const auto any_outline = [&] {
    LatticeOutline out;
    const Ring ring = convex(random, centre, random.between(10, 1500), shape.sides);
    out.size = static_cast<int>(ring.size());
    std::copy(ring.begin(), ring.end(), out.points.begin());
    return out;
  };
  const LatticeOutline outline = any_outline();
  shape.sides = outline.size;
  const Tool tool = make_tool(shape);
  LatticeOutline hole = outline;
  const LatticePoint off = random.point(-300, 300);
  for (int i = 0; i < hole.size; ++i)
    hole.points[i] = {hole.points[i].x + off.x, hole.points[i].y + off.y};
  const auto there_of = [&](LatticeOutline what) {
    for (int i = 0; i < what.size; ++i)
      what.points[i] = m(what.points[i]);
    return what;
  };
  const int holes = random.between(0, 1);
  const LatticeOutline here_holes[] = {hole}, there_holes[] = {there_of(hole)};
  const Overlap here = overlap(sheet_of(mesh), tool, outline, std::span(here_holes, holes)),
                there = overlap(sheet_of(m(mesh)), tool, there_of(outline),
                                std::span(there_holes, holes));
  RC_TAG(std::string(m.quarters == 0 ? "moved" : "turned") + (here.fraction == 0   ? ", beside"
                                                              : here.fraction == 1 ? ", inside"
                                                                                   : ", in part"));
  RC_ASSERT(here.fraction == there.fraction);
  RC_ASSERT((there.centroid_steps - moved(m, here.centroid_steps)).norm() < 1e-6);
}

}  // namespace
}  // namespace trocar::runtime
