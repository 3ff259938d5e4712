// SPDX-License-Identifier: Apache-2.0
// HU of slices: which samples are stored, that they survive the file and metal survives with them,
// means and interpolation against plain formulas, and that damaged bytes are refused.
#include "formats/asset/hu_codec.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <nlohmann/json.hpp>
#include <random>

#include "formats/asset/asset.h"
#include "formats/asset/payload.h"
#include "tests/support/glb_bytes.h"
#include "tests/support/sheet_fixture.h"
#include "tests/support/take.h"

namespace trocar {
namespace {

using Bytes = std::vector<std::uint8_t>;
const Lattice kLattice;

HuGrid grid_of(int columns, int rows, double pitch_mm, int step_hu) {
  HuGrid grid;
  grid.origin_mm = {1.25, -3};
  grid.pitch_mm = {pitch_mm, 1.1 * pitch_mm};
  grid.columns = columns;
  grid.rows = rows;
  grid.step_hu = step_hu;
  grid.margin_steps = 384;
  return grid;
}

// A star with a hole, both of long and short edges.
Pslg star(std::uint32_t seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> radius(2500, 4200);
  Pslg out;
  for (const int sign : {1, -1}) {
    Ring ring;
    const int corners = 60;
    for (int i = 0; i < corners; ++i) {
      const double angle = sign * 2 * 3.14159265358979 * i / corners,
                   length = sign > 0 ? radius(random) : 1000.0;
      ring.push_back({static_cast<std::int32_t>(5000 + length * std::cos(angle)),
                      static_cast<std::int32_t>(4800 + length * std::sin(angle))});
    }
    out.rings.push_back(ring);
  }
  return out;
}

// The definition: inside by the crossing number, or near to an edge, both in exact integers.
bool should_be_stored(LatticePoint p, const Pslg& outline, std::int64_t margin) {
  bool inside = false;
  for (const Ring& ring : outline.rings) {
    for (std::size_t i = 0; i < ring.size(); ++i) {
      const LatticePoint a = ring[i], b = ring[(i + 1) % ring.size()];
      if ((a.y > p.y) != (b.y > p.y) && (orient2d(a, b, p) > 0) == (b.y > a.y)) inside = !inside;
      const std::int64_t along =
          (std::int64_t{p.x} - a.x) * (b.x - a.x) + (std::int64_t{p.y} - a.y) * (b.y - a.y);
      const std::int64_t length2 = distance2(a, b), across = orient2d(a, b, p);
      if (along <= 0         ? distance2(a, p) <= margin * margin
          : along >= length2 ? distance2(b, p) <= margin * margin
                             : Int128{across} * across <= Int128{margin * margin} * length2)
        return true;
    }
  }
  return inside;
}

TEST(HuMask, StoresTheSamplesNearTheMaterial) {
  for (std::uint32_t seed = 0; seed < 20; ++seed) {
    const HuGrid grid = grid_of(40, 30, 0.5 + 0.1 * seed, 8);
    const Pslg outline = star(seed);
    const Pslg* const outlines[] = {&outline};
    const auto mask = test::take(hu_mask(grid, kLattice, outlines));
    for (int r = 0; r < grid.rows; ++r) {
      for (int c = 0; c < grid.columns; ++c) {
        const LatticePoint p{kLattice.snap_mm(grid.origin_mm.x() + c * grid.pitch_mm.x()),
                             kLattice.snap_mm(grid.origin_mm.y() + r * grid.pitch_mm.y())};
        const int i = c - mask.first_column, j = r - mask.first_row;
        const bool in_box = i >= 0 && j >= 0 && i < mask.columns && j < mask.rows;
        const bool stored =
            in_box &&
            mask.is_stored[static_cast<std::size_t>(j) * static_cast<std::size_t>(mask.columns) +
                           static_cast<std::size_t>(i)] != 0;
        ASSERT_EQ(stored, should_be_stored(p, outline, grid.margin_steps))
            << "seed " << seed << ", sample " << c << ", " << r;
      }
    }
  }
}

// Noise with edges, and metal.
float noise(int column, int row) {
  const auto mixed = static_cast<std::uint32_t>(column * 7919 + row * 104729) * 2654435761U;
  const float value = static_cast<float>(mixed >> 22) - 300;
  return column % 11 == 5 && row % 7 == 3 ? 65000 * value : value;
}

TEST(HuCodec, KeepsMultiplesOfTheStepAndMeans) {
  const HuGrid grid = grid_of(60, 40, 0.5, 8);
  const Pslg outline = star(3);
  const Pslg* const outlines[] = {&outline};
  const auto mask = test::take(hu_mask(grid, kLattice, outlines));
  const auto exact = [](int c, int r) { return 8 * std::rint(noise(c, r) / 8); };
  const Bytes bytes = encode_hu_plane(grid, mask, exact);
  const auto plane = test::take(decode_hu_plane(bytes, grid, kLattice, outlines));
  const Bytes rounded = encode_hu_plane(grid, mask, noise);
  const auto near = test::take(decode_hu_plane(rounded, grid, kLattice, outlines));
  std::size_t stored = 0;
  for (std::size_t i = 0; i < plane.hu.size(); ++i) {
    const int c = plane.first_column + static_cast<int>(i) % plane.columns,
              r = plane.first_row + static_cast<int>(i) / plane.columns;
    ASSERT_EQ(std::isnan(plane.hu[i]), mask.is_stored[i] == 0);
    if (mask.is_stored[i] == 0) continue;
    ++stored;
    EXPECT_EQ(plane.hu[i], exact(c, r)) << c << ", " << r;
    const double most = 16 + 1e-6 * std::abs(static_cast<double>(noise(c, r)));
    EXPECT_NEAR(near.hu[i], noise(c, r), most) << c << ", " << r;
  }
  EXPECT_GT(stored, 300U);
  // Clamped, not undefined.
  for (const float far : {1e30F, -1e30F, std::numeric_limits<float>::infinity()}) {
    const Bytes clamped = encode_hu_plane(grid, mask, [far](int, int) { return far; });
    const auto decoded = test::take(decode_hu_plane(clamped, grid, kLattice, outlines));
    for (std::size_t i = 0; i < decoded.hu.size(); ++i) {
      if (mask.is_stored[i] != 0) {
        EXPECT_EQ(decoded.hu[i], std::copysign(8 * static_cast<float>(kMaxHuSteps), far));
      }
    }
  }
}

TEST(HuCodec, RefusesDamagedBytes) {
  const HuGrid grid = grid_of(60, 40, 0.5, 8);
  const Pslg outline = star(3), other = star(4);
  const Pslg* const outlines[] = {&outline};
  const Pslg* const others[] = {&other};
  const auto mask = hu_mask(grid, kLattice, outlines);
  const Bytes bytes = encode_hu_plane(grid, *mask, noise);
  EXPECT_FALSE(decode_hu_plane(bytes, grid, kLattice, others));
  EXPECT_FALSE(decode_hu_plane({}, grid, kLattice, outlines));
  EXPECT_FALSE(decode_hu_plane(bytes, grid, kLattice, {}));
  Bytes longer = bytes;
  longer.push_back(0);
  EXPECT_FALSE(decode_hu_plane(longer, grid, kLattice, outlines));
  for (std::size_t size = 0; size < bytes.size(); size += 7)
    EXPECT_FALSE(decode_hu_plane(std::span(bytes).first(size), grid, kLattice, outlines)) << size;
  for (std::size_t at = 0; at < bytes.size(); at += 3) {
    Bytes changed = bytes;
    changed[at] ^= 0x10;
    EXPECT_FALSE(decode_hu_plane(changed, grid, kLattice, outlines)) << at;
  }
}

TEST(HuCodec, RefusesGridsOutOfRange) {
  const HuGrid good = grid_of(60, 40, 0.5, 8);
  EXPECT_TRUE(check_hu_grid(good, kLattice));
  const auto expect_refused = [&](auto change) {
    HuGrid grid = good;
    change(grid);
    EXPECT_FALSE(check_hu_grid(grid, kLattice));
  };
  expect_refused([](HuGrid& g) { g.columns = 0; });
  expect_refused([](HuGrid& g) { g.rows = kMaxHuSide + 1; });
  expect_refused([](HuGrid& g) { g.pitch_mm.x() = 0.001; });
  expect_refused([](HuGrid& g) { g.pitch_mm.y() = -1; });
  expect_refused([](HuGrid& g) { g.pitch_mm.y() = std::nan(""); });
  expect_refused([](HuGrid& g) { g.origin_mm.x() = 1e12; });
  expect_refused([](HuGrid& g) { g.step_hu = 0; });
  expect_refused([](HuGrid& g) { g.margin_steps = 0; });
  expect_refused([](HuGrid& g) { g.margin_steps = kMaxHuMargin + 1; });
  expect_refused([](HuGrid& g) { g.margin_steps = -1, g.columns = g.rows = kMaxHuSide; });
}

TEST(HuPlane, IsBilinearAndAveragesDiscs) {
  HuPlane plane;
  plane.origin_mm = {2, 3};
  plane.pitch_mm = {0.5, 0.8};
  plane.columns = 30, plane.rows = 25;
  for (int r = 0; r < plane.rows; ++r) {
    for (int c = 0; c < plane.columns; ++c)
      plane.hu.push_back(static_cast<float>(100 + 20 * (2 + 0.5 * c) - 30 * (3 + 0.8 * r)));
  }
  const auto linear = [](double x, double y) { return 100 + 20 * x - 30 * y; };
  for (const auto& [x, y] : {std::pair(5.3, 9.1), std::pair(2.0, 3.0), std::pair(16.5, 22.2)})
    EXPECT_NEAR(plane.at(x, y), linear(x, y), 1e-3);
  EXPECT_NEAR(plane.mean(8, 10, 1.5), linear(8, 10), 1e-3);
  EXPECT_TRUE(std::isnan(plane.at(1.4, 5)));
  EXPECT_TRUE(std::isnan(plane.at(5, 23.1)));
  EXPECT_TRUE(std::isnan(plane.at(std::nan(""), 5)));
  EXPECT_TRUE(std::isnan(plane.mean(-50, 0, 1.5)));
  // Samples that are not stored have no weight.
  plane.hu[0] = std::numeric_limits<float>::quiet_NaN();
  EXPECT_NEAR(plane.at(2.25, 3), plane.hu[1], 1e-3);
  EXPECT_TRUE(std::isnan(plane.at(2, 3)));
}

TEST(HuVolume, IsLinearBetweenPlanes) {
  HuVolume volume;
  EXPECT_TRUE(std::isnan(volume.at({0, 0, 0})));
  for (const auto& [index, z] : {std::pair(3, 0.0), std::pair(4, 2.0), std::pair(7, 3.0)}) {
    HuPlane plane;
    plane.index = index;
    plane.T_lps_plane = Eigen::Translation3d(10, -5, z);
    plane.columns = plane.rows = 4;
    plane.hu.assign(16, static_cast<float>(100 * index));
    volume.planes.push_back(plane);
  }
  EXPECT_EQ(volume.find(4)->index, 4);
  EXPECT_EQ(volume.find(5), nullptr);
  EXPECT_FLOAT_EQ(volume.at({11, -4, 0.5}), 325);
  EXPECT_FLOAT_EQ(volume.at({11, -4, 2.5}), 550);
  EXPECT_FLOAT_EQ(volume.at({11, -4, -9}), 300);
  EXPECT_FLOAT_EQ(volume.at({11, -4, 9}), 700);
  EXPECT_TRUE(std::isnan(volume.at({0, 0, 0.5})));
}

// Three slices of squares with HU, and a context in every second one.
Asset asset_with_hu() {
  Asset asset;
  asset.generator = "trocar-mesh 0.2.0";
  for (int i = 0; i < 3; ++i) {
    AssetSlice slice;
    slice.index = i;
    slice.z_mm = i;
    slice.T_lps_plane = Eigen::Translation3d(0, 0, i);
    if (i != 1) {
      slice.mesh = test::square_mesh({1024, 1024}, 256, 12);
      slice.pslg = boundary_rings(slice.mesh);
    }
    asset.slices.push_back(slice);
  }
  asset.hu.grid = grid_of(30, 40, 0.7, 8);
  asset.context.grid = grid_of(9, 7, 2.5, 16);
  asset.context.grid.margin_steps = -1;
  for (HuVolume* volume : {&asset.hu, &asset.context}) {
    for (const AssetSlice& slice : asset.slices) {
      if (volume == &asset.hu ? slice.pslg.rings.empty() : slice.index == 1) continue;
      const Pslg* const outlines[] = {&slice.pslg};
      const auto mask = hu_mask(volume->grid, asset.lattice, outlines);
      auto plane = decode_hu_plane(encode_hu_plane(volume->grid, *mask, noise), volume->grid,
                                   asset.lattice, outlines);
      plane->index = slice.index;
      plane->T_lps_plane = slice.T_lps_plane;
      volume->planes.push_back(*plane);
    }
  }
  return asset;
}

void expect_same(const HuVolume& a, const HuVolume& b) {
  ASSERT_EQ(a.planes.size(), b.planes.size());
  for (std::size_t i = 0; i < a.planes.size(); ++i) {
    const HuPlane &p = a.planes[i], &q = b.planes[i];
    EXPECT_EQ(p.index, q.index);
    EXPECT_EQ(p.T_lps_plane.matrix(), q.T_lps_plane.matrix());
    EXPECT_EQ(p.origin_mm, q.origin_mm);
    ASSERT_EQ(p.hu.size(), q.hu.size());
    EXPECT_EQ(std::memcmp(p.hu.data(), q.hu.data(), p.hu.size() * sizeof(float)), 0);
  }
}

TEST(HuInAsset, SurvivesTheFileWholeAndInPart) {
  const Asset asset = asset_with_hu();
  AssetSizes sizes;
  const auto glb = test::take(encode_asset(asset, &sizes));
  const auto whole = test::take(decode_asset(glb, "test"));
  EXPECT_EQ(whole.hu.planes.size(), 2U);
  expect_same(whole.hu, asset.hu);
  expect_same(whole.context, asset.context);
  EXPECT_EQ(asset_sizes(glb, "test")->hu_bytes, sizes.hu_bytes);
  EXPECT_GT(sizes.hu_bytes, 500U);
  // Stored again, they are the same, although Draco orders the triangles anew.
  const auto again = test::take(decode_asset(*encode_asset(whole), "test"));
  expect_same(again.hu, asset.hu);
  expect_same(again.context, asset.context);
  for (const bool has_index : {true, false}) {
    const auto part =
        test::take(decode_asset_part(has_index ? glb : test::without_index(glb), "test", {1, 2}));
    ASSERT_EQ(part.asset.hu.planes.size(), 1U);
    EXPECT_TRUE(part.asset.context.planes.empty());
    HuVolume second = asset.hu;
    second.planes.erase(second.planes.begin());
    expect_same(part.asset.hu, second);
  }
}

// Slices with two small squares in opposite corners of a box of about `side` x `side` samples.
Asset asset_of_corners(int side, int slices) {
  Asset asset;
  asset.generator = "trocar-mesh 0.2.0";
  AssetSlice slice;
  for (const std::int32_t corner : {0, 32 * side}) {
    const SliceMesh square = test::square_mesh({corner, corner}, 64, 1);
    const auto first = static_cast<std::uint32_t>(slice.mesh.vertices.size());
    slice.mesh.vertices.insert(slice.mesh.vertices.end(), square.vertices.begin(),
                               square.vertices.end());
    for (const Triangle& t : square.triangles)
      slice.mesh.triangles.push_back({t[0] + first, t[1] + first, t[2] + first});
  }
  slice.pslg = boundary_rings(slice.mesh);
  HuGrid& grid = asset.hu.grid;
  grid.pitch_mm = {kLattice.to_mm(32), kLattice.to_mm(32)};
  grid.columns = grid.rows = side + 8;
  grid.margin_steps = 32;
  const Pslg* const outlines[] = {&slice.pslg};
  const auto mask = hu_mask(grid, kLattice, outlines);
  auto plane = decode_hu_plane(encode_hu_plane(grid, *mask, noise), grid, kLattice, outlines);
  for (int i = 0; i < slices; ++i) {
    slice.index = plane->index = i;
    slice.z_mm = i;
    slice.T_lps_plane = plane->T_lps_plane = Eigen::Translation3d(0, 0, i);
    asset.slices.push_back(slice);
    asset.hu.planes.push_back(*plane);
  }
  return asset;
}

TEST(HuInAsset, ASmallFileHasFewSamples) {
  const auto small = test::take(encode_asset(asset_of_corners(1000, 2)));
  const auto decoded = decode_asset(small, "test");
  EXPECT_TRUE(decoded) << decoded.error().message;
  const auto large = encode_asset(asset_of_corners(3000, 5));
  ASSERT_TRUE(large) << large.error().message;
  ASSERT_LT(max_hu_samples(large->size()), 5 * 3000U * 3000U) << large->size();
  const auto refused = decode_asset(*large, "test");
  ASSERT_FALSE(refused);
  EXPECT_NE(refused.error().message.find("more HU than a file of its size may have"),
            std::string::npos)
      << refused.error().message;
  // A file of a megabyte takes little more than 1 GiB; a large one has all samples of its scan.
  EXPECT_LE(max_hu_samples(1U << 20) * sizeof(float), (std::uint64_t{5} << 28));
  EXPECT_GT(max_hu_samples(std::uint64_t{60} << 20), std::uint64_t{2000} * 512 * 512);
}

// Every byte of the volumes changed, and every number of their JSON.
TEST(HuInAsset, RefusesWhatIsDamaged) {
  const auto glb = test::take(encode_asset(asset_with_hu()));
  const nlohmann::json document = nlohmann::json::parse(test::json_of(glb));
  const std::size_t binary_at = test::binary_at(glb);
  const nlohmann::json& volumes = document["extras"]["trocar"]["hu_volumes"];
  ASSERT_EQ(volumes.size(), 2U);
  for (const auto& volume : volumes) {
    const std::size_t at = binary_at + volume["byteOffset"].get<std::size_t>();
    for (std::size_t i = 0; i < volume["byteLength"].get<std::size_t>(); ++i) {
      Bytes changed = glb;
      changed[at + i] ^= 0x55;
      EXPECT_FALSE(decode_asset(changed, "test")) << i;
    }
  }
  Bytes moved = glb;  // the plane of slice 2 becomes that of slice 1, which is empty
  const std::size_t records = binary_at + volumes[0]["byteOffset"].get<std::size_t>();
  ASSERT_EQ(moved[records + 8], 2);
  moved[records + 8] = 1;
  EXPECT_FALSE(decode_asset(moved, "test"));
  const auto with = [&](std::size_t volume, const char* key, const nlohmann::json& value) {
    nlohmann::json other = document;
    other["extras"]["trocar"]["hu_volumes"][volume][key] = value;
    return test::without_index(test::with_json(glb, other.dump()));
  };
  EXPECT_TRUE(decode_asset(with(0, "more", 1), "test"));
  const nlohmann::json bad[] = {nullptr, "x",    -1,         0.5,    4294967296.0,
                                1e300,   {0, 0}, {1e300, 1}, {-1, 2}};
  for (const char* key : {"version", "bufferView", "planes", "pitch_mm", "size", "step_hu"}) {
    for (const auto& value : bad)
      EXPECT_FALSE(decode_asset(with(0, key, value), "test")) << key << " " << value;
  }
  EXPECT_FALSE(decode_asset(with(0, "version", 2), "test"));
  EXPECT_FALSE(decode_asset(with(0, "planes", 1), "test"));
  EXPECT_FALSE(decode_asset(with(0, "planes", 100'000), "test"));
  EXPECT_FALSE(decode_asset(with(0, "bufferView", 0), "test"));
  EXPECT_FALSE(decode_asset(with(0, "margin_steps", 300), "test"));
  EXPECT_FALSE(decode_asset(with(1, "margin_steps", 384), "test"));
  EXPECT_FALSE(decode_asset(with(0, "size", {30000, 30000}), "test") &&
               decode_asset(with(1, "size", {30000, 30000}), "test"));
}

}  // namespace
}  // namespace trocar
