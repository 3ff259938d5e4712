// SPDX-License-Identifier: GPL-3.0-or-later
// mesher_bench [--list] [--out=ROWS.json] [NAME=]SCAN... [Google Benchmark's options]: our
// triangulation and refinement compared with CGAL's on the same outlines, in the same run, on one
// thread. Ends with a table of ratios, also as JSON for scripts/report; --list names every triangle
// below 30 degrees and the input angle in which it lies. Fails if one does not lie in an input
// angle below 60 degrees, or if an edge has negative stiffness.
#include <benchmark/benchmark.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <numbers>
#include <opencv2/imgproc.hpp>
#include <string>

#include "formats/geometry/mesh_validity.h"
#include "pipeline/contour/contour.h"
#include "pipeline/contour/simplification.h"
#include "pipeline/open/open_stack.h"
#include "pipeline/read/slice_stack.h"
#include "pipeline/triangulation/mesh_quality.h"
#include "pipeline/triangulation/refinement.h"
#include "pipeline/triangulation/triangulation.h"
#include "tests/bench/cgal_mesher.h"

namespace trocar::bench {
namespace {

using namespace trocar::pipeline;

constexpr Lattice kLattice{8};
constexpr double kBone_HU = 226;
constexpr double kMinAngle_deg = 30;
constexpr double kMinRegion_mm2 = 1;

// All slices of a scan, at one resolution and tolerance.
struct Outlines {
  std::string name;
  double pixel_mm2 = 1;
  double tolerance_mm = 0;
  std::vector<Pslg> full, simple;
  std::vector<CgalInput> for_cgal;
};

struct Case {
  const Outlines* outlines;
  std::string area;
  double max_area_mm2;  // 0: none

  std::string name() const { return outlines->name + "/" + area; }
  RefinementOptions options() const {
    RefinementOptions out;
    out.min_angle_deg = kMinAngle_deg;
    out.max_area_mm2 = max_area_mm2 > 0 ? max_area_mm2 : 1e12;
    return out;
  }
  std::optional<double> area_steps2() const {
    if (max_area_mm2 <= 0) return std::nullopt;
    return std::ldexp(max_area_mm2, 2 * kLattice.bits);
  }
};

Image upsampled(const Image& image, int factor) {
  if (factor == 1) return image;
  cv::Mat from(image.height, image.width, CV_32F), to;
  std::copy(image.values.begin(), image.values.end(), from.begin<float>());
  cv::resize(from, to, {}, factor, factor, cv::INTER_CUBIC);
  return {to.cols, to.rows, {to.begin<float>(), to.end<float>()}};
}

std::unique_ptr<Outlines> outlines_of(const std::string& name, const SliceStack& stack, int factor,
                                      double tolerance_mm) {
  auto out = std::make_unique<Outlines>();
  out->name = name;
  out->tolerance_mm = tolerance_mm;
  for (int k = 0; k < stack.size(); ++k) {
    const SlicePlane& plane = stack.plane(k);
    auto image = stack.read(k);
    if (!image) {
      std::fprintf(stderr, "mesher_bench: %s\n", image.error().message.c_str());
      std::exit(3);  // NOLINT(concurrency-mt-unsafe)
    }
    const PixelGrid grid{plane.spacing_u_mm / factor, plane.spacing_v_mm / factor, 0, 0, kLattice};
    out->pixel_mm2 = grid.spacing_u_mm * grid.spacing_v_mm;
    const Field field = segment(upsampled(*image, factor), stack.pixel_unit(), Threshold{kBone_HU});
    out->full.push_back(
        drop_small_rings(contours(field, grid, ContourKind::kSubpixel), kMinRegion_mm2, kLattice));
    out->simple.push_back(simplify(out->full.back(), kLattice,
                                   {tolerance_mm, SimplificationMethod::kDouglasPeucker}));
  }
  for (const Pslg& pslg : out->simple)
    out->for_cgal.push_back(prepare(pslg));
  return out;
}

Refined our_mesh(const Pslg& pslg, const RefinementOptions& options) {
  auto cdt = triangulate(pslg);
  if (!cdt) {
    std::fprintf(stderr, "mesher_bench: %s\n", cdt.error().message.c_str());
    std::exit(4);  // NOLINT(concurrency-mt-unsafe)
  }
  return refine(*cdt, kLattice, options);
}

// Google Benchmark's console output, which also keeps the medians of the repetitions.
class Medians : public benchmark::ConsoleReporter {
 public:
  void ReportRuns(const std::vector<Run>& runs) override {
    for (const Run& run : runs) {
      if (run.run_type == Run::RT_Iteration && run.iterations > 0) {
        times_[run.run_name.function_name].push_back(run.cpu_accumulated_time /
                                                     static_cast<double>(run.iterations) * 1e3);
      }
    }
    ConsoleReporter::ReportRuns(runs);
  }
  // NaN if the benchmark was not run.
  double ms(const std::string& name) const {
    const auto it = times_.find(name);
    if (it == times_.end()) return std::nan("");
    std::vector<double> sorted = it->second;
    std::sort(sorted.begin(), sorted.end());
    return sorted[sorted.size() / 2];
  }

