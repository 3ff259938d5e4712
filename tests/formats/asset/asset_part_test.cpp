// SPDX-License-Identifier: Apache-2.0
// Slices of an asset without the rest: the contract of formats/asset/asset_index.h, and that the
// bytes read depend on the requested slices only.
#include <gtest/gtest.h>

#include <cstring>
#include <filesystem>
#include <functional>
#include <nlohmann/json.hpp>
#include <random>

#include "formats/asset/asset.h"
#include "formats/asset/asset_index.h"
#include "formats/base/files.h"
#include "tests/support/glb_bytes.h"
#include "tests/support/take.h"
#include "tests/support/temporary_folder.h"

namespace trocar {
namespace {

using Bytes = std::vector<std::uint8_t>;
using test::same_slice;
using test::without_index;

// A disc of n corners, triangulated from its centre.
AssetSlice disc(int index, int corners) {
  AssetSlice slice;
  slice.index = index;
  slice.z_mm = 0.5 * index;
  slice.T_lps_plane = Eigen::Translation3d(-1, 2.5, slice.z_mm);
  slice.measures_json = nlohmann::json{{"mean_hu", 300 + index}}.dump();
  if (corners == 0) return slice;
  Ring ring;
  for (int i = 0; i < corners; ++i) {
    const double angle = 2 * 3.14159265358979 * i / corners;
    ring.push_back({static_cast<std::int32_t>(std::lrint(5000 * std::cos(angle) + index)),
                    static_cast<std::int32_t>(std::lrint(4000 * std::sin(angle)))});
  }
  slice.pslg.rings = {ring};
  slice.mesh.vertices = ring;
  slice.mesh.vertices.push_back({0, 0});
  const auto middle = static_cast<std::uint32_t>(corners);
  for (std::uint32_t i = 0; i < middle; ++i)
    slice.mesh.triangles.push_back({i, (i + 1) % middle, middle});
  return slice;
}

// Every fifth slice is empty. With `gap`, indices have a gap.
Asset discs(int slices, int first, bool gap = false) {
  Asset asset;
  asset.generator = "asset_part_test";
  asset.parameters_json = R"({"labels":[20,22]})";
  asset.input_key_digest = "0123";
  for (int i = 0; i < slices; ++i) {
    const int index = first + i + (gap && i > slices / 2 ? 1000 : 0);
    asset.slices.push_back(disc(index, i % 5 == 3 ? 0 : 40 + index % 7));
  }
  return asset;
}

IndexedFile file_index(const Bytes& glb) {
  MemorySource source(glb);
  return **find_index(source);
}

class AssetPartOf : public testing::TestWithParam<bool> {};

TEST_P(AssetPartOf, EqualsTheSlicesOfTheWhole) {
  const Bytes glb = *encode_asset(discs(60, -7, GetParam()));
  const auto whole = test::take(decode_asset(glb, "test"));
  for (const Bytes& file : {glb, without_index(glb)}) {
    for (const AssetSlice& slice : whole.slices) {
      const auto part = test::take(decode_asset_part(file, "test", {slice.index}));
      EXPECT_EQ(part.asset_slices, 60U);
      EXPECT_EQ(part.file_bytes, glb.size());
      EXPECT_EQ(part.asset.lattice, whole.lattice);
      EXPECT_EQ(part.asset.parameters_json, whole.parameters_json);
      EXPECT_EQ(part.asset.input_key_digest, whole.input_key_digest);
      ASSERT_EQ(part.asset.slices.size(), 1U);
      EXPECT_TRUE(same_slice(part.asset.slices[0], slice));
    }
    // The slices are in ascending order for any order and number of repetitions in the request.
    const auto some = test::take(decode_asset_part(file, "test", {3, -7, 3, 0}));
    ASSERT_EQ(some.asset.slices.size(), 3U);
    for (std::size_t i = 0; i < 3; ++i)
      EXPECT_EQ(some.asset.slices[i].index, (std::array{-7, 0, 3}[i]));
  }
}

INSTANTIATE_TEST_SUITE_P(Gap, AssetPartOf, testing::Bool());

TEST(AssetPart, RefusesASliceThatIsNotThere) {
  const Bytes glb = *encode_asset(discs(6, 20, true));
  for (const Bytes& file : {glb, without_index(glb)}) {
    for (const int index :
         {-1, 19, 500, 1026, std::numeric_limits<int>::min(), std::numeric_limits<int>::max()}) {
      const auto part = decode_asset_part(file, "test", {21, index});
      ASSERT_FALSE(part);
      EXPECT_EQ(part.error().code, ExitCode::kRefused);
      EXPECT_EQ(part.error().message, "test: slice " + std::to_string(index) +
                                          ": the asset has no such slice (it has 20 to 1025)");
    }
  }
  const Bytes none = *encode_asset(discs(0, 0));
  EXPECT_EQ(decode_asset_part(none, "test", {0}).error().message,
            "test: slice 0: the asset has no such slice (it has none)");
  EXPECT_TRUE(decode_asset_part(none, "test", {}));
}

// The same slices in assets of 1, 35 and 350: the bytes read are equal, except for the length of
// numbers in the JSON, the mean HU of the slices that share the node (four here, where every fifth
// is empty) and, with a gap, the steps of a bisection.
TEST(AssetPart, ReadsOnlyTheRequestedSlices) {
  const auto read = [](const Asset& asset, std::vector<int> indices) {
    const Bytes glb = *encode_asset(asset);
    const auto part = decode_asset_part(glb, "test", std::move(indices));
    EXPECT_TRUE(part);
    return part->read_bytes;
  };
  Asset one = discs(350, 100);
  one.slices = {one.slices[170]};
  const std::uint64_t alone = read(one, {270});
  constexpr std::uint64_t kNode = 4 * 6;
  EXPECT_LE(read(discs(35, 250), {270}), alone + 10 + kNode + 2 * sizeof(EntryRecord));
  EXPECT_LE(read(discs(350, 100), {270}), alone + 10 + kNode + 2 * sizeof(EntryRecord));
  EXPECT_LE(read(discs(350, 100, true), {270}), alone + 10 + kNode + (9 + 2) * sizeof(EntryRecord));
  std::vector<int> some;
  for (int i = 260; i < 280; ++i)
    some.push_back(i);
  EXPECT_NEAR(static_cast<double>(read(discs(350, 100), some)),
              static_cast<double>(read(discs(35, 250), some)), 20 * 4);
}

TEST(AssetPart, FromAFileEqualsFromMemory) {
  const test::TemporaryFolder folder;
  const std::filesystem::path file = folder / "a.glb";
  const Bytes glb = *encode_asset(discs(20, 5));
  ASSERT_TRUE(write_file_atomically(file, glb));
  const auto from_file = read_asset_part(file, {9});
  std::filesystem::remove(file);
  ASSERT_TRUE(from_file) << from_file.error().message;
  const auto from_memory = decode_asset_part(glb, "test", {9});
  EXPECT_TRUE(same_slice(from_file->asset.slices[0], from_memory->asset.slices[0]));
  EXPECT_EQ(from_file->read_bytes, from_memory->read_bytes);
  EXPECT_LT(from_file->read_bytes, glb.size() / 5);
  const auto absent = read_asset_part(file, {9});
  ASSERT_FALSE(absent);
  EXPECT_EQ(absent.error().code, ExitCode::kRefused);
  EXPECT_NE(absent.error().message.find(file.string()), std::string::npos);
}

// Contract 1: an index that does not state the file's own sizes counts as absent; the file is read
// whole.
TEST(AssetPart, AnIndexOfAnotherFileCountsAsAbsent) {
  const Bytes glb = *encode_asset(discs(8, 0));
  const IndexedFile file = file_index(glb);
  for (const std::size_t field :
       {offsetof(IndexHeader, magic), offsetof(IndexHeader, version),
        offsetof(IndexHeader, json_bytes), offsetof(IndexHeader, binary_bytes)}) {
    Bytes other = glb;
    other[file.binary_at + field] += 4;
    const auto part = test::take(decode_asset_part(other, "test", {2}));
    EXPECT_GE(part.read_bytes, glb.size());
    EXPECT_TRUE(decode_asset(other, "test"));
  }
}

// Contract 2: decode_asset() refuses an index that disagrees with the JSON, even with right
// checksums.
TEST(AssetPart, TheWholeIsRefusedWhereIndexAndJsonDiffer) {
  const Bytes glb = *encode_asset(discs(8, 0));
  const IndexedFile file = file_index(glb);
  const auto changed = [&](std::uint32_t place, const std::function<void(EntryRecord&)>& change) {
    Bytes bytes = glb;
    const std::size_t at = file.binary_at + sizeof(IndexHeader) + place * sizeof(EntryRecord);
    EntryRecord record;
    std::memcpy(&record, bytes.data() + at, sizeof record);
    change(record);
    std::memcpy(bytes.data() + at, &record, sizeof record);
    write_index_checksums(bytes);
    return bytes;
  };
  EXPECT_EQ(changed(1, [](EntryRecord&) {}), glb);
  EntryRecord fifth;
  changed(5, [&](EntryRecord& r) { fifth = r; });
  const std::vector<std::function<void(EntryRecord&)>> changes{
      [](EntryRecord& r) { r.index = 100; },
      [&](EntryRecord& r) { r.node_offset = fifth.node_offset; },
      [](EntryRecord& r) { --r.node_bytes; },
      [](EntryRecord& r) { r.node_bytes = 0xFFFF; },
      [](EntryRecord& r) { r.material = 1; },
      [&](EntryRecord& r) { r.draco_offset = fifth.draco_offset; },
      [](EntryRecord& r) { --r.draco_bytes; },
      [](EntryRecord& r) { r.draco_bytes = 0; },
      [&](EntryRecord& r) { r = fifth; },
      [](EntryRecord& r) { r.draco_offset = 0xFFFFFFF0; }};
  for (std::size_t i = 0; i < changes.size(); ++i) {
    const Bytes bytes = changed(1, changes[i]);
    const auto out = decode_asset(bytes, "test");
    ASSERT_FALSE(out) << "change " << i;
    EXPECT_EQ(out.error().code, ExitCode::kRefused);
    // Reading the slice alone gives a slice or a refusal.
    const auto part = decode_asset_part(bytes, "test", {1});
    EXPECT_TRUE(part || part.error().code == ExitCode::kRefused);
  }
  Bytes frame = glb;
  frame[file.binary_at + offsetof(IndexHeader, frame_bytes)] -= 1;
  write_index_checksums(frame);
  EXPECT_FALSE(decode_asset(frame, "test"));
  Bytes extras = glb;
  extras[file.binary_at + offsetof(IndexHeader, extras_bytes)] -= 1;
  write_index_checksums(extras);
  EXPECT_FALSE(decode_asset(extras, "test"));
}

// Otherwise a small file could make a reader decode one payload a hundred thousand times.
TEST(AssetPart, ASliceHasEachMaterialOnce) {
  Bytes glb = *encode_asset(discs(8, 0));
  const IndexedFile file = file_index(glb);
  const std::size_t first = file.binary_at + sizeof(IndexHeader) + sizeof(EntryRecord);
  for (std::size_t i = 1; i < 6; ++i)
    std::memcpy(glb.data() + first + i * sizeof(EntryRecord), glb.data() + first,
                sizeof(EntryRecord));
  write_index_checksums(glb);
  const auto part = decode_asset_part(glb, "test", {1});
  ASSERT_FALSE(part);
  EXPECT_EQ(part.error().message,
            "test: slice 1: the slice index has a material twice, or not in order");
}

// Contract 4: after a change of any byte, a part is refused or unchanged.
TEST(AssetPart, AChangedByteIsDetected) {
  const Bytes glb = *encode_asset(discs(3, 0));
  const auto whole = decode_asset(glb, "test");
  const IndexedFile file = file_index(glb);
  ASSERT_EQ(file.header.entries, 3U);
  std::mt19937_64 rng(3);
  int unchanged = 0;
  for (std::size_t at = 0; at < glb.size(); ++at) {
    Bytes bytes = glb;
    bytes[at] = static_cast<std::uint8_t>(bytes[at] ^ (1 + rng() % 255));
    for (const int index : {0, 1}) {
      const auto part = decode_asset_part(bytes, "test", {index});
      if (!part) {
        EXPECT_EQ(part.error().code, ExitCode::kRefused);
        EXPECT_EQ(part.error().message.find('\n'), std::string::npos);
        continue;
      }
      // Without an index the file is read whole, without checksums.
      if (part->read_bytes >= glb.size()) continue;
      ++unchanged;
      EXPECT_TRUE(same_slice(part->asset.slices[0], whole->slices[static_cast<std::size_t>(index)]))
          << "byte " << at;
      EXPECT_EQ(part->asset.lattice, whole->lattice);
      EXPECT_EQ(part->asset.parameters_json, whole->parameters_json);
    }
  }
  EXPECT_GT(unchanged, 500);
}

}  // namespace
}  // namespace trocar
