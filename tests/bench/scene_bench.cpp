// SPDX-License-Identifier: Apache-2.0
// scene_bench NAME=ASSET...: loading a scene of some slices from assets of several sizes, made of
// the asset's slices: time, and bytes read and kept. They depend on the scene, not on the asset: at
// most kBound times those of the same slices in an asset of their own. Peer: reading the whole file.
// Replaces operator new, so not under sanitizers.
#include <malloc.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cstdlib>
#include <filesystem>
#include <new>
#include <nlohmann/json.hpp>

#include "formats/asset/asset.h"
#include "formats/base/files.h"
#include "formats/session/scene.h"
#include "runtime/haptics/membrane/sheet_law.h"
#include "runtime/haptics/sheet.h"
#include "runtime/haptics/tool.h"
#include "tests/bench/bench.h"

namespace {

// Bytes allocated by operator new and not yet freed.
std::atomic<std::int64_t> heap_now{0}, heap_most{0};

void* counted(void* block) {
  if (block == nullptr) throw std::bad_alloc();
  const auto bytes = static_cast<std::int64_t>(malloc_usable_size(block));
  const std::int64_t total = heap_now.fetch_add(bytes) + bytes;
  std::int64_t before = heap_most.load();
  while (total > before && !heap_most.compare_exchange_weak(before, total)) {
  }
  return block;
}
void release(void* block) noexcept {
  if (block == nullptr) return;
  heap_now.fetch_sub(static_cast<std::int64_t>(malloc_usable_size(block)));
  std::free(block);
}

}  // namespace

// The array and nothrow forms call these.
void* operator new(std::size_t size) {
  return counted(std::malloc(size));
}
void* operator new(std::size_t size, std::align_val_t align) {
  const auto step = static_cast<std::size_t>(align);
  return counted(std::aligned_alloc(step, (size + step - 1) / step * step));
}
void operator delete(void* block) noexcept {
  release(block);
}
void operator delete(void* block, std::size_t) noexcept {
  release(block);
}
void operator delete(void* block, std::align_val_t) noexcept {
  release(block);
}
void operator delete(void* block, std::size_t, std::align_val_t) noexcept {
  release(block);
}

namespace trocar::bench {
namespace {

using nlohmann::json;
namespace fs = std::filesystem;

constexpr double kBound = 1.3;

/// `count` slices with material, the middle one first, repeated as often as necessary.
Asset repeated(const Asset& source, int count) {
  std::vector<const AssetSlice*> material;
  for (const AssetSlice& slice : source.slices)
    if (!slice.mesh.triangles.empty()) material.push_back(&slice);
  if (material.empty()) throw std::runtime_error("no slice has material");
  Asset out = source;
  out.slices.clear();
  out.hu.planes.clear();
  for (int i = 0; i < count; ++i) {
    const auto at = static_cast<std::size_t>(i) + material.size() / 2;
    const AssetSlice& slice = *material[at % material.size()];
    out.slices.push_back(slice);
    out.slices.back().index = i;
    out.slices.back().z_mm = i;
    if (const HuPlane* plane = source.hu.find(slice.index)) {
      out.hu.planes.push_back(*plane);
      out.hu.planes.back().index = i;
    }
  }
  return out;
}

/// The middle of the slice's largest triangle.
std::array<double, 2> anchor_mm(const AssetSlice& slice, const Lattice& lattice) {
  const std::vector<LatticePoint>& v = slice.mesh.vertices;
  const Triangle& t = *std::max_element(
      slice.mesh.triangles.begin(), slice.mesh.triangles.end(), [&v](const auto& a, const auto& b) {
        return orient2d(v[a[0]], v[a[1]], v[a[2]]) < orient2d(v[b[0]], v[b[1]], v[b[2]]);
      });
  return {lattice.to_mm(std::int64_t{v[t[0]].x} + v[t[1]].x + v[t[2]].x) / 3,
          lattice.to_mm(std::int64_t{v[t[0]].y} + v[t[1]].y + v[t[2]].y) / 3};
}

struct Loaded {
  AssetPart part;
  std::vector<std::unique_ptr<const runtime::Sheet>> sheets;
};

/// A scene of consecutive slices of an asset on disk.
struct Case {
  std::string file;
  Scene scene;
  std::vector<int> wanted;

