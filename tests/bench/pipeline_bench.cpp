// SPDX-License-Identifier: GPL-3.0-or-later
// pipeline_bench NAME=SCAN...: from pixels to the encoded mesh, speed against error over the
// parameters, on slices of the sample's phantom, whose true outline is known, and on scans, whose
// sub-pixel contour at full resolution counts as true; from files to an asset beside decoding,
// inflating and hashing the same bytes; and how time grows on slices of noise. One thread.
//
// An input whose name begins with "path-" is a scan to be timed from its files only. A folder of
// images takes spacing and window from the sample.json beside it.
#include <sodium.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <numeric>
#include <opencv2/imgcodecs.hpp>

#include "formats/asset/asset.h"
#include "formats/base/files.h"
#include "pipeline/bake/mesh_slice.h"
#include "pipeline/bake/mesh_stack.h"
#include "pipeline/open/open_stack.h"
#include "pipeline/read/parallel_for.h"
#include "pipeline/read/volume_file.h"
#include "tests/bench/bench.h"
#include "tests/bench/true_outlines.h"

namespace trocar::pipeline::bench {
namespace {

using nlohmann::json;
using trocar::bench::add;
using trocar::bench::check;
using trocar::bench::Counters;
using trocar::bench::Input;
using trocar::bench::quick;
using trocar::bench::take;
using Bytes = std::vector<std::uint8_t>;

// ---- speed against error ----

struct Meshed {
  std::vector<MeshedSlice> slices;
  Bytes glb;
  AssetSizes sizes;
};

Meshed mesh_and_encode(const TrueScan& scan, const MeshOptions& options) {
  Meshed out;
  Asset asset;
  asset.lattice = options.lattice;
  asset.generator = "pipeline_bench";
  for (int k = 0; k < scan.stack.size(); ++k) {
    MeshedSlice& slice = out.slices.emplace_back(take(mesh_slice(scan.stack, k, options)));
    const MeshedMaterial& only = slice.materials[0];
    const SlicePlane& plane = scan.stack.plane(k);
    asset.slices.push_back(
        {k, plane.z_mm, plane.T_lps_plane, only.outline.pslg(), only.refined.mesh, "{}", 0, {}});
  }
  out.glb = take(encode_asset(asset, &out.sizes));
  return out;
}

Counters errors_of(const std::string& name, const TrueScan& scan, const MeshOptions& options) {
  const Meshed meshed = mesh_and_encode(scan, options);
  std::vector<Pslg> outlines;
  double moved_mm = 0, unexplained = 0;
  for (const MeshedSlice& slice : meshed.slices) {
    const MeshedMaterial& only = slice.materials[0];
    outlines.push_back(only.outline.pslg());
    moved_mm = std::max(moved_mm, only.simplification_error_mm);
    unexplained += only.quality.below_unexplained;
  }
  // Steiner points may lie three lattice steps off.
  check(moved_mm <= options.simplification.tolerance_mm + 3 * options.lattice.step_mm(),
        name + ": simplification exceeds its tolerance");
  // Outlines that are not simplified have angles of the lattice's rounding.
  check(unexplained == 0 || options.simplification.tolerance_mm == 0 ||
            options.refinement.min_angle_deg > kSafeAngle_deg,
        name + ": triangles below the angle without a reason");
  const OutlineErrors errors = outline_errors(outlines, options.lattice, scan);
  const auto triangles = static_cast<double>(meshed.sizes.triangles);
  return {{"error_mean_mm", errors.mean_mm},
          {"error_hausdorff_mm", errors.hausdorff_mm},
          {"error_area_percent", 100 * errors.area},
          {"triangles", triangles / scan.stack.size()},
          {"below_unexplained", unexplained},
          {"bytes_per_triangle", static_cast<double>(meshed.glb.size()) / std::max(1.0, triangles)},
          {"slices", double(scan.stack.size())}};
}

void add_scan(const std::string& name, TrueScan made) {
  const auto scan = std::make_shared<const TrueScan>(std::move(made));
  MeshOptions defaults;
  defaults.segmentation = Threshold{kIso_HU};
  defaults.min_region_mm2 = scan->min_region_mm2;
  const auto at = [&](const std::string& method, double value, const std::string& unit,
                      const MeshOptions& options) {
    char setting[32];
    std::snprintf(setting, sizeof setting, "%g", value);
    const std::string full = "pipeline/" + name + "/" + method + "/" + setting + unit;
    add(
        full, benchmark::kMillisecond,
        [scan, options] { benchmark::DoNotOptimize(mesh_and_encode(*scan, options)); },
        [scan, options, full] { return errors_of(full, *scan, options); });
  };
  for (const double tolerance_mm : {0.0, 0.05, 0.1, 0.2, 0.5, 1.0}) {
    for (const ContourKind kind : {ContourKind::kSubpixel, ContourKind::kPixel}) {
      MeshOptions options = defaults;
      options.contour = kind;
      options.simplification.tolerance_mm = tolerance_mm;
      at(kind == ContourKind::kPixel ? "peer-pixel-chains" : "subpixel", tolerance_mm, "mm",
         options);
    }
  }
  for (const double angle_deg : {20.0, 25.0, 33.0}) {
    MeshOptions options = defaults;
    options.refinement.min_angle_deg = angle_deg;
    at("min-angle", angle_deg, "deg", options);
  }
  for (const int bits : {7, 10}) {
    MeshOptions options = defaults;
    options.lattice.bits = bits;
    at("lattice", bits, "bits", options);
  }
}

// ---- from files to an asset ----

/// Unpacks a .gz by ISA-L alone; the number of bytes.
std::uint64_t inflate(const Bytes& packed, Bytes& buffer) {
  inflate_state state;
  isal_inflate_init(&state);
  state.crc_flag = ISAL_GZIP;
  state.next_in = const_cast<std::uint8_t*>(packed.data());  // NOLINT: its API
  state.avail_in = static_cast<std::uint32_t>(packed.size());
  std::uint64_t out = 0;
  while (state.block_state != ISAL_BLOCK_FINISH) {
    state.next_out = buffer.data();
    state.avail_out = static_cast<std::uint32_t>(buffer.size());
    const std::uint32_t left = state.avail_in;
    if (inflate_on(state) != ISAL_DECOMP_OK) break;
    out += buffer.size() - state.avail_out;
    if (state.avail_in == left && state.avail_out == buffer.size()) break;
  }
  return out;
}

struct PathInput {
  std::filesystem::path path;
  OpenOptions open;
  double threshold = kIso_HU;
};

json mesh_from_files(const PathInput& input, int threads) {
  StackOptions options;
  options.start = std::chrono::steady_clock::now();
  options.mesh.segmentation = Threshold{input.threshold};
  options.threads = threads;
  options.input_key.assign(32, 1);
  const auto stack = take(open_stack({input.path}, input.open));
  StackResult made = take(mesh_stack(*stack, options, {}));
  take(verify_asset(take(decode_asset(made.glb, "the asset")), "the asset"));
  return std::move(made.report);
}

void add_path(const std::string& name, const std::filesystem::path& path) {
  PathInput input{path, {}, kIso_HU};
  input.open.unpack_behind = true;
  std::vector<std::string> pictures;
  if (const auto sample = path.parent_path() / "sample.json";
      path.filename() == "png" && std::filesystem::exists(sample)) {
    const json about = json::parse(take(read_file(sample)));
    const double low = about["png_window_HU"][0], high = about["png_window_HU"][1];
    input.open.spacing_mm = about["spacing_mm"].get<std::array<double, 3>>();
    input.threshold = (kIso_HU - low) / (high - low) * 255;
    for (const auto& entry : std::filesystem::directory_iterator(path))
      pictures.push_back(entry.path().string());
  }
  for (const int threads : {1, 2}) {
    add(
        "path/" + name + "/trocar" + (threads == 1 ? "" : "-2-threads"), benchmark::kMillisecond,
        [input, threads] { benchmark::DoNotOptimize(mesh_from_files(input, threads)); },
        [input, threads] {
          Counters out;
          const json report = mesh_from_files(input, threads);
          for (const auto& [stage, ms] : report["stages_ms"].items())
            out["ms_" + stage] = ms;
          return out;
        })
        ->UseRealTime();
  }
  const auto stack = take(open_stack({path}, input.open));
  const auto files = std::make_shared<std::vector<Bytes>>();
  for (const auto& file : stack->files)
    files->push_back(take(read_file(file)));
  add("path/" + name + "/peer-BLAKE2b", benchmark::kMillisecond, [files] {
    std::array<std::uint8_t, crypto_generichash_BYTES> hash{};
    for (const Bytes& file : *files)
      crypto_generichash(hash.data(), hash.size(), file.data(), file.size(), nullptr, 0);
    benchmark::DoNotOptimize(hash);
  })->UseRealTime();
  const std::size_t pixels = std::size_t{4} * stack->size() * stack->width() * stack->height();
  add("path/" + name + "/peer-memcpy-of-pixels", benchmark::kMillisecond,
      [from = Bytes(pixels, 1), to = Bytes(pixels)]() mutable {
        std::memcpy(to.data(), from.data(), from.size());
        benchmark::ClobberMemory();
      })
      ->UseRealTime();
  if (path.extension() == ".gz") {
    add("path/" + name + "/peer-inflate", benchmark::kMillisecond,
        [files, buffer = Bytes(1 << 20)]() mutable {
          for (const Bytes& file : *files)
            benchmark::DoNotOptimize(inflate(file, buffer));
        })
        ->UseRealTime();
  }
  if (!pictures.empty()) {
    add("path/" + name + "/peer-OpenCV-decode", benchmark::kMillisecond, [pictures] {
      for (const std::string& file : pictures)
        benchmark::DoNotOptimize(cv::imread(file, cv::IMREAD_UNCHANGED));
    })->UseRealTime();
  }
}

// ---- noise ----

/// A value of a pixel's place, -0.5 .. 0.5 (splitmix64).
float noise_at(std::uint64_t x, std::uint64_t y) {
  std::uint64_t z = ((y << 32U | x) + 1) * 0x9E3779B97F4A7C15U;
  z = (z ^ (z >> 30U)) * 0xBF58476D1CE4E5B9U;
  z = (z ^ (z >> 27U)) * 0x94D049BB133111EBU;
  return static_cast<float>((z ^ (z >> 31U)) >> 40U) * 0x1p-24F - 0.5F;
}

/// Outlines that fill the whole slice: the time of a vertex should not grow with the slice.
void add_noise(int size) {
  const auto scan = std::make_shared<TrueScan>();
  Image image{size, size, {}};
  for (int y = 0; y < size; ++y)
    for (int x = 0; x < size; ++x)
      image.values.push_back(static_cast<float>(
          std::rint(kIso_HU + 400 * double{noise_at(std::uint64_t(x), std::uint64_t(y))}) + 0.5));
  scan->stack.images.push_back(std::move(image));
  SlicePlane plane;
  plane.spacing_u_mm = plane.spacing_v_mm = 1;
  scan->stack.planes.push_back(plane);
  MeshOptions options;
  options.segmentation = Threshold{kIso_HU};
  add(
      "noise/white/trocar/" + std::to_string(size) + "px", benchmark::kMillisecond,
      [scan, options] { benchmark::DoNotOptimize(mesh_and_encode(*scan, options)); },
      [scan, options] {
        const Meshed meshed = mesh_and_encode(*scan, options);
        const auto& mesh = meshed.slices[0].materials[0].refined.mesh;
        return Counters{{"vertices", static_cast<double>(mesh.vertices.size())}};
      });
}

void add_all(const std::vector<Input>& inputs) {
  keep_freed_memory();
  cv::setNumThreads(1);
  if (sodium_init() < 0) throw std::runtime_error("libsodium does not initialise");
  const std::vector<int> slices = quick ? std::vector{17} : std::vector{2, 9, 17, 25, 32};
  add_scan("phantom", phantom_scan(slices, 0));
  add_scan("phantom-12HU", phantom_scan(slices, 12));
  for (const Input& input : inputs) {
    if (input.name.starts_with("path-")) {
      add_path(input.name.substr(5), input.file);
    } else {
      add_scan(input.name, file_scan(input.file, quick ? 20 : 5));
    }
  }
  add_noise(160);
  add_noise(960);
}

}  // namespace
}  // namespace trocar::pipeline::bench

int main(int argc, char** argv) {
  return trocar::bench::bench_main(argc, argv, trocar::pipeline::bench::add_all);
}
