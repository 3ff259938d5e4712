// SPDX-License-Identifier: Apache-2.0
// Measures what a session reads and keeps of an asset: scenes of several sizes on assets of several
// sizes, with the same slices where the scene names them. In: a plan as JSON on stdin; out: JSON.
// Times are medians of interleaved runs with the files in the page cache; ratios are of CPU time.
//
// Plan: {"assets": [{"name", "path"}, ..], "asset_slices": [..], "scene_slices": [..],
//        "repetitions": n, "folder": "for assets"}
// Each asset is cut or repeated to the requested sizes and to the size of the scene; the ratios
// refer to the latter.
#include <algorithm>
#include <array>
#include <chrono>
#include <cstdio>
#include <ctime>
#include <filesystem>
#include <functional>
#include <nlohmann/json.hpp>
#include <numeric>
#include <random>
#include <string>

#include "formats/asset/asset.h"
#include "formats/base/file_io.h"
#include "formats/session/scene.h"
#include "runtime/contact/sheet.h"
#include "runtime/contact/tool.h"
#include "runtime/force_law/network_prefetch.h"
#include "tests/bench/heap_meter.h"
#include "tests/bench/sweep_main.h"

namespace trocar::test {
namespace {

using nlohmann::json;
namespace fs = std::filesystem;

/// CPU time of this thread, which waits for nothing.
double cpu_ms_of(const std::function<void()>& work) {
  const auto now = [] {
    timespec time{};
    ::clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
    return static_cast<double>(time.tv_sec) * 1e3 + static_cast<double>(time.tv_nsec) * 1e-6;
  };
  const double start = now();
  work();
  return now() - start;
}

double ms_of(const std::function<void()>& work) {
  const auto start = std::chrono::steady_clock::now();
  work();
  return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start)
      .count();
}

double median(std::vector<double> values) {
  std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2),
                   values.end());
  return values[values.size() / 2];
}

/// `count` slices with material, the middle one first, repeated as often as necessary.
Asset repeated(const Asset& source, std::size_t count) {
  std::vector<const AssetSlice*> material;
  for (const AssetSlice& slice : source.slices)
    if (!slice.mesh.triangles.empty()) material.push_back(&slice);
  Asset out = source;
  out.slices.clear();
  out.hu.planes.clear();
  for (std::size_t i = 0; i < count; ++i) {
    const AssetSlice& slice = *material[(i + material.size() / 2) % material.size()];
    out.slices.push_back(slice);
    out.slices.back().index = static_cast<int>(i);
    out.slices.back().z_mm = static_cast<double>(i);
    if (const HuPlane* plane = source.hu.find(slice.index)) {
      out.hu.planes.push_back(*plane);
      out.hu.planes.back().index = static_cast<int>(i);
    }
  }
  return out;
}

/// An asset on disk and a scene of some of its slices.
struct Case {
  std::string file;
  std::size_t asset_slices = 0, scene_slices = 0;
  Scene scene;
  std::vector<int> wanted;
  std::vector<double> read_ms, load_ms, load_cpu_ms;
};

/// A point over material: the middle of the slice's largest triangle.
std::array<double, 2> anchor_mm(const AssetSlice& slice, const Lattice& lattice) {
  const std::vector<LatticePoint>& v = slice.mesh.vertices;
  const Triangle& t = *std::max_element(
      slice.mesh.triangles.begin(), slice.mesh.triangles.end(), [&v](const auto& a, const auto& b) {
        return orient2d(v[a[0]], v[a[1]], v[a[2]]) < orient2d(v[b[0]], v[b[1]], v[b[2]]);
      });
  return {lattice.to_mm(std::int64_t{v[t[0]].x} + v[t[1]].x + v[t[2]].x) / 3,
          lattice.to_mm(std::int64_t{v[t[0]].y} + v[t[1]].y + v[t[2]].y) / 3};
}

Result<Scene> make_scene(const std::string& file, int first, std::size_t slices,
                         const std::array<double, 2>& anchor) {
  json scene = {{"schema", "trocar.scene/1"},
                {"name", "scene_sweep"},
                {"asset", file},
                {"duration_s", 1},
                {"placement", {{"anchor_mm", anchor}}},
                {"tissue", {{"stiffness_N_per_m", 5000}, {"threshold_N", 35}}},
                {"force_law", {{"kind", "network"}, {"reach_m", 0.005}}},
                {"hand", {{"trajectory", {{{"t_s", 0}, {"tip_m", {0, 0, 0.16}}}}}}},
                {"slices", json::array()}};
  for (std::size_t i = 0; i < slices; ++i) {
    scene["slices"].push_back(
        {{"index", first + static_cast<int>(i)}, {"z_m", 0.15 - 1e-3 * static_cast<double>(i)}});
  }
  return parse_scene(scene.dump(), "scene_sweep", ".");
}

