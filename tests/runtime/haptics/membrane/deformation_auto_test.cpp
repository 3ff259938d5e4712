// SPDX-License-Identifier: Apache-2.0
// The solver `auto` on the phantom, L3 and the head, at random places, some of them near rims and
// holes: the error of the chosen region is within the given bounds, compared with the whole slice
// on the same triangles.
#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <optional>
#include <set>

#include "formats/mesh/cut.h"
#include "runtime/haptics/membrane/region.h"
#include "runtime/haptics/membrane/sheet_law.h"
#include "tests/reference/deformation/global_solver.h"
#include "tests/reference/deformation/region_part.h"
#include "tests/support/campaign.h"
#include "tests/support/deformation_fixture.h"
#include "tests/support/sheet_fixture.h"
#include "tests/support/whole_cut.h"

namespace trocar::runtime {
namespace {

/// A region's mesh put back into its sheet. None if two vertices of the sheet at one point make
/// this ambiguous.
struct InSheet {
  SliceMesh mesh;
  std::vector<NodeKind> kind;            ///< without a ring
  std::vector<std::uint32_t> of_region;  ///< vertex in the mesh of each vertex of the region
};
std::optional<InSheet> put_back(const SheetMesh& sheet, const Region& region,
                                const std::vector<std::uint32_t>& under, const Ring& tool,
                                double radius_steps) {
  InSheet out;
  std::vector<std::uint32_t> queue;
  const SheetPart part = part_around(sheet, under, circle_around(tool), radius_steps, queue);
  const std::set<std::uint32_t> taken(queue.begin(), queue.end());
  std::map<LatticePoint, std::uint32_t> slot_at;  // on the part's border
  for (std::size_t v = 0; v < part.parent.size(); ++v) {
    const LatticePoint p = part.mesh.vertices[v];
    const auto edge = std::lower_bound(part.outer.begin(), part.outer.end(),
                                       OuterEdge{p, {-kMaxCoordinate, -kMaxCoordinate}});
    const bool starts = edge != part.outer.end() && edge->from == p;
    const bool ends = std::any_of(part.outer.begin(), part.outer.end(),
                                  [&](const OuterEdge& s) { return s.to == p; });
    if (!starts && !ends) continue;
    const auto [at, fresh] = slot_at.emplace(p, part.parent[v]);
    if (!fresh && at->second != part.parent[v]) return std::nullopt;
  }
  std::map<std::uint32_t, std::uint32_t> number;  // of slots outside the region or on its ring
  const auto number_of = [&](std::uint32_t slot) {
    const auto [at, fresh] =
        number.emplace(slot, static_cast<std::uint32_t>(out.mesh.vertices.size()));
    if (fresh) {
      out.mesh.vertices.push_back(sheet.vertices[slot]);
      out.kind.push_back(NodeKind::kFree);
    }
    return at->second;
  };
  for (std::size_t v = 0; v < region.mesh.kind.size(); ++v) {
    const LatticePoint p = region.mesh.mesh.vertices[v];
    const auto ring = region.mesh.kind[v] == NodeKind::kFree ? slot_at.end() : slot_at.find(p);
    if (ring != slot_at.end()) {
      out.of_region.push_back(number_of(ring->second));
    } else {
      out.of_region.push_back(static_cast<std::uint32_t>(out.mesh.vertices.size()));
      out.mesh.vertices.push_back(p);
      out.kind.push_back(NodeKind::kFree);
    }
    if (region.mesh.kind[v] == NodeKind::kTool) out.kind[out.of_region[v]] = NodeKind::kTool;
  }
  for (const Triangle& t : region.mesh.mesh.triangles)
    out.mesh.triangles.push_back({out.of_region[t[0]], out.of_region[t[1]], out.of_region[t[2]]});
  for (std::uint32_t t = 0; t < sheet.triangles.size(); ++t) {
    if (!sheet.in_use(t) || taken.contains(t)) continue;
    const Triangle& v = sheet.triangles[t];
    out.mesh.triangles.push_back({number_of(v[0]), number_of(v[1]), number_of(v[2])});
  }
  return out;
}

class Auto : public testing::TestWithParam<double> {};
INSTANTIATE_TEST_SUITE_P(Bounds, Auto, testing::Values(0.1, 0.01, 0.001), [](const auto& bound) {
  return "Permille" + std::to_string(std::lround(1000 * bound.param));
});

TEST_P(Auto, ErrorAgainstTheWholeSliceIsWithinTheBound) {
  const std::vector<test::ScanAsset> scans = test::scan_assets();
  if (scans.empty()) GTEST_SKIP() << "no assets: TROCAR_ASSETS names their folder";
  const int places = test::campaign(60);
  for (const test::ScanAsset& scan : scans) {
    const Lattice lattice = scan.asset.lattice;
    const double radius_m = 0.003, circumradius = radius_m / lattice.step_m();
    std::mt19937_64 random(2024);
    RegionWorkspace workspace;
    std::map<double, Membrane> membranes;
    for (int i = 0; i < places; ++i) {
      const AssetSlice& slice = *scan.slices[random() % scan.slices.size()];
      const LatticePoint centre = test::place_in(slice.mesh, random);
      const Ring tool = test::regular_polygon(centre, circumradius, 6, test::uniform(random));
      SliceMesh mesh = slice.mesh;
      if (i % 2 == 1) {  // an earlier hole, near the tool or under part of it
        const auto off = [&] {
          return static_cast<std::int32_t>((2 * test::uniform(random) - 1) * 3 * circumradius);
        };
        const Ring other = test::regular_polygon({centre.x + off(), centre.y + off()}, circumradius,
                                                 6, test::uniform(random));
        auto punctured = cut(mesh, other);
        ASSERT_TRUE(punctured) << punctured.error().message;
        mesh = std::move(punctured->mesh);
      }
      const auto made = make_sheet_mesh(mesh, 0, 0);
      ASSERT_TRUE(made);
      const SheetMesh& sheet = *made;
      const double lambda_m = i % 3 == 0 ? 0.004 : i % 3 == 1 ? 0.008 : 0.02;
      if (!membranes.contains(lambda_m)) {
        const auto calibration =
            calibrate(5000, lambda_m, test::regular_polygon({}, circumradius, 6), lattice);
        ASSERT_TRUE(calibration) << calibration.error().message;
        membranes[lambda_m] = calibration->membrane;
      }
      const Membrane membrane = membranes[lambda_m];
      ResponseOptions options;
      options.error_bound = GetParam();
      const std::vector<std::uint32_t> seeds = find_seeds(sheet, tool);
      const auto region = prepare_region(sheet, seeds, tool, lattice, membrane, options, workspace);
      ASSERT_TRUE(region) << scan.name << ' ' << i << ": " << region.error().message;
      const RegionResponse& r = region->response;
      if (std::isinf(r.radius_m)) {
        EXPECT_EQ(r.bounds.force, 0);
        EXPECT_EQ(r.bounds.displacement, 0);
        continue;
      }
      EXPECT_LE(r.bounds.force, GetParam());
      EXPECT_LE(r.bounds.displacement, GetParam());

      const auto back = put_back(sheet, *region, seeds_under_tool(sheet, seeds, tool), tool,
                                 r.radius_m / lattice.step_m());
      if (!back) continue;
      const auto global = solve_global(make_network(back->mesh, lattice, membrane), back->kind);
      ASSERT_TRUE(global);
      const double under_tool = r.stiffness_N_per_m - region->solution.stiffness_N_per_m;
      const double force = 1 - (global->stiffness_N_per_m + under_tool) / r.stiffness_N_per_m;
      double displacement = 0, out_of_region = 0;
      std::vector<std::uint8_t> inside(back->kind.size(), 0);
      for (std::size_t v = 0; v < back->of_region.size(); ++v) {
        inside[back->of_region[v]] = 1;
        displacement =
            std::max(displacement, std::abs(global->w[back->of_region[v]] - region->solution.w[v]));
      }
      for (std::size_t v = 0; v < inside.size(); ++v) {
        if (inside[v] == 0) out_of_region = std::max(out_of_region, std::abs(global->w[v]));
      }
      displacement = std::max(displacement, out_of_region);
      EXPECT_GE(force, -1e-9) << scan.name << ' ' << i;
      EXPECT_LE(force, r.bounds.force + 1e-9) << scan.name << ' ' << i;
      EXPECT_LE(displacement, r.bounds.displacement + 1e-9)
          << scan.name << ' ' << i << " proved " << r.bounds.proved;
    }
  }
}

}  // namespace
}  // namespace trocar::runtime
