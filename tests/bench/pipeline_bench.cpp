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
#include <map>
#include <nlohmann/json.hpp>
#include <numeric>
#include <opencv2/imgcodecs.hpp>

#include "formats/asset/asset.h"
#include "formats/base/files.h"
#include "pipeline/bake/mesh_slice.h"
#include "pipeline/bake/mesh_stack.h"
#include "pipeline/contour/contour.h"
#include "pipeline/open/open_stack.h"
#include "pipeline/read/parallel_for.h"
#include "pipeline/read/volume_file.h"
#include "sample_ct/render.h"
#include "tests/bench/bench.h"
#include "tests/reference/phantom/cross_section.h"
#include "tests/support/memory_stack.h"

namespace trocar::pipeline::bench {
namespace {

using nlohmann::json;
using sample::CrossSection;
using sample::SectionDistance;
using sample::Vec2;
using trocar::bench::add;
using trocar::bench::check;
using trocar::bench::Counters;
using trocar::bench::Input;
using trocar::bench::quick;
using trocar::bench::short_text;
using trocar::bench::take;
using Bytes = std::vector<std::uint8_t>;

// ---- slices with their true outlines, and the distance of an outline from the true one ----

constexpr double kIso_HU = 226;

struct Truth {
  explicit Truth(sample::CrossSection truth) : section(std::move(truth)), distance(section) {}
  sample::CrossSection section;  ///< mm in the slice's plane
  sample::SectionDistance distance;
};

struct TrueScan {
  MemoryStack stack;  ///< in memory: times contain neither disk nor decoder
  std::vector<Truth> truths;
  double pixel_mm = 0;
  /// 1 by default. Moved to the middle of the widest gap between the areas of true rings of 0.9 to
  /// 1.1 mm^2: a ring that is dropped on one lattice and kept on another would change distances by
  /// centimetres.
  double min_region_mm2 = 1;
};

constexpr Lattice kFinest{kMaxLatticeBits};

CrossSection as_section(const Pslg& outline, const Lattice& lattice) {
  CrossSection out;
  out.area_mm2 =
      0.5 * static_cast<double>(doubled_area(outline)) * lattice.step_mm() * lattice.step_mm();
  for (const Ring& ring : outline.rings) {
    auto& points = out.rings.emplace_back();
    for (const LatticePoint p : ring)
      points.push_back({lattice.to_mm(p.x), lattice.to_mm(p.y)});
  }
  return out;
}

double ring_area_mm2(const std::vector<Vec2>& ring) {
  double doubled = 0;
  for (std::size_t i = 0; i < ring.size(); ++i)
    doubled += cross(ring[i], ring[(i + 1) % ring.size()]);
  return 0.5 * doubled;
}

/// Chooses min_region_mm2 and removes smaller rings from the true outlines.
void take_truths(std::vector<CrossSection> sections, TrueScan& scan) {
  std::vector<double> areas{0.9, 1.1};
  for (const CrossSection& section : sections) {
    for (const auto& ring : section.rings) {
      const double area = std::abs(ring_area_mm2(ring));
      if (area > 0.9 && area < 1.1) areas.push_back(area);
    }
  }
  std::sort(areas.begin(), areas.end());
  double widest = 0;
  for (std::size_t i = 1; i < areas.size(); ++i) {
    if (areas[i] - areas[i - 1] <= widest) continue;
    widest = areas[i] - areas[i - 1];
    scan.min_region_mm2 = 0.5 * (areas[i - 1] + areas[i]);
  }
  for (CrossSection& section : sections) {
    std::erase_if(section.rings, [&](const auto& ring) {
      const double area = ring_area_mm2(ring);
      if (std::abs(area) >= scan.min_region_mm2) return false;
      section.area_mm2 -= area;
      return true;
    });
    scan.truths.emplace_back(std::move(section));
  }
}

const CrossSection& phantom_truth(const sample::ScanGeometry& geometry, int slice) {
  static std::map<int, CrossSection> known;
  const auto found = known.find(slice);
  if (found != known.end()) return found->second;
  CrossSection section = take(
      sample::iso_section({}, geometry, sample::pixel_centre_mm(geometry, 0, 0, slice).z, kIso_HU));
  for (auto& ring : section.rings)
    for (Vec2& p : ring)
      p = p - Vec2{geometry.first_pixel_mm.x, geometry.first_pixel_mm.y};
  return known.emplace(slice, std::move(section)).first->second;
}

struct Directed {
  double sum_mm = 0, most_mm = 0;
  int samples = 0;