  Loaded load() const {
    AssetPart part = take(read_asset_part(scene.asset, wanted));
    auto sheets = take(runtime::place_slices(scene, part.asset, file));
    return {std::move(part), std::move(sheets)};
  }
};

Case make_case(const std::string& file, int first, int slices,
               const std::array<double, 2>& anchor) {
  json scene = {{"schema", "trocar.scene/1"},
                {"name", "scene_bench"},
                {"asset", file},
                {"duration_s", 1},
                {"placement", {{"anchor_mm", anchor}}},
                {"tissue", {{"stiffness_N_per_m", 5000}, {"threshold_N", 35}}},
                {"force_law", {{"kind", "network"}, {"reach_m", 0.005}}},
                {"hand", {{"trajectory", {{{"t_s", 0}, {"tip_m", {0, 0, 0.16}}}}}}},
                {"slices", json::array()}};
  Case out{file, {}, {}};
  for (int i = 0; i < slices; ++i) {
    scene["slices"].push_back({{"index", first + i}, {"z_m", 0.15 - 1e-3 * i}});
    out.wanted.push_back(first + i);
  }
  out.scene = take(parse_scene(scene.dump(), "scene_bench", "."));
  return out;
}

/// Free nodes of the network under the tool, one region for each slice.
double factored_nodes(const Case& c, const Loaded& loaded) {
  const std::vector<Tissue> tissues(loaded.sheets.size(), c.scene.tissue);
  auto prefetch = take(runtime::NetworkPrefetch::make(c.scene, tissues, loaded.part.asset.lattice));
  const runtime::Tool tool = runtime::make_tool(c.scene.tool);
  double sum = 0;
  for (std::size_t i = 0; i < loaded.sheets.size(); ++i) {
    const runtime::Sheet& sheet = *loaded.sheets[i];
    runtime::PrefetchRequest request;
    request.sheet = static_cast<std::int32_t>(i);
    request.middle_m = {sheet.transform.at_m.x(), sheet.transform.at_m.y()};
    runtime::Pose T_device_plate;
    T_device_plate.p_m << sheet.transform.at_m, sheet.z_m;
    T_device_plate.p_m -= tool.tip_plate_m;
    request.outline = runtime::outline_on_lattice(tool, T_device_plate, sheet.transform, sheet.z_m);
    if (prefetch->answer(request, sheet)) sum += prefetch->report().free_nodes_last;
  }
  return sum;
}

Counters figures(const Case& c) {
  Counters out;
  const std::int64_t before = heap_now;
  heap_most = before;
  Loaded loaded = c.load();
  out["peak_bytes"] = static_cast<double>(heap_most - before);
  out["file_bytes"] = static_cast<double>(loaded.part.file_bytes);
  out["read_bytes"] = static_cast<double>(loaded.part.read_bytes);
  double triangles = 0;
  for (const AssetSlice& slice : loaded.part.asset.slices)
    triangles += static_cast<double>(slice.mesh.triangles.size());
  out["decoded_triangles"] = triangles;
  out["factored_nodes"] = factored_nodes(c, loaded);
  loaded.part = AssetPart();  // as the session does
  out["kept_bytes"] = static_cast<double>(heap_now - before);
  return out;
}

void add_asset(const Input& input) {
  static const fs::path folder =
      fs::temp_directory_path() / ("scene_bench." + std::to_string(::getpid()));
  fs::create_directories(folder);
  std::atexit([] { fs::remove_all(folder); });
  const Asset source = take(read_asset(input.file));
  const auto period = static_cast<int>(
      std::count_if(source.slices.begin(), source.slices.end(),
                    [](const AssetSlice& slice) { return !slice.mesh.triangles.empty(); }));
  const std::string stage = "scene/" + input.name + "/";
  for (const int scene_slices : {1, 3, 35}) {
    Counters alone;
    for (const int asset_slices : {scene_slices, 35, 350}) {
      if (asset_slices == 35 && scene_slices == 35 && !alone.empty()) continue;
      const std::string file =
          (folder / (input.name + "_" + std::to_string(asset_slices) + ".glb")).string();
      const Asset asset = repeated(source, asset_slices);
      if (!fs::exists(file)) take(write_file_atomically(file, take(encode_asset(asset))));
      // The same content stands everywhere `period` further on: in the middle of a long asset.
      const int first = asset_slices / 2 / period * period;
      const auto c = std::make_shared<const Case>(
          make_case(file, first + scene_slices > asset_slices ? 0 : first, scene_slices,
                    anchor_mm(asset.slices.front(), asset.lattice)));
      Counters counters = figures(*c);
      if (alone.empty()) alone = counters;
      const std::string name = std::to_string(scene_slices) + "-of-" + std::to_string(asset_slices);
      for (const char* what : {"read_bytes", "peak_bytes", "kept_bytes"})
        check(counters.at(what) <= kBound * alone.at(what),
              std::string(name).append(": ").append(what));
      for (const char* what : {"decoded_triangles", "factored_nodes"})
        check(counters.at(what) == alone.at(what), std::string(name).append(": ").append(what));
      add(
          std::string(stage).append("trocar/").append(name), benchmark::kMicrosecond,
          [c] { benchmark::DoNotOptimize(c->load()); }, [counters] { return counters; });
      if (scene_slices > 1) continue;
      add(std::string(stage).append("peer-whole-file/").append(name), benchmark::kMicrosecond,
          [file] { benchmark::DoNotOptimize(read_asset(file)); });
    }
  }
}

void add_all(const std::vector<Input>& inputs) {
  for (const Input& input : inputs)
    add_asset(input);
}

}  // namespace
}  // namespace trocar::bench

int main(int argc, char** argv) {
  return trocar::bench::bench_main(argc, argv, trocar::bench::add_all);
}
