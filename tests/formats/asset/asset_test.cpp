// SPDX-License-Identifier: Apache-2.0
// The asset codec: lossless on the lattice, and safe against hostile bytes. Surfaces for display:
// stored without loss, not read with slices, damage refused.
#include "formats/asset/asset.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <nlohmann/json.hpp>
#include <random>
#include <string>
#include <utility>

#include "formats/asset/draco_mesh.h"
#include "formats/asset/payload.h"
#include "formats/mesh/mesh_validity.h"
#include "tests/support/glb_bytes.h"
#include "tests/support/motions.h"
#include "tests/support/take.h"

namespace trocar {
namespace {

using test::canonical;
using test::json_of;
using test::put_number;
using test::with_json;
using test::without_index;

// A grid of nx by ny cells with jittered inner vertices: valid, and of many coordinates.
SliceMesh jittered_grid(std::int32_t nx, std::int32_t ny, std::int32_t cell, LatticePoint origin,
                        std::uint64_t seed) {
  std::mt19937_64 rng(seed);
  SliceMesh mesh;
  const auto jitter = [&] {
    return static_cast<std::int32_t>(rng() % static_cast<std::uint64_t>(cell / 2 + 1)) - cell / 4;
  };
  for (std::int32_t y = 0; y <= ny; ++y) {
    for (std::int32_t x = 0; x <= nx; ++x) {
      LatticePoint p{origin.x + x * cell, origin.y + y * cell};
      if (x > 0 && x < nx && y > 0 && y < ny) p = {p.x + jitter() / 2, p.y + jitter() / 2};
      mesh.vertices.push_back(p);
    }
  }
  const auto id = [nx](std::int32_t x, std::int32_t y) {
    return static_cast<std::uint32_t>(y * (nx + 1) + x);
  };
  for (std::int32_t y = 0; y < ny; ++y) {
    for (std::int32_t x = 0; x < nx; ++x) {
      mesh.triangles.push_back({id(x, y), id(x + 1, y), id(x + 1, y + 1)});
      mesh.triangles.push_back({id(x, y), id(x + 1, y + 1), id(x, y + 1)});
    }
  }
  return mesh;
}

Asset make_asset(int bits, LatticePoint origin = {-777, 12345}) {
  Asset asset;
  asset.lattice.bits = bits;
  asset.generator = "asset_test";
  asset.parameters_json = R"({"labels":[20,22],"threshold":226.5})";
  asset.input_key_digest = "0123abcd";
  for (int i = 0; i < 3; ++i) {
    AssetSlice slice;
    slice.index = 2 * i + 1;
    slice.z_mm = 0.1 * i;
    slice.T_lps_plane = Eigen::Translation3d(1.25, -3.1, 0.1 * i) *
                        Eigen::AngleAxisd(0.3, Eigen::Vector3d::UnitX());
    slice.measures_json = R"({"area_mm2":0.3333333333333333,"mean_hu":431.28})";
    if (i != 1) {
      slice.mesh = jittered_grid(13 + i, 7, 97, origin, 5 + static_cast<std::uint64_t>(i));
      slice.pslg = boundary_rings(slice.mesh);
    }
    asset.slices.push_back(slice);
  }
  return asset;
}

class AssetRoundTrip : public testing::TestWithParam<int> {};

TEST_P(AssetRoundTrip, IsLosslessAndDeterministic) {
  const Asset in = make_asset(GetParam());
  const auto glb = test::take(encode_asset(in));
  EXPECT_EQ(glb, *encode_asset(in));
  const auto out = test::take(decode_asset(glb, "test"));
  EXPECT_TRUE(verify_asset(out, "test"));
  EXPECT_EQ(out.lattice, in.lattice);
  EXPECT_EQ(out.parameters_json, in.parameters_json);
  EXPECT_EQ(out.input_key_digest, in.input_key_digest);
  EXPECT_EQ(out.generator, in.generator);
  ASSERT_EQ(out.slices.size(), in.slices.size());
  for (std::size_t i = 0; i < in.slices.size(); ++i) {
    EXPECT_EQ(out.slices[i].index, in.slices[i].index);
    EXPECT_EQ(out.slices[i].z_mm, in.slices[i].z_mm);
    EXPECT_EQ(out.slices[i].measures_json, R"({"mean_hu":431.3})");
    EXPECT_EQ(out.slices[i].T_lps_plane.matrix(), in.slices[i].T_lps_plane.matrix());
    EXPECT_EQ(out.slices[i].pslg.rings, in.slices[i].pslg.rings);
    EXPECT_EQ(canonical(out.slices[i].mesh), canonical(in.slices[i].mesh));
  }
}

INSTANTIATE_TEST_SUITE_P(LatticeBits, AssetRoundTrip, testing::Values(0, 1, 4, 6, 8, 11, 14));

TEST(Asset, SizesFromEncodingEqualThoseOfTheFile) {
  AssetSizes stated;
  const auto glb = encode_asset(make_asset(8), &stated);
  const auto found = test::take(asset_sizes(*glb, "test"));
  EXPECT_EQ(stated.json_bytes, found.json_bytes);
  EXPECT_EQ(stated.index_bytes, found.index_bytes);
  EXPECT_EQ(stated.index_bytes, 52U + 3 * 24);
  EXPECT_EQ(stated.triangle_bytes, found.triangle_bytes);
  EXPECT_EQ(stated.outline_bytes, found.outline_bytes);
  EXPECT_EQ(stated.triangles, found.triangles);
  EXPECT_EQ(stated.triangles, 2U * 7 * (13 + 15));
}

TEST(Asset, LabelsAndMeanHuComeFromTheJsonText) {
  const Asset asset = make_asset(8);
  EXPECT_EQ(labels_of(asset), (std::vector<int>{20, 22}));
  EXPECT_EQ(mean_hu_of(asset.slices[0]), 431.28);
  for (const char* text : {"{}", "[]", "", R"({"labels":22,"mean_hu":"400"})"}) {
    Asset other;
    other.parameters_json = text;
    EXPECT_TRUE(labels_of(other).empty()) << text;
    AssetSlice slice;
    slice.measures_json = text;
    EXPECT_FALSE(mean_hu_of(slice)) << text;
  }
  Asset mixed;
  mixed.parameters_json = R"({"labels":["7",8.0,8.5,1e99,-3,18446744073709551615,true]})";
  EXPECT_EQ(labels_of(mixed), (std::vector<int>{8, -3}));
}

// HU by place, so that they can be compared after Draco's reordering.
float hu_at(LatticePoint p) {
  return static_cast<float>(0.37 * p.x - 0.21 * p.y + 300);
}

Asset with_hu(Asset asset) {
  for (AssetSlice& slice : asset.slices) {
    for (const LatticePoint p : slice.mesh.vertices)
      slice.hu.push_back(hu_at(p));
  }
  return asset;
}

TEST(Asset, HuComeBackOnTheirStep) {
  const Asset in = with_hu(make_asset(8));
  const auto out = test::take(decode_asset(*encode_asset(in), "test"));
  for (const AssetSlice& slice : out.slices) {
    ASSERT_EQ(slice.hu.size(), slice.mesh.vertices.size());
    for (std::size_t v = 0; v < slice.hu.size(); ++v) {
      const double exact = std::clamp(hu_at(slice.mesh.vertices[v]), -8192.0F, 24568.0F);
      EXPECT_LE(std::abs(slice.hu[v] - exact), 4) << v;
      EXPECT_EQ(std::fmod(slice.hu[v], 8.0F), 0);
    }
    if (slice.hu.empty()) continue;
    EXPECT_EQ(slice.measures_json, R"({"mean_hu":431.3})");
    EXPECT_EQ(mean_hu_of(slice), 431.3);
  }
  Asset wrong = with_hu(make_asset(8));
  wrong.slices[0].hu.pop_back();
  EXPECT_EQ(encode_asset(wrong).error().code, ExitCode::kBug);
  wrong.slices[0].hu.push_back(std::numeric_limits<float>::quiet_NaN());
  EXPECT_EQ(encode_asset(wrong).error().code, ExitCode::kBug);
}

// The mean over the mesh of the linear field is not the mean over its vertices.
TEST(Asset, MeanHuIsTheFieldsMeanOverTheArea) {
  AssetSlice slice;
  slice.mesh = {{{0, 0}, {300, 0}, {0, 300}, {100, 300}}, {{0, 1, 2}, {1, 3, 2}}};
  for (const LatticePoint p : slice.mesh.vertices)
    slice.hu.push_back(static_cast<float>(2 * p.x + 50));
  // Areas 45000 and 15000, centroids at x = 100 and 400 / 3.
  EXPECT_NEAR(*mean_hu_of(slice), 50 + 2 * (45000 * 100 + 15000 * 400.0 / 3) / 60000, 1e-4);
  // The measured mean is nearer to the scan than the field.
  slice.measures_json = R"({"mean_hu":7})";
  EXPECT_EQ(mean_hu_of(slice), 7);
}

// Two slices of two materials each, one of one, and one without material.
Asset two_materials() {
  Asset asset = make_asset(8);
  asset.materials = {{"L3", 22}, {"marrow", {}}};
  AssetSlice marrow = asset.slices[0];
  marrow.material = 1;
  marrow.mesh = jittered_grid(3, 4, 55, {3000, -100}, 9);
  marrow.pslg = boundary_rings(marrow.mesh);
  asset.slices.insert(asset.slices.begin() + 1, marrow);
  asset.slices.back().material = 1;
  asset.slices.push_back(asset.slices[0]);
  asset.slices.back().index = 6;
  marrow.index = 6;
  asset.slices.push_back(marrow);
  return asset;
}

TEST(Asset, MaterialsOfASliceAreEntriesOfItsIndex) {
  const Asset in = with_hu(two_materials());
  const auto glb = test::take(encode_asset(in));
  const auto out = test::take(decode_asset(glb, "test"));
  ASSERT_EQ(out.materials.size(), 2U);
  EXPECT_EQ(out.materials[0].name, "L3");
  EXPECT_EQ(out.materials[0].label, 22);
  EXPECT_EQ(out.materials[1].name, "marrow");
  EXPECT_FALSE(out.materials[1].label);
  ASSERT_EQ(out.slices.size(), 6U);
  for (std::size_t i = 0; i < 6; ++i) {
    EXPECT_EQ(out.slices[i].index, (std::array{1, 1, 3, 5, 6, 6}[i]));
    EXPECT_EQ(out.slices[i].material, (std::array{0, 1, 0, 1, 0, 1}[i]));
    EXPECT_EQ(canonical(out.slices[i].mesh), canonical(in.slices[i].mesh));
  }
  for (const auto& file : {glb, without_index(glb)}) {
    const auto part = test::take(decode_asset_part(file, "test", {6, 3}));
    EXPECT_EQ(part.asset_slices, 4U);
    ASSERT_EQ(part.asset.slices.size(), 3U);
    EXPECT_EQ(part.asset.slices[1].material, 0);
    EXPECT_EQ(part.asset.slices[2].material, 1);
    EXPECT_EQ(part.asset.slices[2].mesh.vertices, out.slices[5].mesh.vertices);
    EXPECT_EQ(part.asset.slices[2].hu, out.slices[5].hu);
    EXPECT_EQ(part.asset.materials.size(), 2U);
  }
  Asset wrong = in;
  std::swap(wrong.slices[0], wrong.slices[1]);
  EXPECT_EQ(encode_asset(wrong).error().message,
            "slice 1: slices do not ascend by index and material");
  wrong = in;
  wrong.slices[1].material = 2;
  EXPECT_EQ(encode_asset(wrong).error().code, ExitCode::kBug);
}

// Colours for viewers are those of the HU, and change nothing else.
TEST(Asset, ColoursAreThoseOfTheHu) {
  EXPECT_EQ(hu_colour(-8192), (HuColour{15, 0, 23}));
  EXPECT_EQ(hu_colour(-200), (HuColour{15, 0, 23}));
  EXPECT_EQ(hu_colour(56), (HuColour{16, 6, 50}));
  EXPECT_EQ(hu_colour(184), (HuColour{14, 14, 58}));  // half way: 13.5, 13.5, 57.5
  EXPECT_EQ(hu_colour(1848), (HuColour{250, 204, 4}));
  EXPECT_EQ(hu_colour(24568), (HuColour{250, 204, 4}));
  Asset in = with_hu(two_materials());
  const auto plain = decode_asset(*encode_asset(in), "test");
  in.colours = true;
  const std::vector<std::uint8_t> glb = *encode_asset(in);
  const std::string text(glb.begin(), glb.end());
  EXPECT_NE(text.find(R"("COLOR_0":2)"), std::string::npos);
  const auto out = test::take(decode_asset(glb, "test"));
  EXPECT_TRUE(out.colours);
  EXPECT_FALSE(plain->colours);
  const auto part = test::take(decode_asset_part(glb, "test", {6}));
  EXPECT_EQ(part.asset.slices[1].hu, out.slices[5].hu);
  for (std::size_t i = 0; i < in.slices.size(); ++i) {
    EXPECT_EQ(canonical(out.slices[i].mesh), canonical(in.slices[i].mesh));
    EXPECT_EQ(mean_hu_of(out.slices[i]), mean_hu_of(plain->slices[i]));
  }
  // Without HU there are none.
  for (AssetSlice& slice : in.slices)
    slice.hu.clear();
  const auto bare = test::take(decode_asset(*encode_asset(in), "test"));
  EXPECT_FALSE(bare.colours);
}

// Planes above each other share a frame; others have each their own. Both come back bit for bit.
TEST(Asset, EveryPlaneComesBackBitForBit) {
  Eigen::Matrix3d prone;
  prone << -1, 0, 0, 0, 0, 1, 0, 1, 0;
  const Eigen::Matrix3d tilted =
      Eigen::AngleAxisd(0.31, Eigen::Vector3d(1, 2, 3).normalized()).toRotationMatrix();
  for (const double spacing : {1.5, 0.7, 0.8000011, 0.00390625}) {
    for (const Eigen::Matrix3d& R : {Eigen::Matrix3d(Eigen::Matrix3d::Identity()), prone, tilted}) {
      for (const bool shears : {false, true}) {
        Asset in = make_asset(8);
        for (std::size_t i = 0; i < in.slices.size(); ++i) {
          const double z = -103.19998168945312 + spacing * static_cast<double>(i);
          in.slices[i].T_lps_plane.linear() = R;
          in.slices[i].T_lps_plane.translation() =
              R * Eigen::Vector3d(-30.1, shears ? 135 - 0.13 * z : 135.2, z);
        }
        const auto glb = test::take(encode_asset(in));
        const auto out = test::take(decode_asset(glb, "test"));
        for (std::size_t i = 0; i < in.slices.size(); ++i) {
          const auto part = test::take(decode_asset_part(glb, "test", {in.slices[i].index}));
          for (const AssetSlice& slice : {out.slices[i], part.asset.slices[0]}) {
            EXPECT_EQ(slice.T_lps_plane.matrix(), in.slices[i].T_lps_plane.matrix());
            EXPECT_EQ(slice.z_mm, in.slices[i].z_mm);
          }
        }
      }
    }
  }
}

// Nothing is stored twice: outlines are in the file for viewers only, on request.
TEST(Asset, LinesAreTheOutlineAndChangeNothingElse) {
  Asset in = two_materials();
  AssetSizes plain, lined;
  const auto without = decode_asset(*encode_asset(in, &plain), "test");
  in.lines = true;
  const std::vector<std::uint8_t> glb = *encode_asset(in, &lined);
  const auto with = test::take(decode_asset(glb, "test"));
  EXPECT_FALSE(without->lines);
  EXPECT_TRUE(with.lines);
  EXPECT_EQ(plain.outline_bytes, 0U);
  EXPECT_EQ(plain.triangle_bytes, lined.triangle_bytes);
  EXPECT_GT(lined.outline_bytes, 0U);
  for (std::size_t i = 0; i < in.slices.size(); ++i) {
    EXPECT_EQ(with.slices[i].pslg.rings, boundary_rings(in.slices[i].mesh).rings);
    EXPECT_EQ(without->slices[i].pslg.rings, with.slices[i].pslg.rings);
  }
  // A line that is moved: the file is refused. Its last bytes are indices of lines.
  std::vector<std::uint8_t> moved = glb;
  moved[moved.size() - 4] ^= 1;
  EXPECT_FALSE(decode_asset(moved, "test"));
}

// Seventy slices above each other, and two more after a gap; without HU, so that nodes hold means.
Asset tower() {
  Asset asset = make_asset(8);
  const AssetSlice one = asset.slices[0];
  asset.slices.clear();
  for (int i = 0; i < 72; ++i) {
    AssetSlice slice = one;
    slice.index = i < 70 ? i : i + 5;
    slice.T_lps_plane = Eigen::Translation3d(-79.84375, -54.84375, -17 + 1.5 * slice.index);
    slice.z_mm = -17 + 1.5 * slice.index;
    slice.measures_json = "{\"mean_hu\":" + std::to_string(400 + i) + "}";
    asset.slices.push_back(slice);
  }
  return asset;
}

TEST(Asset, SlicesThatFollowEachOtherShareANode) {
  const std::vector<std::uint8_t> glb = *encode_asset(tower());
  const std::string text = json_of(glb);
  std::size_t nodes = 0;
  for (std::size_t at = 0; (at = text.find(R"("mesh":)", at)) != std::string::npos; ++at)
    ++nodes;
  EXPECT_EQ(nodes, 4U);  // of 32, 32, 6 and 2 slices
  const auto whole = test::take(decode_asset(glb, "test"));
  ASSERT_EQ(whole.slices.size(), 72U);
  for (std::size_t i = 0; i < 72; ++i) {
    const AssetSlice& slice = whole.slices[i];
    EXPECT_EQ(slice.index, static_cast<int>(i < 70 ? i : i + 5));
    EXPECT_EQ(mean_hu_of(slice), 400 + static_cast<double>(i));
    const auto part = test::take(decode_asset_part(glb, "test", {slice.index}));
    EXPECT_EQ(part.asset.slices[0].measures_json, slice.measures_json);
    EXPECT_EQ(part.asset.slices[0].T_lps_plane.matrix(), slice.T_lps_plane.matrix());
    EXPECT_EQ(part.asset.slices[0].mesh.vertices, slice.mesh.vertices);
  }
}

TEST(Asset, NodesThatContradictTheirSlicesAreRefused) {
  const std::vector<std::uint8_t> glb = *encode_asset(tower());
  const std::string text = json_of(glb);
  ASSERT_TRUE(decode_asset(without_index(with_json(glb, text)), "same"));
  const std::string primitive =
      text.substr(text.find(R"([{"attributes")") + 1,
                  text.find(R"(,{"attributes")") - text.find(R"([{"attributes")"));
  for (const auto& [from, to, said] : std::vector<std::array<std::string, 3>>{
           {"400,401,", "400,", "its figures are not one for each slice"},
           {"400,401,", "[],401,", "mean_hu is not a number for each slice"},
           {R"("index":0,)", "", "mean_hu and no index"},
           {R"("index":32,)", R"("index":31,)", "slice indices do not ascend"},
           {R"("index":75,)", R"("index":2147483647,)", "too many slices in its node"},
           {R"("index":0,)", R"("index":0,"z_mm":1,)", "its figures are not one for each slice"},
           {R"({"primitives":[)", R"({"primitives":[)" + primitive, "too many slices in its node"},
       }) {
    std::string changed = text;
    const std::size_t at = changed.find(from);
    ASSERT_NE(at, std::string::npos) << from;
    changed.replace(at, from.size(), to);
    const auto out = decode_asset(without_index(with_json(glb, changed)), "test");
    ASSERT_FALSE(out) << from << " to " << to;
    EXPECT_EQ(out.error().code, ExitCode::kRefused);
    EXPECT_NE(out.error().message.find(said), std::string::npos) << out.error().message;
  }
}

// Tools that merge equal data make slices share a mesh. Few bytes could then stand for any number of
// triangles.
TEST(Asset, SlicesShareAMeshUpToALimit) {
  Asset asset = make_asset(8);
  asset.slices.resize(1);
  asset.slices[0].mesh = jittered_grid(60, 60, 97, {-777, 12345}, 5);
  asset.slices[0].pslg = boundary_rings(asset.slices[0].mesh);
  const std::vector<std::uint8_t> glb = *encode_asset(asset);
  const std::size_t triangles = asset.slices[0].mesh.triangles.size();
  const auto shared = [&](std::size_t slices) {
    auto document = nlohmann::json::parse(json_of(glb));
    document["extras"]["trocar"]["slices"] = slices;
    auto& nodes = document["nodes"];
    const auto is_slice = [](const nlohmann::json& node) { return node.contains("mesh"); };
    const auto first = std::find_if(nodes.begin(), nodes.end(), is_slice) - nodes.begin();
    const auto list = std::find_if(nodes.begin(), nodes.end(), [&](const nlohmann::json& node) {
      const auto children = node.value("children", std::vector<std::ptrdiff_t>());
      return std::find(children.begin(), children.end(), first) != children.end();
    });
    for (std::size_t i = 1; i < slices; ++i)
      list->at("children").push_back(nodes.size() + i - 1);
    for (std::size_t i = 1; i < slices; ++i) {
      nlohmann::json node = nodes[static_cast<std::size_t>(first)];
      node["extras"]["trocar"]["index"] = asset.slices[0].index + static_cast<int>(i);
      nodes.push_back(node);
    }
    return without_index(with_json(glb, document.dump()));
  };
  const auto some = test::take(decode_asset(shared(100), "test"));
  EXPECT_EQ(some.slices.size(), 100U);
  EXPECT_EQ(some.slices[99].mesh.triangles, some.slices[0].mesh.triangles);
  const std::size_t limit = std::max<std::size_t>(std::size_t{1} << 22, 64 * glb.size());
  const auto many = decode_asset(shared(limit / triangles + 2), "test");
  ASSERT_FALSE(many);
  EXPECT_EQ(many.error().code, ExitCode::kRefused);
  EXPECT_TRUE(many.error().message.ends_with("more geometry than a file of its size may have"))
      << many.error().message;
}

TEST(Asset, DecodesOnlyTheRequestedSlices) {
  const auto glb = encode_asset(make_asset(8));
  const auto out = test::take(decode_asset(*glb, "test", {.all = false, .slice_indices = {5}}));
  ASSERT_EQ(out.slices.size(), 3U);
  EXPECT_TRUE(out.slices[0].mesh.triangles.empty());
  EXPECT_FALSE(out.slices[2].mesh.triangles.empty());
}

TEST(Asset, PinchVerticesAreKept) {
  Asset asset = make_asset(8);
  asset.slices.resize(1);
  asset.slices[0].mesh = {{{0, 0}, {10, 0}, {5, 5}, {5, 5}, {10, 10}, {0, 10}},
                          {{0, 1, 2}, {3, 4, 5}}};
  asset.slices[0].pslg = boundary_rings(asset.slices[0].mesh);
  const auto glb = test::take(encode_asset(asset));
  const auto out = test::take(decode_asset(glb, "test"));
  EXPECT_TRUE(verify_asset(out, "test"));
  EXPECT_EQ(out.slices[0].mesh.vertices.size(), 6U);
}

TEST(Asset, HoldsSlicesUpToTheWidestSpan) {
  constexpr auto kMost = static_cast<std::int32_t>(kMaxAssetSpan);
  for (const std::int32_t low : {0, -4'321'077}) {
    Asset asset = make_asset(8);
    asset.slices.resize(1);
    asset.slices[0].hu.clear();
    const std::int32_t high = low + kMost;  // odd: Draco's encoder would round an odd one of 2^23
    asset.slices[0].mesh = {{{low, low}, {high, low + 3}, {low + 7, high}}, {{0, 1, 2}}};
    asset.slices[0].pslg = boundary_rings(asset.slices[0].mesh);
    const auto glb = test::take(encode_asset(asset));
    const auto out = test::take(decode_asset(glb, "wide"));
    EXPECT_EQ(out.slices[0].pslg.rings, asset.slices[0].pslg.rings);
    ++asset.slices[0].mesh.vertices[1].x;
    asset.slices[0].pslg = boundary_rings(asset.slices[0].mesh);
    const auto wider = encode_asset(asset);
    ASSERT_FALSE(wider);
    EXPECT_EQ(wider.error().code, ExitCode::kRefused);
  }
}

TEST(Asset, RefusesCoordinatesBeyondTheExactRange) {
  const auto far = encode_asset(make_asset(8, {1 << 25, 0}));
  ASSERT_FALSE(far);
  EXPECT_EQ(far.error().code, ExitCode::kRefused);
  Asset wrong = make_asset(8);
  wrong.slices[0].pslg.rings[0][0].x += 1;
  const auto mismatch = encode_asset(wrong);
  ASSERT_FALSE(mismatch);
  EXPECT_EQ(mismatch.error().code, ExitCode::kBug);
}

// assemble_asset() and decode_asset() have the same limit.
TEST(Asset, HasAtMostAHundredThousandEntries) {
  const auto assembled = [](int entries) {
    std::vector<EncodedSlice> slices(static_cast<std::size_t>(entries));
    for (int i = 0; i < entries; ++i) {
      EncodedSlice& slice = slices[static_cast<std::size_t>(i)];
      slice.index = i;
      slice.z_mm = 0.5 * i;
      slice.T_lps_plane.translation().z() = slice.z_mm;
      slice.measures_json = "{}";
    }
    Asset head;
    head.generator = "asset_test";
    return assemble_asset(head, std::move(slices));
  };
  const auto full = assembled(100'000);
  ASSERT_TRUE(full) << full.error().message;
  const auto out = test::take(decode_asset(*full, "full"));
  EXPECT_EQ(out.slices.size(), 100'000U);
  EXPECT_EQ(out.slices.back().z_mm, 0.5 * 99'999);
  const auto more = assembled(100'001);
  ASSERT_FALSE(more);
  EXPECT_EQ(more.error().code, ExitCode::kRefused);
  EXPECT_TRUE(more.error().message.starts_with("100001 meshes")) << more.error().message;
  EXPECT_EQ(more.error().message.find('\n'), std::string::npos);
}

TEST(Asset, ABinaryChunkThatIsLargerThanTheFileIsRefused) {
  const std::vector<std::uint8_t> glb = *encode_asset(make_asset(8));
  const std::size_t data = test::binary_at(glb), binary_bytes = glb.size() - data;
  for (const std::uint32_t more :
       {4U, 8U, 12U, static_cast<std::uint32_t>(0xfffffff0U - binary_bytes)}) {
    std::vector<std::uint8_t> bytes = glb;
    put_number(bytes, data - 8, binary_bytes + more);
    const auto out = decode_asset(bytes, "longer");
    ASSERT_FALSE(out) << more;
    EXPECT_EQ(out.error().message, "longer: broken binary chunk");
  }
}

// Draco allocates for the counts in its header; they are checked before.
TEST(Asset, ADracoHeaderWithTooLargeCountsIsRefused) {
  const SliceMesh mesh = jittered_grid(13, 7, 97, {0, 0}, 5);
  const DracoGrid grid{{8}, {0, 0}, 16};
  const std::vector<std::uint8_t> good = *encode_draco(mesh, grid);
  const std::uint64_t vertices = mesh.vertices.size(), triangles = mesh.triangles.size();
  ASSERT_TRUE(decode_draco(good, vertices, triangles));
  EXPECT_FALSE(decode_draco(good, vertices - 1, triangles));
  EXPECT_FALSE(decode_draco(good, vertices, triangles - 1));
  for (std::size_t at = 0; at < 11; ++at) {
    std::vector<std::uint8_t> bytes = good;
    bytes[at] ^= 1;
    EXPECT_FALSE(decode_draco(bytes, vertices, triangles)) << at;
  }
  // 112 vertices and 182 triangles, a varint of one byte and one of two, after twelve other bytes.
  ASSERT_EQ(good[12], vertices);
  ASSERT_EQ((good[13] & 0x7fU) | (good[14] << 7U), triangles);
  for (const std::uint32_t many : {20'000'000U, 1'430'000'000U, 0xffffffffU}) {
    std::vector<std::uint8_t> bytes(good.begin(), good.begin() + 13);
    for (std::uint32_t left = many; left > 0; left >>= 7)
      bytes.push_back(static_cast<std::uint8_t>(left > 0x7f ? (left & 0x7f) | 0x80 : left));
    bytes.insert(bytes.end(), good.begin() + 15, good.end());
    const auto out = decode_draco(bytes, vertices, many);
    ASSERT_FALSE(out);
    EXPECT_EQ(out.error().message, "Draco: more triangles than its bytes can hold") << many;
  }
  for (std::size_t size = 0; size < 20; ++size)
    EXPECT_FALSE(decode_draco({good.data(), size}, vertices, triangles)) << size;
}

// The mesh that Draco compresses best.
TEST(Asset, APerfectGridIsNotRefused) {
  const SliceMesh mesh = jittered_grid(500, 500, 1, {0, 0}, 5);  // cells too small for jitter
  const DracoGrid grid{{8}, {0, 0}, 16};
  const std::vector<std::uint8_t> bytes = *encode_draco(mesh, grid);
  EXPECT_GT(mesh.triangles.size(), 64 * bytes.size());
  const auto out = test::take(decode_draco(bytes, mesh.vertices.size(), mesh.triangles.size()));
  EXPECT_EQ(canonical(out.mesh), canonical(mesh));
}

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
