// SPDX-License-Identifier: Apache-2.0
// Surfaces for display in an asset: stored without loss, not read with slices, damage refused.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <string>

#include "formats/asset/asset.h"
#include "formats/asset/payload.h"
#include "tests/support/take.h"

namespace trocar {
namespace {

// A torus of n x n squares: closed, with a handle. Far from the origin, as a patient's coordinates.
TriangleSurface torus(std::int32_t n) {
  TriangleSurface out;
  out.lattice.bits = 7;
  const auto at = [n](std::int32_t i, std::int32_t j) {
    return static_cast<std::uint32_t>((i % n) * n + j % n);
  };
  for (std::int32_t i = 0; i < n; ++i) {
    for (std::int32_t j = 0; j < n; ++j) {
      const double a = 2 * M_PI * i / n, b = 2 * M_PI * j / n, r = 3000 + 1000 * std::cos(b);
      out.vertices.push_back(
          {static_cast<std::int32_t>(std::lrint(r * std::cos(a))) - 2'000'001,
           static_cast<std::int32_t>(std::lrint(r * std::sin(a))) + 77'777,
           static_cast<std::int32_t>(std::lrint(1000 * std::sin(b))) + 12'345'678});
      out.triangles.push_back({at(i, j), at(i + 1, j), at(i + 1, j + 1)});
      out.triangles.push_back({at(i, j), at(i + 1, j + 1), at(i, j + 1)});
    }
  }
  return out;
}

AssetSlice square(int index) {
  AssetSlice slice;
  slice.index = index;
  slice.z_mm = index;
  slice.T_lps_plane.translation().z() = index;
  slice.pslg.rings = {{{0, 0}, {512, 0}, {512, 512}, {0, 512}}};
  slice.mesh.vertices = slice.pslg.rings[0];
  slice.mesh.triangles = {{0, 1, 2}, {0, 2, 3}};
  return slice;
}

Asset with_surface() {
  Asset asset;
  asset.generator = "test";
  asset.slices = {square(0), square(1), square(2)};
  asset.surfaces = {{0, torus(24), 0.125}};
  return asset;
}

// Triangles by their corners' coordinates, each beginning with the least, in order.
std::vector<std::array<SpacePoint, 3>> geometry(const TriangleSurface& s) {
  std::vector<std::array<SpacePoint, 3>> out;
  for (const auto& t : s.triangles) {
    std::array<SpacePoint, 3> p{s.vertices[t[0]], s.vertices[t[1]], s.vertices[t[2]]};
    std::rotate(p.begin(), std::min_element(p.begin(), p.end()), p.end());
    out.push_back(p);
  }
  std::sort(out.begin(), out.end());
  return out;
}

TEST(AssetSurface, IsStoredWithoutLoss) {
  const Asset asset = with_surface();
  ASSERT_TRUE(check_triangle_surface(asset.surfaces[0].surface));
  AssetSizes sizes;
  const auto glb = test::take(encode_asset(asset, &sizes));
  const auto read = test::take(decode_asset(glb, "a.glb"));
  EXPECT_EQ(read.slices.size(), 3U);
  ASSERT_EQ(read.surfaces.size(), 1U);
  EXPECT_EQ(read.surfaces[0].material, 0);
  EXPECT_EQ(read.surfaces[0].distance_mm, 0.125);
  EXPECT_EQ(read.surfaces[0].surface.lattice, asset.surfaces[0].surface.lattice);
  EXPECT_EQ(geometry(read.surfaces[0].surface), geometry(asset.surfaces[0].surface));
  EXPECT_TRUE(verify_asset(read, "a.glb"));
  const auto again = test::take(asset_sizes(glb, "a.glb"));
  EXPECT_GT(sizes.surface_bytes, 0U);
  EXPECT_EQ(again.surface_bytes, sizes.surface_bytes);
  EXPECT_EQ(again.triangles, sizes.triangles);
  EXPECT_EQ(sizes.triangles, 6U);  // of slices only
  EXPECT_EQ(again.triangle_bytes, sizes.triangle_bytes);
}

TEST(AssetSurface, WithBytesAfterItsMeshIsRefused) {
  const TriangleSurface surface = torus(24);
  auto bytes = encode_surface(surface);
  ASSERT_TRUE(bytes);
  const auto decode = [&] {
    return decode_surface(*bytes, surface.vertices.size(), surface.triangles.size(),
                          surface.lattice);
  };
  ASSERT_TRUE(decode());
  bytes->push_back(0);
  const auto out = decode();
  ASSERT_FALSE(out);
  EXPECT_EQ(out.error().message, "Draco: bytes after the mesh");
}

TEST(AssetSurface, IsNotReadWithSlices) {
  const auto glb = test::take(encode_asset(with_surface()));
  Asset plain = with_surface();
  plain.surfaces.clear();
  const auto without = test::take(encode_asset(plain));
  const auto part = decode_asset_part(glb, "a.glb", {1});
  const auto part_without = decode_asset_part(without, "a.glb", {1});
  ASSERT_TRUE(part && part_without);
  EXPECT_EQ(part->read_bytes, part_without->read_bytes);
  EXPECT_TRUE(part->asset.surfaces.empty());
  EXPECT_EQ(part->asset.slices.size(), 1U);
}

TEST(AssetSurface, ThatIsNotClosedIsRefused) {
  Asset asset = with_surface();
  asset.surfaces[0].surface.triangles.pop_back();
  const auto verified = verify_asset(asset, "a.glb");
  ASSERT_FALSE(verified);
  EXPECT_EQ(verified.error().code, ExitCode::kRefused);
  EXPECT_TRUE(verified.error().message.starts_with("a.glb: surface of material 0: "))
      << verified.error().message;
  EXPECT_FALSE(encode_asset(asset));
}

// The texts of the JSON stay as long as they were, so that all offsets hold.
TEST(AssetSurface, WithOtherTextIsRefused) {
  const auto glb = test::take(encode_asset(with_surface()));
  for (const auto& [from, to] : std::vector<std::pair<std::string, std::string>>{
           {"\"surface\":0", "\"surface\":-"},
           {"\"lattice_bits\":7", "\"lattice_bits\":6"},
           {"\"distance_mm\":0.125", "\"distance_mm\":-.125"},
           {"\"distance_mm\":0.125", "\"distance_mm\":-0.12"}}) {
    std::string text(glb.begin(), glb.end());
    const std::size_t at = text.rfind(from);
    ASSERT_NE(at, std::string::npos) << from;
    ASSERT_EQ(from.size(), to.size());
    text.replace(at, from.size(), to);
    const std::vector<std::uint8_t> bytes(text.begin(), text.end());
    const auto read = decode_asset(bytes, "a.glb");
    EXPECT_FALSE(read) << to;
  }
}

}  // namespace
}  // namespace trocar
