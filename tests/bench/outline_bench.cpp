// SPDX-License-Identifier: GPL-3.0-or-later
// outline_bench [--repetitions=N] [--shells=N] [--no-cgal] [--in-a-row] [--rows]
// [NAME=SCAN[@FACTOR]]...: our triangulation and refinement, Triangle's (if it was built in) and
// CGAL's on each outline by itself, in turn, on one thread, with the options that trocar-mesh has by
// default. Each repetition goes through all outlines; with --in-a-row, all repetitions of one
// outline come before the next outline. FACTOR upsamples the slices in the plane. The shells are
// synthetic outlines like those of slices through the top of a skull. Prints, for each scan, the
// ratios of the medians of CPU time, the numbers of triangles and the errors of area. Fails if a
// mesh is not constrained Delaunay, if a triangle below 30 degrees lies in no small input angle, or
// if one of ours is too large.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <numbers>
#include <opencv2/imgproc.hpp>
#include <random>
#include <stdexcept>
#include <string>
#include <vector>

#include "formats/geometry/mesh_validity.h"
#include "pipeline/base/malloc_tuning.h"
#include "pipeline/contour/contour.h"
#include "pipeline/contour/simplification.h"
#include "pipeline/open/open_stack.h"
#include "pipeline/read/slice_stack.h"
#include "pipeline/triangulation/mesh_quality.h"
#include "pipeline/triangulation/refinement.h"
#include "pipeline/triangulation/triangulation.h"
#include "tests/bench/cgal_mesher.h"
#include "tests/bench/triangle_mesher.h"

namespace trocar::bench {
namespace {

using namespace trocar::pipeline;

constexpr Lattice kLattice{8};
constexpr double kBone_HU = 226, kMinRegion_mm2 = 1;

struct OutlineSet {
  std::string name;
  std::vector<Pslg> outlines;
};

RefinementOptions production_options() {
  RefinementOptions out;
  out.keep_area = true;
  out.max_distance_steps = std::min(kMaxDistanceFromOutline_steps,
                                    left_for_refinement_steps(kLattice, SimplificationOptions{}));
  return out;
}

Image upsampled(const Image& image, int factor) {
  if (factor == 1) return image;
  cv::Mat from(image.height, image.width, CV_32F), to;
  std::copy(image.values.begin(), image.values.end(), from.begin<float>());
  cv::resize(from, to, {}, factor, factor, cv::INTER_CUBIC);
  return {to.cols, to.rows, {to.begin<float>(), to.end<float>()}};
}

OutlineSet outlines_of(const std::string& name, const SliceStack& stack, int factor) {
  OutlineSet out{name, {}};
  for (int k = 0; k < stack.size(); ++k) {
    const SlicePlane& plane = stack.plane(k);
    const auto image = stack.read(k);
    if (!image) throw std::runtime_error(image.error().message);
    const PixelGrid grid{plane.spacing_u_mm / factor, plane.spacing_v_mm / factor, 0, 0, kLattice};
    const Field field = segment(upsampled(*image, factor), stack.pixel_unit(), Threshold{kBone_HU});
    const Pslg full =
        drop_small_rings(contours(field, grid, ContourKind::kSubpixel), kMinRegion_mm2, kLattice);
    Pslg simple = simplify(full, kLattice, SimplificationOptions{});
    if (!simple.rings.empty()) out.outlines.push_back(std::move(simple));
  }
  return out;
}

// Two nearly concentric irregular closed curves, with a wall of 0.5 to 3 mm between them and 50 to
// 600 vertices in all. Draws that cross themselves are drawn again.
Pslg thin_shell(std::mt19937& random) {
  const auto uniform = [&](double low, double high) {
    // The standard library's distributions differ between implementations.
    return low + (high - low) * (static_cast<double>(random()) / 4294967296.0);
  };
  while (true) {
    const double radius_mm = uniform(10, 80), wall_mm = uniform(0.5, 3);
    const auto n = static_cast<std::size_t>(std::exp(uniform(std::log(50), std::log(600)))) / 2;
    struct Wave {
      double amplitude, phase;
    };
    std::vector<Wave> shape, wall;
    for (int k = 2; k < 8; ++k) {
      shape.push_back({uniform(0, 0.15 / k), uniform(0, 2 * std::numbers::pi)});
      wall.push_back({uniform(0, 0.4 / k), uniform(0, 2 * std::numbers::pi)});
    }
    const auto sum = [](const std::vector<Wave>& waves, double angle) {
      double out = 1, k = 2;
      for (const Wave& w : waves)
        out += w.amplitude * std::cos(k * angle + w.phase), ++k;
      return out;
    };
    Pslg out;
    for (const bool is_inner : {false, true}) {
      Ring ring;
      for (std::size_t k = 0; k < n; ++k) {
        const double angle = 2 * std::numbers::pi * (static_cast<double>(k) + uniform(-0.4, 0.4)) /
                             static_cast<double>(n);
        const double r = radius_mm * sum(shape, angle) -
                         (is_inner ? wall_mm * sum(wall, angle) : 0) + uniform(-0.02, 0.02);
        ring.push_back({static_cast<std::int32_t>(std::lround(256 * r * std::cos(angle))),
                        static_cast<std::int32_t>(std::lround(256 * r * std::sin(angle)))});
      }
      if (is_inner) std::reverse(ring.begin(), ring.end());
      out.rings.push_back(std::move(ring));
    }
    if (check_pslg(out)) return out;
  }
}

double cpu_us() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return 1e6 * static_cast<double>(t.tv_sec) + 1e-3 * static_cast<double>(t.tv_nsec);
}

double quantile(std::vector<double> values, double fraction) {
  if (values.empty()) return std::nan("");
  std::sort(values.begin(), values.end());
  return values[static_cast<std::size_t>(
      std::lround(fraction * static_cast<double>(values.size() - 1)))];
}

// One outline, or the sums over several. The times are medians.
struct Row {
  std::size_t vertices = 0, ours = 0, triangle = 0, cgal = 0;  // triangles of the three
  double cdt_us = 0, ours_us = 0, triangle_cdt_us = 0, triangle_us = 0, cgal_us = 0;
  double area = 0, area_error = 0;  // doubled, in squared lattice steps
  std::size_t below = 0, below_triangle = 0;
  bool is_sound = true;
};

struct Arguments {
  int repetitions = 21, shells = 30;
  bool with_cgal = true, lists_rows = false, in_a_row = false;
};

// An outline, prepared for the three meshers, and the times of each repetition.
class TimedOutline {
 public:
  explicit TimedOutline(const Pslg& pslg)
      : pslg_(pslg), input_(prepare(pslg)), triangle_input_(input_) {}

