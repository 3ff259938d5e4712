// SPDX-License-Identifier: GPL-3.0-or-later
// Refinement makes all springs of a slice's mesh non-negative; and what a cut changes.
#include <gtest/gtest.h>

#include "formats/mesh/cut.h"
#include "formats/mesh/mesh_validity.h"
#include "formats/mesh/triangulation.h"
#include "runtime/haptics/membrane/region.h"
#include "tests/reference/deformation/global_solver.h"
#include "tests/reference/deformation/network_checks.h"
#include "tests/support/campaign.h"
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
  return all;
}

TEST(Springs, AreNotNegativeInRefinedMeshes) {
  const std::vector<test::ScanAsset> scans = test::scan_assets();
  if (scans.empty()) GTEST_SKIP() << "no assets: TROCAR_ASSETS names their folder";
  for (const test::ScanAsset& scan : scans)
    EXPECT_EQ(of_all_slices(scan).negative(), 0U) << scan.name;
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
    std::size_t negative = 0;
    for (int i = 0; i < test::campaign(60); ++i) {
      const AssetSlice& slice = *scan.slices[random() % scan.slices.size()];
      const double size = (1 + 5 * test::uniform(random)) / scan.asset.lattice.step_mm();
      const auto result = cut(slice.mesh, test::regular_polygon(test::place_in(slice.mesh, random),
                                                                size, 6, test::uniform(random)));
      ASSERT_TRUE(result) << result.error().message;
      if (result->mesh.triangles.empty()) continue;
      const Network network = make_network(result->mesh, scan.asset.lattice, membrane);
      EXPECT_EQ(network.signs.negative_interior, 0U) << scan.name << ' ' << i;
      EXPECT_EQ(network.signs.negative_boundary, result->obtuse_boundary_edges)
          << scan.name << ' ' << i;
      negative += network.signs.negative();
      const std::vector<NodeKind> free(network.size(), NodeKind::kFree);
      SparseFactor factor;
      EXPECT_TRUE(factor.make(network, free)) << scan.name << ' ' << i;
      EXPECT_TRUE(solve_global(network, free)) << scan.name << ' ' << i;
    }
    EXPECT_GT(negative, 0U);
  }
}

}  // namespace
}  // namespace trocar::runtime