struct Loaded {
  AssetPart part;
  std::vector<std::unique_ptr<const runtime::Sheet>> sheets;
};

Result<Loaded> load(const Case& c) {
  auto part = read_asset_part(c.scene.asset, c.wanted);
  if (!part) return part.error();
  auto sheets = runtime::place_slices(c.scene, part->asset, c.file);
  if (!sheets) return sheets.error();
  return Loaded{std::move(*part), std::move(*sheets)};
}

/// Free nodes in the network's responses under the tool, one response for each slice.
Result<std::uint64_t> factored_nodes(const Case& c, const Loaded& loaded) {
  std::vector<Tissue> tissues(loaded.sheets.size(), c.scene.tissue);
  auto prefetch = runtime::NetworkPrefetch::make(c.scene, tissues, loaded.part.asset.lattice);
  if (!prefetch) return prefetch.error();
  const runtime::Tool tool = runtime::make_tool(c.scene.tool);
  std::uint64_t sum = 0;
  for (std::size_t i = 0; i < loaded.sheets.size(); ++i) {
    const runtime::Sheet& sheet = *loaded.sheets[i];
    runtime::PrefetchRequest request;
    request.sheet = static_cast<std::int32_t>(i);
    request.middle_m = {sheet.transform.at_m.x(), sheet.transform.at_m.y()};
    runtime::Pose T_device_plate;
    T_device_plate.p_m << sheet.transform.at_m, sheet.z_m;
    T_device_plate.p_m -= tool.tip_plate_m;
    request.outline = runtime::outline_on_lattice(tool, T_device_plate, sheet.transform, sheet.z_m);
    if ((*prefetch)->answer(request, sheet)) sum += (*prefetch)->report().free_nodes_last;
  }
  return sum;
}

std::uint64_t triangles_of(const Asset& asset) {
  std::uint64_t sum = 0;
  for (const AssetSlice& slice : asset.slices)
    sum += slice.mesh.triangles.size();
  return sum;
}

/// The figures that do not depend on the machine's speed.
Result<json> count(const Case& c) {
  const std::int64_t before = heap_bytes().now;
  reset_heap_peak();
  auto loaded = load(c);
  if (!loaded) return loaded.error();
  const std::int64_t peak = heap_bytes().most - before;
  json row = {{"asset_slices", c.asset_slices},
              {"scene_slices", c.scene_slices},
              {"file_bytes", loaded->part.file_bytes},
              {"read_bytes", loaded->part.read_bytes},
              {"decoded_triangles", triangles_of(loaded->part.asset)},
              {"load_peak_bytes", peak}};
  const auto nodes = factored_nodes(c, *loaded);
  if (!nodes) return nodes.error();
  row["factored_nodes"] = *nodes;
  loaded->part = AssetPart();  // as the session does
  row["kept_bytes"] = heap_bytes().now - before;
  reset_heap_peak();
  const std::int64_t between = heap_bytes().now;
  (void)read_asset_part(c.scene.asset, c.wanted);
  row["read_peak_bytes"] = heap_bytes().most - between;
  return row;
}

/// Loads the scenes of one size in turn, in another order each time. A load changes
/// caches and heap for the next one; the random order averages this.
Result<void> measure_times(std::vector<Case>& cases, int repetitions) {
  std::mt19937_64 random(1);
  for (std::size_t begin = 0, end = 0; begin < cases.size(); begin = end) {
    while (end < cases.size() && cases[end].scene_slices == cases[begin].scene_slices)
      ++end;
    std::vector<std::size_t> order(end - begin);
    std::iota(order.begin(), order.end(), begin);
    for (int i = 0; i <= repetitions; ++i) {
      for (std::size_t k = order.size() - 1; k > 0; --k)
        std::swap(order[k], order[random() % (k + 1)]);
      for (const std::size_t k : order) {
        Case& c = cases[k];
        Result<Loaded> loaded = bug("not loaded");
        const double read_ms = ms_of([&c] { (void)read_asset_part(c.scene.asset, c.wanted); });
        double load_cpu_ms = 0;
        const double load_ms = ms_of([&] { load_cpu_ms = cpu_ms_of([&] { loaded = load(c); }); });
        if (!loaded) return loaded.error();
        if (i == 0) continue;  // a first round to warm up
        c.read_ms.push_back(read_ms);
        c.load_ms.push_back(load_ms);
        c.load_cpu_ms.push_back(load_cpu_ms);
      }
    }
  }
  return {};
}