  // Meshes the outline once with each of the meshers. Ours comes first in every other repetition,
  // because the first one loads the outline into the caches.
  void time_once(bool with_cgal) {
    const bool ours_first = ours_us_.size() % 2 == 0;
    if (ours_first) time_ours();
    const double start = cpu_us();
    triangle_ = triangle_mesh(triangle_input_, options_.min_angle_deg, area_steps2_);
    triangle_us_.push_back(cpu_us() - start);
    if (!ours_first) time_ours();
    if (!with_cgal) return;
    const double cgal_start = cpu_us();
    cgal_ = cgal_mesh(input_, options_.min_angle_deg, area_steps2_, false).triangles;
    cgal_us_.push_back(cpu_us() - cgal_start);
  }
  // Triangle's triangulation alone has its own repetitions: before the whole, it would warm the
  // caches for it.
  void time_triangulation_of_triangle() {
    if (!has_triangle()) return;
    (void)triangulate(pslg_);
    const double start = cpu_us();
    triangle_mesh(triangle_input_, 0, 0);
    triangle_cdt_us_.push_back(cpu_us() - start);
  }
  Row row();

 private:
  void time_ours() {
    const double start = cpu_us();
    const auto cdt = triangulate(pslg_);
    if (!cdt) throw std::runtime_error(cdt.error().message);
    cdt_us_.push_back(cpu_us() - start);
    const Refined refined = refine(*cdt, kLattice, options_);
    ours_ = refined.mesh.triangles.size();
    ours_us_.push_back(cpu_us() - start);
  }