 private:
  std::map<std::string, std::vector<double>> times_;
};

struct Counts {
  std::size_t triangles = 0, below = 0, at_small_angle = 0, negative_edges = 0;
  double max_area_mm2 = 0;
  bool is_refined = true;
};

// Lists every triangle below the angle if --list is given.
Counts count_ours(const Case& c, bool list) {
  Counts out;
  for (std::size_t k = 0; k < c.outlines->simple.size(); ++k) {
    const Refined refined = our_mesh(c.outlines->simple[k], c.options());
    const MeshQuality quality = measure_quality(refined, kLattice, kMinAngle_deg);
    out.triangles += refined.mesh.triangles.size();
    for (const SharpTriangle& t : quality.sharp) {
      if (!list) break;
      std::printf(
          "  %s slice %zu: triangle %u, %.3f deg, at the input angle of %.3f deg in (%d, %d)\n",
          c.name().c_str(), k, t.triangle, t.angle_deg, t.input_angle_deg, t.input_corner.x,
          t.input_corner.y);
    }
    out.below += quality.below_min_angle;
    out.at_small_angle += quality.below_at_small_input_angle;
    out.negative_edges += quality.negative_stiffness_edges;
    out.max_area_mm2 = std::max(out.max_area_mm2, quality.max_area_mm2);
    out.is_refined = out.is_refined && refined.outcome == RefinementOutcome::kRefined;
  }
  return out;
}

struct Row {
  double ours_ms = 0, cgal_ms = 0;
  Counts ours;
  CgalCounts cgal;

  double speedup() const { return cgal_ms / ours_ms; }
  double share() const {
    return static_cast<double>(ours.triangles) / static_cast<double>(cgal.triangles);
  }
  bool is_sound() const {
    return ours.below == ours.at_small_angle && ours.is_refined && ours.negative_edges == 0;
  }
};

Row measure(const Case& c, const Medians& medians, bool list) {
  Row row{medians.ms("ours/" + c.name()), medians.ms("cgal/" + c.name()), count_ours(c, list), {}};
  for (const auto& input : c.outlines->for_cgal) {
    const CgalCounts one = cgal_mesh(input, kMinAngle_deg, c.area_steps2(), true);
    row.cgal.triangles += one.triangles;
    row.cgal.below_angle += one.below_angle;
  }
  return row;
}

nlohmann::json describe(const Case& c, const Row& row) {
  return {{"id", c.name()},
          {"min_angle_deg", kMinAngle_deg},
          {"slices", c.outlines->simple.size()},
          {"triangles", row.ours.triangles},
          {"triangles_below_min_angle", row.ours.below},
          {"triangles_below_min_angle_at_small_input_angle", row.ours.at_small_angle},
          {"refine_ms", row.ours_ms},
          {"cgal_triangles", row.cgal.triangles},
          {"cgal_triangles_below_min_angle", row.cgal.below_angle},
          {"cgal_refine_ms", row.cgal_ms},
          {"cgal_over_ours_ratio", row.speedup()},
          {"triangles_over_cgal", row.share()}};
}

nlohmann::json describe(const Outlines& o, const Medians& medians) {
  std::size_t vertices = 0;
  for (const auto& pslg : o.simple) {
    for (const auto& ring : pslg.rings)
      vertices += ring.size();
  }
  const double ours_ms = medians.ms("cdt_ours/" + o.name),
               cgal_ms = medians.ms("cdt_cgal/" + o.name);
  return {{"id", o.name},
          {"slices", o.full.size()},
          {"vertices", vertices},
          {"simplify_ms", medians.ms("simplify/" + o.name)},
          {"triangulate_ms", ours_ms},
          {"cgal_triangulate_ms", cgal_ms},
          {"cgal_over_ours_ratio", cgal_ms / ours_ms}};
}

/// Registers all benchmarks. The arguments must outlive them.
void register_benchmarks(const std::vector<std::unique_ptr<Outlines>>& outlines,
                         const std::vector<Case>& cases) {
  for (const auto& o : outlines) {
    benchmark::RegisterBenchmark(("simplify/" + o->name).c_str(), [&o = *o](
                                                                      benchmark::State& state) {
      for (auto _ : state) {
        for (const auto& full : o.full)
          benchmark::DoNotOptimize(pipeline::simplify(
              full, kLattice, {o.tolerance_mm, pipeline::SimplificationMethod::kDouglasPeucker}));
      }
    })->Unit(benchmark::kMillisecond);
    benchmark::RegisterBenchmark(("cdt_ours/" + o->name).c_str(), [&o = *o](
                                                                      benchmark::State& state) {
      for (auto _ : state) {
        for (const auto& pslg : o.simple)
          benchmark::DoNotOptimize(pipeline::triangulate(pslg));
      }
    })->Unit(benchmark::kMillisecond);
    benchmark::RegisterBenchmark(("cdt_cgal/" + o->name).c_str(), [&o = *o](
                                                                      benchmark::State& state) {
      for (auto _ : state) {
        for (const auto& input : o.for_cgal)
          benchmark::DoNotOptimize(cgal_triangulate(input));
      }
    })->Unit(benchmark::kMillisecond);
  }
  for (const Case& c : cases) {
    benchmark::RegisterBenchmark(("ours/" + c.name()).c_str(), [&c](benchmark::State& state) {
      for (auto _ : state) {
        for (const auto& pslg : c.outlines->simple)
          benchmark::DoNotOptimize(our_mesh(pslg, c.options()));
      }
    })->Unit(benchmark::kMillisecond);
    benchmark::RegisterBenchmark(("cgal/" + c.name()).c_str(), [&c](benchmark::State& state) {
      for (auto _ : state) {
        for (const auto& input : c.outlines->for_cgal)
          benchmark::DoNotOptimize(cgal_mesh(input, kMinAngle_deg, c.area_steps2(), false));
      }
    })->Unit(benchmark::kMillisecond);
  }
}

}  // namespace
}  // namespace trocar::bench