  void add(const CrossSection& from, const SectionDistance& to, double step_mm) {
    for (const std::vector<Vec2>& ring : from.rings) {
      double next = step_mm / 2;  // of arc length, from the current edge's start
      for (std::size_t i = 0; i < ring.size(); ++i) {
        const Vec2 a = ring[i], ab = ring[(i + 1) % ring.size()] - a;
        const double length = std::sqrt(dot(ab, ab));
        most_mm = std::max(most_mm, std::abs(to(a)));
        while (next < length) {
          const double d = std::abs(to(a + (next / length) * ab));
          sum_mm += d;
          most_mm = std::max(most_mm, d);
          ++samples;
          next += step_mm;
        }
        next -= length;
      }
    }
  }
  double mean_mm() const { return sum_mm / std::max(samples, 1); }
};

/// Slices of the sample's phantom, 512 x 512: unrounded without noise, whole HU with noise. True is
/// where a noiseless scanner reads the iso-value; about 1 s a slice, once per slice and process.
TrueScan phantom_scan(const std::vector<int>& slices, double noise_HU) {
  const sample::PhantomOptions phantom;
  const sample::ScanGeometry scan = *sample::sample_geometry(512, 35);
  TrueScan out;
  std::vector<CrossSection> sections;
  out.pixel_mm = scan.pixel_mm;
  for (const int k : slices) {
    sections.push_back(phantom_truth(scan, k));
    const std::vector<double> hu = sample::render_slice(phantom, scan, k);
    const std::vector<double> noise =
        noise_HU > 0 ? sample::noise_slice(scan, phantom.seed, noise_HU, k) : std::vector<double>();
    Image image{scan.columns, scan.rows, {}};
    for (std::size_t i = 0; i < hu.size(); ++i)
      image.values.push_back(
          static_cast<float>(noise.empty() ? hu[i] : std::rint(hu[i] + noise[i])));
    out.stack.images.push_back(std::move(image));
    SlicePlane plane;
    plane.spacing_u_mm = plane.spacing_v_mm = scan.pixel_mm;
    plane.z_mm = sample::pixel_centre_mm(scan, 0, 0, k).z;
    plane.T_lps_plane.translation() << scan.first_pixel_mm.x, scan.first_pixel_mm.y, plane.z_mm;
    out.stack.planes.push_back(plane);
  }
  take_truths(std::move(sections), out);
  return out;
}

/// Every `stride`-th slice of a scan. The sub-pixel contour at full resolution on the finest lattice
/// counts as true.
TrueScan file_scan(const std::filesystem::path& path, int stride) {
  const auto stack = take(open_stack({path}, {}));
  TrueScan out;
  std::vector<CrossSection> sections;
  for (int k = stride / 2; k < stack->size(); k += stride) {
    const SlicePlane& plane = stack->plane(k);
    out.pixel_mm = std::min(plane.spacing_u_mm, plane.spacing_v_mm);
    out.stack.images.push_back(take(stack->read(k)));
    out.stack.planes.push_back(plane);
    const Field field =
        segment(out.stack.images.back(), PixelUnit::kHounsfield, Threshold{kIso_HU});
    const PixelGrid grid{plane.spacing_u_mm, plane.spacing_v_mm, 0, 0, kFinest};
    sections.push_back(as_section(contours(field, grid, ContourKind::kSubpixel), kFinest));
  }
  if (sections.empty()) throw std::runtime_error(path.string() + ": has too few slices");
  take_truths(std::move(sections), out);
  return out;
}

struct OutlineErrors {
  double mean_mm = 0;       ///< mean of the two directed means
  double hausdorff_mm = 0;  ///< greater of the two directed maxima
  double area = 0;          ///< area / truth - 1 over all slices
};

/// Sampled eight times a pixel along both curves, and at all vertices. Slices with an outline on one
/// side only are left out.
OutlineErrors outline_errors(const std::vector<Pslg>& outlines, const Lattice& lattice,
                             const TrueScan& scan) {
  Directed from, to;
  double area_mm2 = 0, truth_mm2 = 0;
  for (std::size_t k = 0; k < outlines.size(); ++k) {
    const CrossSection section = as_section(outlines[k], lattice);
    const Truth& truth = scan.truths[k];
    if (section.rings.empty() || truth.section.rings.empty()) continue;
    from.add(section, truth.distance, scan.pixel_mm / 8);
    to.add(truth.section, SectionDistance(section), scan.pixel_mm / 8);
    area_mm2 += section.area_mm2;
    truth_mm2 += truth.section.area_mm2;
  }
  return {0.5 * (from.mean_mm() + to.mean_mm()), std::max(from.most_mm, to.most_mm),
          truth_mm2 > 0 ? area_mm2 / truth_mm2 - 1 : 0};
}

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
    const std::string full = "pipeline/" + name + "/" + method + "/" + short_text(value) + unit;
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
