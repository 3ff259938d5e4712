// SPDX-License-Identifier: GPL-3.0-or-later
// Refinement makes all springs of a slice's mesh non-negative; and what a cut changes.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "formats/mesh/cut.h"
#include "formats/mesh/mesh_validity.h"
#include "formats/mesh/triangulation.h"
#include "runtime/haptics/membrane/region.h"
#include "tests/reference/deformation/global_solver.h"
#include "tests/reference/deformation/network_checks.h"
#include "tests/support/deformation_fixture.h"
#include "tests/support/whole_cut.h"

namespace trocar::runtime {
namespace {

SpringSigns of_all_slices(const test::ScanAsset& scan) {
  SpringSigns all;
  for (const AssetSlice* slice : scan.slices) {
    const SpringSigns signs = spring_signs(slice->mesh);
    all.interior += signs.interior;
    all.boundary += signs.boundary;
    all.negative_interior += signs.negative_interior;
    all.negative_boundary += signs.negative_boundary;
  }
  printf("%s: %u of %u inner springs negative, %u of %u on the boundary\n", scan.name.c_str(),
         all.negative_interior, all.interior, all.negative_boundary, all.boundary);
  return all;
}

TEST(Springs, AreNotNegativeInRefinedMeshes) {
  const std::vector<test::ScanAsset> scans = test::scan_assets();
  if (scans.empty()) GTEST_SKIP() << "no assets: TROCAR_ASSETS names their folder";
  for (const test::ScanAsset& scan : scans)
    EXPECT_EQ(of_all_slices(scan).negative(), 0U) << scan.name;
}

/// The outline without the vertices that refinement put on its edges: those within the lattice's
/// rounding of the line between their neighbours.
Pslg before_refinement(const Pslg& pslg) {
  Pslg out;
  for (const Ring& ring : pslg.rings) {
    Ring kept;
    for (std::size_t i = 0; i < ring.size(); ++i) {
      const LatticePoint a = kept.empty() ? ring.back() : kept.back(), b = ring[i],
                         c = ring[(i + 1) % ring.size()];
      const double off = std::abs(static_cast<double>(orient2d(a, b, c))) /
                         std::sqrt(static_cast<double>(std::max<std::int64_t>(1, distance2(a, c))));
      if (off > 2) kept.push_back(b);
    }
    if (kept.size() >= 3) out.rings.push_back(std::move(kept));
  }
  return out;
}

// The counter-example: a constrained Delaunay triangulation has no negative inner springs, but
// negative ones on the boundary, and the maximum principle fails: a sheet pressed down at one place
// rises at another. Of outlines by Douglas-Peucker, whose vertices are closer to each other.
TEST(Springs, AreNegativeOnTheBoundaryOfUnrefinedMeshes) {
  std::vector<test::ScanAsset> scans = test::scan_assets("_dp");
  if (scans.empty()) GTEST_SKIP() << "no assets: TROCAR_ASSETS names their folder";
  for (test::ScanAsset& scan : scans) {
    for (AssetSlice& slice : scan.asset.slices) {
      const Pslg outline = before_refinement(slice.pslg);
      slice.mesh = {};
      if (!check_pslg(outline)) continue;
      auto mesh = trocar::triangulate(outline);
      ASSERT_TRUE(mesh) << scan.name << ": " << mesh.error().message;
      slice.mesh = std::move(mesh->mesh);
    }
    std::erase_if(scan.slices,
                  [](const AssetSlice* slice) { return slice->mesh.triangles.empty(); });
    ASSERT_GT(scan.slices.size(), 10U);
    const SpringSigns signs = of_all_slices(scan);
    EXPECT_EQ(signs.negative_interior, 0U) << scan.name;
    EXPECT_GT(signs.negative_boundary, signs.boundary / 100) << scan.name;
  }
  const test::ScanAsset& scan = scans.back();
  double lowest = 0;
  for (std::size_t k = 0; k < scan.slices.size(); k += 10) {
    const Network network = make_network(scan.slices[k]->mesh, scan.asset.lattice, {320, 5e6});
    for (std::size_t held = 0; held < network.size(); held += 23) {
      std::vector<NodeKind> kind(network.size(), NodeKind::kFree);
      kind[held] = NodeKind::kTool;
      const auto solution = solve_global(network, kind);
      ASSERT_TRUE(solution);
      lowest = std::min(lowest, *std::min_element(solution->w.begin(), solution->w.end()));
    }
  }
  printf("%s, not refined: w down to %.4f of the depth\n", scan.name.c_str(), lowest);
  if (scan.name == "head") {
    EXPECT_LT(lowest, -1e-3);
  }
}

// A cut flips edges around the hole until they are Delaunay again: no inner spring becomes
// negative. Springs on the hole and on the outline near it may: the cut counts them, and the energy
// is still positive definite (network.h, law 2).
TEST(Springs, NegativeSpringsAfterACutAreCountedAndTheEnergyIsDefinite) {
  const std::vector<test::ScanAsset> scans = test::scan_assets();
  if (scans.empty()) GTEST_SKIP() << "no assets: TROCAR_ASSETS names their folder";
  const Membrane membrane{320, 5e6};
  for (const test::ScanAsset& scan : scans) {
    std::mt19937_64 random(5);
    std::size_t negative = 0, cuts = 0, boundary = 0;
    for (int i = 0; i < test::cases(60); ++i) {
      const AssetSlice& slice = *scan.slices[random() % scan.slices.size()];
      const double size = (1 + 5 * test::uniform(random)) / scan.asset.lattice.step_mm();
      const auto result = cut(slice.mesh, test::regular_polygon(test::place_in(slice.mesh, random),
                                                                size, 6, test::uniform(random)));
      ASSERT_TRUE(result) << result.error().message;
      if (result->mesh.triangles.empty()) continue;
      ++cuts;
      const Network network = make_network(result->mesh, scan.asset.lattice, membrane);
      EXPECT_EQ(network.signs.negative_interior, 0U) << scan.name << ' ' << i;
      EXPECT_EQ(network.signs.negative_boundary, result->obtuse_boundary_edges)
          << scan.name << ' ' << i;
      negative += network.signs.negative();
      boundary += network.signs.boundary;
      const std::vector<NodeKind> free(network.size(), NodeKind::kFree);
      SparseFactor factor;
      EXPECT_TRUE(factor.make(network, free)) << scan.name << ' ' << i;
      EXPECT_TRUE(solve_global(network, free)) << scan.name << ' ' << i;
    }
    printf("%s: after %zu cuts %zu of %zu boundary springs are negative\n", scan.name.c_str(), cuts,
           negative, boundary);
    EXPECT_GT(negative, 0U);
  }
}

}  // namespace
}  // namespace trocar::runtime