  const Pslg& pslg_;
  RefinementOptions options_ = production_options();
  double area_steps2_ = std::ldexp(options_.max_area_mm2, 2 * kLattice.bits);
  CgalInput input_;
  TriangleInput triangle_input_;
  std::vector<double> cdt_us_, ours_us_, triangle_cdt_us_, triangle_us_, cgal_us_;
  std::size_t ours_ = 0, triangle_ = 0, cgal_ = 0;
};

// The medians of the times, and what the meshes are like.
Row TimedOutline::row() {
  Row out;
  out.ours = ours_, out.triangle = triangle_, out.cgal = cgal_;
  out.cdt_us = quantile(cdt_us_, 0.5);
  out.ours_us = quantile(ours_us_, 0.5);
  out.triangle_cdt_us = quantile(triangle_cdt_us_, 0.5);
  out.triangle_us = quantile(triangle_us_, 0.5);
  out.cgal_us = quantile(cgal_us_, 0.5);

  const Refined refined = refine(*triangulate(pslg_), kLattice, options_);
  const MeshQuality quality = measure_quality(refined, kLattice, options_.min_angle_deg);
  out.vertices = input_.points.size();
  out.area = static_cast<double>(doubled_area(pslg_));
  out.area_error = std::abs(static_cast<double>(doubled_area(refined.mesh) - doubled_area(pslg_)));
  out.below = quality.below_min_angle;
  out.is_sound = check_mesh(refined.mesh) && is_constrained_delaunay(refined.mesh) &&
                 quality.below_min_angle == quality.below_at_small_input_angle &&
                 quality.below_unexplained == 0 && refined.outcome == RefinementOutcome::kRefined &&
                 quality.max_area_mm2 <= options_.max_area_mm2;
  std::vector<double> corners;
  triangle_mesh(triangle_input_, options_.min_angle_deg, area_steps2_, &corners);
  const auto corner = [&](std::size_t k) { return std::pair{corners[k], corners[k + 1]}; };
  const double sine = std::sin(options_.min_angle_deg * std::numbers::pi / 180);
  for (std::size_t t = 0; t < corners.size(); t += 6) {
    const auto [ax, ay] = corner(t);
    const auto [bx, by] = corner(t + 2);
    const auto [cx, cy] = corner(t + 4);
    const double area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax);
    const double ab = std::hypot(bx - ax, by - ay), bc = std::hypot(cx - bx, cy - by),
                 ca = std::hypot(ax - cx, ay - cy);
    out.below_triangle += area / std::max({ab * bc, bc * ca, ca * ab}) < sine ? 1 : 0;
  }
  return out;
}

// Times all outlines. A repetition meshes each outline once, as trocar-mesh does. With in_a_row, the
// repetitions of an outline follow each other instead: a processor then learns every branch that a
// small outline takes, which saves Triangle more time than it saves us, since our code avoids
// branches that depend on the outline.
void time_all(std::vector<TimedOutline>& outlines, const Arguments& arguments) {
  const std::size_t n = outlines.size(),
                    total = n * static_cast<std::size_t>(arguments.repetitions);
  const auto repetitions = static_cast<std::size_t>(arguments.repetitions);
  const auto outline = [&](std::size_t k) -> TimedOutline& {
    return outlines[arguments.in_a_row ? k / repetitions : k % n];
  };
  for (std::size_t k = 0; k < total; ++k)
    outline(k).time_once(arguments.with_cgal);
  for (std::size_t k = 0; k < total; ++k)
    outline(k).time_triangulation_of_triangle();
}

