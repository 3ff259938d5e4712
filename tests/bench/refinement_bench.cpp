// SPDX-License-Identifier: GPL-3.0-or-later
// refinement_bench NAME=SCAN...: triangulation and refinement of all slices of the scans, native
// and upsampled 4 x, with several area bounds, on one thread. It answers requests, so that two
// builds of it can take turns (refinement_ratios.py): each line of standard input is "list", "time
// CASE", "check CASE" or "check CASE ANGLE"; each answer is one line of JSON.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>
#include <opencv2/imgproc.hpp>
#include <string>
#include <vector>

#include "formats/geometry/mesh_validity.h"
#include "pipeline/contour/contour.h"
#include "pipeline/contour/simplification.h"
#include "pipeline/open/open_stack.h"
#include "pipeline/read/slice_stack.h"
#include "pipeline/triangulation/mesh_quality.h"
#include "pipeline/triangulation/refinement.h"
#include "pipeline/triangulation/triangulation.h"

namespace trocar::bench {
namespace {

using namespace trocar::pipeline;
using nlohmann::json;

constexpr Lattice kLattice{8};
constexpr double kBone_HU = 226, kMinRegion_mm2 = 1, kMinAngle_deg = 30;

struct Case {
  std::string name;
  std::shared_ptr<const std::vector<Pslg>> outlines;
  RefinementOptions options;
};

double cpu_ms() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return 1e3 * static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_nsec);
}

Image upsampled(const Image& image, int factor) {
  if (factor == 1) return image;
  const cv::Mat from(image.height, image.width, CV_32F,
                     const_cast<float*>(image.values.data()));  // NOLINT: cv::Mat has no const data
  cv::Mat to;
  cv::resize(from, to, {}, factor, factor, cv::INTER_CUBIC);
  return {to.cols, to.rows, {to.begin<float>(), to.end<float>()}};
}

// The outlines at one resolution, each with its own tolerance.
struct Simplified {
  std::shared_ptr<std::vector<Pslg>> peucker = std::make_shared<std::vector<Pslg>>(),
                                     peucker_quarter_pixel = std::make_shared<std::vector<Pslg>>(),
                                     area = std::make_shared<std::vector<Pslg>>();
  double pixel_mm2 = 1;
};

Simplified simplified(const SliceStack& stack, int factor) {
  Simplified out;
  for (int k = 0; k < stack.size(); ++k) {
    const SlicePlane& plane = stack.plane(k);
    const auto image = stack.read(k);
    if (!image) throw std::runtime_error(image.error().message);
    const PixelGrid grid{plane.spacing_u_mm / factor, plane.spacing_v_mm / factor, 0, 0, kLattice};
    out.pixel_mm2 = grid.spacing_u_mm * grid.spacing_v_mm;
    const Field field = segment(upsampled(*image, factor), stack.pixel_unit(), Threshold{kBone_HU});
    const Pslg full =
        drop_small_rings(contours(field, grid, ContourKind::kSubpixel), kMinRegion_mm2, kLattice);
    out.peucker->push_back(simplify(full, kLattice, {0.25, SimplificationMethod::kDouglasPeucker}));
    out.peucker_quarter_pixel->push_back(simplify(
        full, kLattice, {0.25 * grid.spacing_u_mm, SimplificationMethod::kDouglasPeucker}));
    out.area->push_back(simplify(full, kLattice, {0.25, SimplificationMethod::kArea}));
  }
  return out;
}

void add_cases(const std::string& scan, const SliceStack& stack, std::vector<Case>& cases) {
  const auto add = [&](const std::string& name, const auto& outlines, double max_area_mm2,
                       bool keep_area) {
    RefinementOptions options;
    options.min_angle_deg = kMinAngle_deg;
    options.max_area_mm2 = max_area_mm2;
    options.keep_area = keep_area;
    cases.push_back({scan + name, outlines, options});
  };
  const Simplified native = simplified(stack, 1);
  add("/50mm2", native.peucker, 50, false);
  add("/50mm2/keep", native.area, 50, true);
  add("/1mm2", native.peucker, 1, false);
  if (scan != "head") return;
  const Simplified fine = simplified(stack, 4);
  add("-x4/50mm2", fine.peucker, 50, false);
  add("-x4/50mm2/0.25px", fine.peucker_quarter_pixel, 50, false);
  add("-x4/200px2", fine.peucker, 200 * fine.pixel_mm2, false);
  add("-x4/200px2/0.25px", fine.peucker_quarter_pixel, 200 * fine.pixel_mm2, false);
}