Result<json> sweep(const json& plan, const std::string& name, const fs::path& path) {
  const auto source = read_asset(path);
  if (!source) return source.error();
  if (triangles_of(*source) == 0) return refused(path.string() + ": no slice has material");
  std::size_t period = 0;  // of the slices in a repeated asset
  for (const AssetSlice& slice : source->slices)
    period += slice.mesh.triangles.empty() ? 0 : 1;

  const fs::path folder = plan.at("folder").get<std::string>();
  std::vector<std::string> files;
  std::vector<Case> cases;
  std::array<double, 2> anchor{};  // the same in all: they begin with the same slice
  for (const std::size_t scene_slices : plan.at("scene_slices").get<std::vector<std::size_t>>()) {
    std::vector<std::size_t> sizes = plan.at("asset_slices").get<std::vector<std::size_t>>();
    sizes.erase(std::remove(sizes.begin(), sizes.end(), scene_slices), sizes.end());
    sizes.insert(sizes.begin(), scene_slices);  // its slices alone
    for (const std::size_t size : sizes) {
      Case c;
      c.asset_slices = size;
      c.scene_slices = scene_slices;
      // The same content stands everywhere `period` further on: in the middle of a long asset.
      const std::size_t first = size / 2 / period * period;
      if (first + scene_slices > size) return usage("a scene of more slices than its asset");
      c.file = (folder / (name + "_" + std::to_string(size) + ".glb")).string();
      if (std::find(files.begin(), files.end(), c.file) == files.end()) {
        const Asset asset = repeated(*source, size);
        anchor = anchor_mm(asset.slices.front(), asset.lattice);
        const auto glb = encode_asset(asset);
        if (!glb) return glb.error();
        if (auto ok = write_file_atomically(c.file, *glb); !ok) return ok.error();
        files.push_back(c.file);
      }
      auto scene = make_scene(c.file, static_cast<int>(first), scene_slices, anchor);
      if (!scene) return scene.error();
      c.scene = std::move(*scene);
      for (const SceneSlice& slice : c.scene.slices)
        c.wanted.push_back(slice.index);
      cases.push_back(std::move(c));
    }
  }

  json rows = json::array();
  for (const Case& c : cases) {
    auto row = count(c);
    if (!row) return row.error();
    (*row)["scan"] = name;
    (*row)["id"] =
        name + "/" + std::to_string(c.scene_slices) + " of " + std::to_string(c.asset_slices);
    rows.push_back(std::move(*row));
  }
  if (auto ok = measure_times(cases, plan.at("repetitions")); !ok) return ok.error();
  for (std::size_t i = 0; i < cases.size(); ++i) {
    rows[i]["read_ms"] = median(cases[i].read_ms);
    rows[i]["load_ms"] = median(cases[i].load_ms);
    rows[i]["load_cpu_ms"] = median(cases[i].load_cpu_ms);
    std::size_t alone = i;  // that comes before the others
    while (cases[alone].scene_slices != cases[alone].asset_slices)
      --alone;
    const auto ratio = [&](const char* what) {
      return rows[i][what].get<double>() / rows[alone][what].get<double>();
    };
    rows[i]["load_time_ratio"] = ratio("load_cpu_ms");
    rows[i]["read_bytes_relative"] = ratio("read_bytes");
    rows[i]["read_peak_bytes_relative"] = ratio("read_peak_bytes");
    rows[i]["load_peak_bytes_relative"] = ratio("load_peak_bytes");
    rows[i]["kept_bytes_relative"] = ratio("kept_bytes");
  }
  // Reads the complete file, as other readers do.
  json whole = json::array();
  for (const std::string& file : files) {
    std::vector<double> ms;
    reset_heap_peak();
    const std::int64_t before = heap_bytes().now;
    std::size_t slices = 0;
    for (int i = 0; i < std::min(5, plan.at("repetitions").get<int>()); ++i)
      ms.push_back(ms_of([&] { slices = read_asset(file)->slices.size(); }));
    whole.push_back({{"id", name + "/whole of " + std::to_string(slices)},
                     {"scan", name},
                     {"asset_slices", slices},
                     {"read_ms", median(ms)},
                     {"read_bytes", fs::file_size(file)},
                     {"read_peak_bytes", heap_bytes().most - before}});
  }
  for (const std::string& file : files)
    fs::remove(file);
  return json{{"rows", rows}, {"whole", whole}};
}

Result<json> run(const json& plan) {
  if (plan.at("repetitions").get<int>() < 1) return usage("repetitions must be >= 1");
  json out = {{"rows", json::array()}, {"whole", json::array()}};
  for (const json& asset : plan.at("assets")) {
    const auto part = sweep(plan, asset.at("name"), asset.at("path").get<std::string>());
    if (!part) return part.error();
    for (const char* key : {"rows", "whole"})
      out[key].insert(out[key].end(), (*part)[key].begin(), (*part)[key].end());
  }
  return out;
}

}  // namespace
}  // namespace trocar::test

int main() {
  return trocar::test::sweep_main("scene_sweep", trocar::test::run);
}