// Medians, 95th percentiles and maxima of the ratios, and sums of the counts.
void print(const std::string& name, const std::vector<Row>& rows) {
  Row sum;
  std::vector<double> whole, cdt, refinement, cgal;
  double worst_area = 0;
  for (const Row& r : rows) {
    whole.push_back(r.ours_us / r.triangle_us);
    cdt.push_back(r.cdt_us / r.triangle_cdt_us);
    refinement.push_back((r.ours_us - r.cdt_us) / (r.triangle_us - r.triangle_cdt_us));
    cgal.push_back(r.ours_us / r.cgal_us);
    sum.ours_us += r.ours_us, sum.cdt_us += r.cdt_us, sum.triangle_us += r.triangle_us;
    sum.vertices += r.vertices, sum.ours += r.ours, sum.triangle += r.triangle, sum.cgal += r.cgal;
    sum.area += r.area, sum.area_error += r.area_error;
    sum.below += r.below, sum.below_triangle += r.below_triangle;
    worst_area = std::max(worst_area, r.area_error / r.area);
    sum.is_sound = sum.is_sound && r.is_sound;
  }
  std::printf("%-12s %5zu %8zu %7.2f %7.2f", name.c_str(), rows.size(), sum.vertices,
              1e-3 * sum.cdt_us, 1e-3 * sum.ours_us);
  if (has_triangle()) {
    std::printf(" | %5.3f %5.3f %5.3f (%5.3f) %6.3f %6.3f | %7zu %6.4f %4zu %4zu",
                quantile(whole, 0.5), quantile(whole, 0.95), quantile(whole, 1),
                sum.ours_us / sum.triangle_us, quantile(cdt, 0.5), quantile(refinement, 0.5),
                sum.ours, static_cast<double>(sum.ours) / static_cast<double>(sum.triangle),
                sum.below, sum.below_triangle);
  } else {
    std::printf(" | %7zu %4zu", sum.ours, sum.below);
  }
  if (sum.cgal > 0)
    std::printf(" | %5.3f %5.3f %6.4f", quantile(cgal, 0.5), quantile(cgal, 1),
                static_cast<double>(sum.ours) / static_cast<double>(sum.cgal));
  std::printf(" | %.2e %.2e%s\n", sum.area_error / sum.area, worst_area,
              sum.is_sound ? "" : " NOT SOUND");
}

int run(int argc, char** argv) {
  keep_freed_memory();  // or else Triangle would get fresh pages from the system for each outline
  Arguments arguments;
  std::vector<OutlineSet> sets;
  for (int i = 1; i < argc; ++i) {
    const std::string word = argv[i];
    const std::size_t equals = word.find('=');
    const std::string name = word.substr(0, equals);
    if (name == "--no-cgal") {
      arguments.with_cgal = false;
    } else if (name == "--in-a-row") {
      arguments.in_a_row = true;
    } else if (name == "--rows") {
      arguments.lists_rows = true;
    } else if (equals == std::string::npos) {
      throw std::runtime_error("NAME=SCAN or --OPTION=VALUE, not " + word);
    } else if (name == "--repetitions") {
      arguments.repetitions = std::stoi(word.substr(equals + 1));
    } else if (name == "--shells") {
      arguments.shells = std::stoi(word.substr(equals + 1));
    } else {
      const std::size_t at = word.rfind('@');
      const auto stack = open_stack({word.substr(equals + 1, at - equals - 1)}, {});
      if (!stack) throw std::runtime_error(stack.error().message);
      sets.push_back(
          outlines_of(name, **stack, at == std::string::npos ? 1 : std::stoi(word.substr(at + 1))));
    }
  }
  std::mt19937 random(33);
  OutlineSet shells{"shells", {}};
  for (int k = 0; k < arguments.shells; ++k)
    shells.outlines.push_back(thin_shell(random));
  sets.push_back(std::move(shells));

  std::printf("times of ours in ms: triangulation, whole%s%s; area error: of the sum, worst\n",
              has_triangle() ? " | of Triangle's time: median, 95 %, worst, (sum), triangulation "
                               "alone, refinement alone | triangles, of Triangle's, below 30 deg: "
                               "ours, Triangle's"
                             : " | triangles, below 30 deg",
              arguments.with_cgal ? " | of CGAL's time: median, worst; of its triangles" : "");
  std::vector<TimedOutline> outlines;
  for (const OutlineSet& set : sets) {
    for (const Pslg& pslg : set.outlines)
      outlines.emplace_back(pslg);
  }
  time_all(outlines, arguments);
  std::vector<Row> all;
  for (const OutlineSet& set : sets) {
    const std::size_t first = all.size();
    for (std::size_t k = 0; k < set.outlines.size(); ++k) {
      all.push_back(outlines[first + k].row());
      if (arguments.lists_rows) print(set.name + " " + std::to_string(k), {all.back()});
    }
    print(set.name, {all.begin() + static_cast<std::ptrdiff_t>(first), all.end()});
  }
  if (sets.size() > 1) print("all", all);
  return std::all_of(all.begin(), all.end(), [](const Row& r) { return r.is_sound; }) ? 0 : 1;
}

}  // namespace
}  // namespace trocar::bench

int main(int argc, char** argv) {
  try {
    return trocar::bench::run(argc, argv);
  } catch (const std::exception& e) {
    std::fprintf(stderr, "outline_bench: %s\n", e.what());
    return 3;
  }
}