int main(int argc, char** argv) {
  using namespace trocar::bench;
  benchmark::Initialize(&argc, argv);
  std::vector<std::unique_ptr<Outlines>> outlines;
  bool list = false;
  std::string out;
  for (int i = 1; i < argc; ++i) {
    const std::string word = argv[i];
    if (word == "--list") {
      list = true;
      continue;
    }
    if (word.starts_with("--out=")) {
      out = word.substr(6);
      continue;
    }
    const std::size_t equals = word.find('=');
    const std::string file = equals == std::string::npos ? word : word.substr(equals + 1);
    const auto stack = open_stack({file}, {});
    if (!stack) {
      std::fprintf(stderr, "mesher_bench: %s\n", stack.error().message.c_str());
      return 3;
    }
    const std::string scan = equals == std::string::npos
                                 ? std::filesystem::path(file).filename().string().substr(0, 4)
                                 : word.substr(0, equals);
    const double pixel = (*stack)->plane(0).spacing_u_mm;
    outlines.push_back(outlines_of(scan + "/x1/0.25mm", **stack, 1, 0.25));
    outlines.push_back(outlines_of(scan + "/x4/0.25mm", **stack, 4, 0.25));
    outlines.push_back(outlines_of(scan + "/x4/0.25px", **stack, 4, 0.25 * pixel / 4));
  }
  std::vector<Case> cases;
  for (const auto& o : outlines) {
    cases.push_back({o.get(), "50mm2", 50});
    cases.push_back({o.get(), "200px2", 200 * o->pixel_mm2});
    cases.push_back({o.get(), "none", 0});
  }
  register_benchmarks(outlines, cases);
  Medians medians;
  benchmark::RunSpecifiedBenchmarks(&medians);

  std::printf("\n%-26s %8s %8s %6s | %8s %8s %6s | %s\n", "outlines/area bound", "ours ms",
              "CGAL ms", "ratio", "ours tri", "CGAL tri", "share",
              "ours < 30 deg (at input < 60), CGAL < 30 deg; ours of negative stiffness");
  bool sound = true;
  nlohmann::json rows = nlohmann::json::array(), sets = nlohmann::json::array();
  for (const Case& c : cases) {
    if (std::isnan(medians.ms("ours/" + c.name())) && !list) continue;
    const Row row = measure(c, medians, list);
    sound = sound && row.is_sound();
    rows.push_back(describe(c, row));
    std::printf("%-26s %8.1f %8.1f %6.2f | %8zu %8zu %6.3f | %zu (%zu), %zu; %zu%s\n",
                c.name().c_str(), row.ours_ms, row.cgal_ms, row.speedup(), row.ours.triangles,
                row.cgal.triangles, row.share(), row.ours.below, row.ours.at_small_angle,
                row.cgal.below_angle, row.ours.negative_edges,
                row.ours.is_refined ? "" : " NOT FULLY REFINED");
  }
  for (const auto& o : outlines) {
    const nlohmann::json set = describe(*o, medians);
    sets.push_back(set);
    std::printf(
        "%-16s %zu slices, %zu vertices: simplify %.3f ms a slice; CDT ours %.1f ms, CGAL %.1f "
        "ms\n",
        o->name.c_str(), o->full.size(), set["vertices"].get<std::size_t>(),
        set["simplify_ms"].get<double>() / static_cast<double>(o->full.size()),
        set["triangulate_ms"].get<double>(), set["cgal_triangulate_ms"].get<double>());
  }
  if (!out.empty())
    std::ofstream(out) << nlohmann::json{{"rows", rows}, {"outlines", sets}}.dump(1) << '\n';
  return sound ? 0 : 1;
}