// All slices, one after the other; medians of enough passes for 0.2 s.
json timed(const Case& c) {
  std::vector<double> cdt_ms, refine_ms;
  double total_ms = 0;
  while (total_ms < 200 || cdt_ms.size() < 3) {
    double cdt = 0, refined = 0;
    for (const Pslg& pslg : *c.outlines) {
      const double start = cpu_ms();
      const auto from = triangulate(pslg);
      if (!from) throw std::runtime_error(from.error().message);
      const double between = cpu_ms();
      const Refined out = refine(*from, kLattice, c.options);
      refined += cpu_ms() - between;
      cdt += between - start;
    }
    cdt_ms.push_back(cdt);
    refine_ms.push_back(refined);
    total_ms += cdt + refined;
  }
  const auto median = [](std::vector<double>& v) {
    std::nth_element(v.begin(), v.begin() + static_cast<std::ptrdiff_t>(v.size() / 2), v.end());
    return v[v.size() / 2];
  };
  return {{"cdt_ms", median(cdt_ms)}, {"refine_ms", median(refine_ms)}};
}

double smallest_angle_deg(const SliceMesh& mesh, const Triangle& t) {
  const LatticePoint a = mesh.vertices[t[0]], b = mesh.vertices[t[1]], c = mesh.vertices[t[2]];
  const double area = static_cast<double>(orient2d(a, b, c));
  return std::min({std::atan2(area, static_cast<double>(diametral_dot(b, c, a))),
                   std::atan2(area, static_cast<double>(diametral_dot(c, a, b))),
                   std::atan2(area, static_cast<double>(diametral_dot(a, b, c)))}) *
         57.295779513082321;
}

json checked(const Case& c) {
  std::size_t triangles = 0, vertices = 0, corners = 0, below = 0, at_small = 0, unrefined = 0,
              invalid = 0;
  double free_angle_deg = 180, max_area_mm2 = 0, least_reached_deg = 180;
  std::uint64_t digest = 1469598103934665603U;
  for (const Pslg& pslg : *c.outlines) {
    const auto from = triangulate(pslg);
    const Refined out = refine(*from, kLattice, c.options);
    const MeshQuality q = measure_quality(out, kLattice, c.options.min_angle_deg);
    std::vector<char> at_input(out.mesh.triangles.size(), 0);
    for (const SharpTriangle& t : q.sharp)
      if (t.input_angle_deg < 60) at_input[t.triangle] = 1;
    for (std::size_t t = 0; t < out.mesh.triangles.size(); ++t) {
      if (!at_input[t])
        free_angle_deg =
            std::min(free_angle_deg, smallest_angle_deg(out.mesh, out.mesh.triangles[t]));
      for (const std::uint32_t v : out.mesh.triangles[t]) {
        const LatticePoint p = out.mesh.vertices[v];
        for (const std::int32_t x : {p.x, p.y})
          digest = (digest ^ static_cast<std::uint32_t>(x)) * 1099511628211U;
      }
    }
    triangles += out.mesh.triangles.size();
    vertices += out.mesh.vertices.size();
    corners += from->mesh.vertices.size();
    below += q.below_min_angle;
    at_small += q.below_at_small_input_angle;
    max_area_mm2 = std::max(max_area_mm2, q.max_area_mm2);
    unrefined += out.outcome == RefinementOutcome::kRefined ? 0 : 1;
    least_reached_deg = std::min(least_reached_deg, out.angle_deg);
    invalid += (check_mesh(out.mesh) && is_constrained_delaunay(out.mesh)) ? 0 : 1;
  }
  return {{"triangles", triangles},
          {"vertices", vertices},
          {"corners", corners},
          {"free_angle_deg", free_angle_deg},
          {"below", below},
          {"below_at_small_input_angle", at_small},
          {"max_area_mm2", max_area_mm2},
          {"unrefined", unrefined},
          {"not_delaunay", invalid},
          {"refined_to_deg", least_reached_deg},
          {"digest", digest}};
}

int run(int argc, char** argv) {
  std::vector<Case> cases;
  for (int i = 1; i < argc; ++i) {
    const std::string word = argv[i];
    const std::size_t equals = word.find('=');
    if (equals == std::string::npos) throw std::runtime_error("NAME=SCAN, not " + word);
    const auto stack = open_stack({word.substr(equals + 1)}, {});
    if (!stack) throw std::runtime_error(stack.error().message);
    add_cases(word.substr(0, equals), **stack, cases);
  }
  for (std::string line; std::getline(std::cin, line);) {
    json answer;
    if (line == "list") {
      for (const Case& c : cases)
        answer.push_back(c.name);
    }
    for (const Case& c : cases) {
      if (line == "time " + c.name) answer = timed(c);
      if (line == "check " + c.name) answer = checked(c);
      const std::string steeper = "check " + c.name + " ";  // and an angle in degrees
      if (line.starts_with(steeper)) {
        Case at_angle = c;
        at_angle.options.min_angle_deg = std::stod(line.substr(steeper.size()));
        answer = checked(at_angle);
      }
    }
    std::cout << answer.dump() << std::endl;
  }
  return 0;
}

}  // namespace
}  // namespace trocar::bench

int main(int argc, char** argv) {
  try {
    return trocar::bench::run(argc, argv);
  } catch (const std::exception& e) {
    std::fprintf(stderr, "refinement_bench: %s\n", e.what());
    return 3;
  }
}
