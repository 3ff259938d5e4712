// SPDX-License-Identifier: GPL-3.0-or-later
#include "tests/bench/peers.h"
#include "pipeline/contour/contour.h"
#include "pipeline/contour/simplification.h"
#include "pipeline/open/open_stack.h"
#include "pipeline/scan/mesh_stack.h"

#include <ctime>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <functional>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <set>

namespace trocar::pipeline::bench {
namespace {

using nlohmann::json;

double wall_ms() {
  return std::chrono::duration<double, std::milli>(
             std::chrono::steady_clock::now().time_since_epoch())
      .count();
}

double cpu_ms() {
  timespec t{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) * 1e3 + static_cast<double>(t.tv_nsec) * 1e-6;
}

double median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

// The share of each pixel that the disc covers, times 1000; sharp, or with a Gaussian edge.
Field disc(double radius_px, double sigma_px, double cx, double cy) {
  const int side = static_cast<int>(std::ceil(2 * radius_px)) + 6;
  Field field{{side, side, {}}, 500};
  constexpr int kSub = 64;
  for (int y = 0; y < side; ++y) {
    for (int x = 0; x < side; ++x) {
      const double dx = x - cx, dy = y - cy, d = std::hypot(dx, dy);
      if (sigma_px > 0) {
        field.image.values.push_back(
            static_cast<float>(500 * std::erfc((d - radius_px) / (sigma_px * std::sqrt(2.0)))));
        continue;
      }
      int inside = 0;
      if (d < radius_px + 1 && d > radius_px - 1) {
        for (int j = 0; j < kSub; ++j) {
          for (int i = 0; i < kSub; ++i) {
            const double sx = dx + (i + 0.5) / kSub - 0.5, sy = dy + (j + 0.5) / kSub - 0.5;
            inside += sx * sx + sy * sy < radius_px * radius_px ? 1 : 0;
          }
        }
      } else {
        inside = d < radius_px ? kSub * kSub : 0;
      }
      field.image.values.push_back(static_cast<float>(1000.0 * inside / (kSub * kSub)));
    }
  }
  return field;
}

struct Broken {
  std::size_t collapsed = 0, crossing = 0, slices = 0;
};

// A ring has collapsed if its area is zero or its orientation reversed. It crosses if one of its
// edges intersects another edge, of any ring, except in a shared vertex. Both tests are exact.
void count_broken(const Pslg& contours, const Pslg& simple, Broken& into) {
  struct Edge {
    LatticePoint a, b;
    std::size_t ring;
  };
  std::vector<Edge> edges;
  std::size_t collapsed = 0;
  for (std::size_t r = 0; r < simple.rings.size(); ++r) {
    const Ring& ring = simple.rings[r];
    const bool was_outer = doubled_area(contours.rings[r]) > 0;
    const std::int64_t area = ring.size() < 3 ? 0 : doubled_area(ring);
    if (area == 0 || (area > 0) != was_outer) {
      ++collapsed;
      continue;
    }
    for (std::size_t i = 0; i < ring.size(); ++i)
      edges.push_back({ring[i], ring[(i + 1) % ring.size()], r});
  }
  std::sort(edges.begin(), edges.end(), [](const Edge& e, const Edge& f) {
    return std::min(e.a.x, e.b.x) < std::min(f.a.x, f.b.x);
  });
  std::set<std::size_t> crossing;
  std::vector<const Edge*> active;
  for (const Edge& e : edges) {
    const std::int32_t x = std::min(e.a.x, e.b.x);
    std::erase_if(active, [x](const Edge* o) { return std::max(o->a.x, o->b.x) < x; });
    for (const Edge* o : active) {
      if (segments_cross(e.a, e.b, o->a, o->b)) crossing.insert({e.ring, o->ring});
    }
    active.push_back(&e);
  }
  into.collapsed += collapsed;
  into.crossing += crossing.size();
  into.slices += collapsed + crossing.size() > 0 ? 1 : 0;
}

Pslg approx_poly(const std::vector<std::vector<cv::Point>>& chains, double epsilon_steps) {
  Pslg out;
  std::vector<cv::Point> simple;
  for (const auto& chain : chains) {
    cv::approxPolyDP(chain, simple, epsilon_steps, true);
    Ring& ring = out.rings.emplace_back();
    for (const cv::Point p : simple)
      ring.push_back({p.x, p.y});
  }
  return out;
}

std::size_t vertex_count(const Pslg& pslg) {
  std::size_t n = 0;
  for (const Ring& ring : pslg.rings)
    n += ring.size();
  return n;
}

json broken_json(const Broken& b, std::size_t vertices, double ms_per_slice) {
  return {{"collapsed_rings", b.collapsed},
          {"crossing_rings", b.crossing},
          {"broken_slices", b.slices},
          {"vertices", vertices},
          {"ms_per_slice", ms_per_slice}};
}

struct Time {
  std::vector<double> wall, cpu;
  void add(const std::function<void()>& f) {
    const double w = wall_ms(), c = cpu_ms();
    f();
    wall.push_back(wall_ms() - w);
    cpu.push_back(cpu_ms() - c);
  }
  void put(json& row, const std::string& name) const {
    row[name + "_ms"] = median(wall);
    row[name + "_cpu_ms"] = median(cpu);
  }
};

}  // namespace

double median_ms(int repetitions, const std::function<void()>& f) {
  std::vector<double> times;
  for (int i = 0; i < repetitions; ++i) {
    const double start = wall_ms();
    f();
    times.push_back(wall_ms() - start);
  }
  return median(std::move(times));
}

double median_cpu_ms(int repetitions, const std::function<void()>& f) {
  Time time;
  for (int i = 0; i < repetitions; ++i)
    time.add(f);
  return median(time.cpu);
}

json disc_rows(const std::vector<double>& radii_px, double sigma_px, int offsets) {
  const PixelGrid grid{1, 1, 0, 0, Lattice{10}};
  json rows = json::array();
  for (const double radius : radii_px) {
    const double truth = std::acos(-1.0) * radius * radius;
    json row = {{"id", "radius_" + json(radius).dump() + "_blur_" + json(sigma_px).dump()},
                {"radius_px", radius},
                {"blur_sigma_px", sigma_px}};
    for (const auto& [kind, name] : {std::pair{ContourKind::kSubpixel, std::string("subpixel")},
                                     std::pair{ContourKind::kPixel, std::string("pixel")}}) {
      double sum = 0, worst = 0;
      for (int i = 0; i < offsets; ++i) {
        // Places spread evenly over the pixel: the additive recurrence of the plastic number.
        const double cx = std::fmod(0.5 + 0.7548776662466927 * i, 1.0),
                     cy = std::fmod(0.5 + 0.5698402909980532 * i, 1.0);
        const double centre = std::ceil(radius) + 2;
        const Pslg outline = contours(disc(radius, sigma_px, centre + cx, centre + cy), grid, kind);
        const double area = 0.5 * static_cast<double>(doubled_area(outline)) *
                            grid.lattice.step_mm() * grid.lattice.step_mm();
        sum += area / truth - 1;
        worst = std::max(worst, std::abs(area / truth - 1));
      }
      row[name + "_area_error_percent"] = 100 * sum / offsets;
      row[name + "_worst_area_error_percent"] = 100 * worst;
    }
    rows.push_back(std::move(row));
  }
  return rows;
}

json simplifier_rows(const SweepScan& scan, const std::vector<double>& tolerances_px,
                     int repetitions) {
  const Lattice lattice;
  json rows = json::array();
  for (const auto& [kind, name] : {std::pair{ContourKind::kSubpixel, std::string("subpixel")},
                                   std::pair{ContourKind::kPixel, std::string("pixel")}}) {
    std::vector<Pslg> full;
    std::vector<std::vector<std::vector<cv::Point>>> chains;
    for (int k = 0; k < scan.stack.size(); ++k) {
      const SlicePlane& plane = scan.stack.plane(k);
      const Field field = segment(scan.stack.images[k], PixelUnit::kHounsfield, Threshold{kIso_HU});
      full.push_back(drop_small_rings(
          contours(field, {plane.spacing_u_mm, plane.spacing_v_mm, 0, 0, lattice}, kind),
          scan.min_region_mm2, lattice));
      auto& slice = chains.emplace_back();
      for (const Ring& ring : full.back().rings) {
        auto& chain = slice.emplace_back();
        for (const LatticePoint p : ring)
          chain.emplace_back(p.x, p.y);
      }
    }
    for (const double px : tolerances_px) {
      const double tolerance_mm = px * scan.pixel_mm;
      const double slices = scan.stack.size();
      std::vector<Pslg> ours(full.size()), theirs(full.size());
      const double ours_ms = median_ms(repetitions, [&] {
        for (std::size_t k = 0; k < full.size(); ++k)
          ours[k] =
              simplify(full[k], lattice, {tolerance_mm, SimplificationMethod::kDouglasPeucker});
      });
      const double theirs_ms = median_ms(repetitions, [&] {
        for (std::size_t k = 0; k < full.size(); ++k)
          theirs[k] = approx_poly(chains[k], tolerance_mm / lattice.step_mm());
      });
      Broken by_us, by_them;
      std::size_t our_vertices = 0, their_vertices = 0, contour_vertices = 0, rings = 0;
      for (std::size_t k = 0; k < full.size(); ++k) {
        count_broken(full[k], ours[k], by_us);
        count_broken(full[k], theirs[k], by_them);
        our_vertices += vertex_count(ours[k]);
        their_vertices += vertex_count(theirs[k]);
        contour_vertices += vertex_count(full[k]);
        rings += full[k].rings.size();
      }
      rows.push_back({{"id", name + "_" + json(px).dump() + "px"},
                      {"contour", name},
                      {"tolerance_px", px},
                      {"tolerance_mm", tolerance_mm},
                      {"slices", scan.stack.size()},
                      {"rings", rings},
                      {"contour_vertices", contour_vertices},
                      {"trocar", broken_json(by_us, our_vertices, ours_ms / slices)},
                      {"approxPolyDP", broken_json(by_them, their_vertices, theirs_ms / slices)}});
    }
  }
  return rows;
}

Result<json> path_row(const std::filesystem::path& png, const std::filesystem::path& dicom,
                      std::array<double, 3> spacing_mm, double grey_threshold, int repetitions) {
  std::vector<std::string> files;
  for (const auto& entry : std::filesystem::directory_iterator(png))
    files.push_back(entry.path().string());
  std::sort(files.begin(), files.end());

  Result<void> ok;
  json row = {{"id", "sample"}, {"slices", files.size()}};
  std::vector<std::uint8_t> glb;
  const auto mesh = [&](const std::filesystem::path& input, double threshold, int threads) {
    OpenOptions open;
    open.spacing_mm = spacing_mm;
    const auto stack = open_stack({input}, open);
    if (!stack) return ok = stack.error(), void();
    StackOptions options;
    options.mesh.segmentation = Threshold{threshold};
    options.threads = threads;
    auto batch = mesh_stack(**stack, options, {});
    if (!batch) return ok = batch.error(), void();
    glb = std::move(batch->glb);
    row["triangles"] = batch->report["asset"]["triangles"];
    json total = json::object();  // of all slices, by stage
    for (const json& slice : batch->report["slices"])
      for (const auto& [stage, ms] : slice["ms"].items())
        total[stage + "_ms"] = total.value(stage + "_ms", 0.0) + ms.get<double>();
    total["encode_ms"] = total.value("encode_ms", 0.0) + batch->report["assemble_ms"].get<double>();
    if (threads == 1) row["stages"] = std::move(total);
  };
  const auto verify = [&] {
    const auto asset = decode_asset(glb, "the asset");
    if (!asset) return ok = asset.error(), void();
    if (auto proved = verify_asset(*asset, "the asset"); !proved) ok = proved.error();
  };
  Time decode, from_dicom, from_dicom_two, one, two, verified;
  cv::setNumThreads(1);
  for (int i = 0; i < repetitions && ok; ++i) {
    decode.add([&] {
      for (const std::string& file : files)
        if (cv::imread(file, cv::IMREAD_UNCHANGED).empty()) ok = refused(file + ": unreadable");
    });
    if (ok) from_dicom.add([&] { mesh(dicom, kIso_HU, 1); });
    if (ok) from_dicom_two.add([&] { mesh(dicom, kIso_HU, 2); });
    if (ok) two.add([&] { mesh(png, grey_threshold, 2); });
    if (ok) one.add([&] { mesh(png, grey_threshold, 1); });  // last: its stages are reported
    if (ok) verified.add(verify);
  }
  if (!ok) return ok.error();
  decode.put(row, "opencv_png_decode");
  one.put(row, "png_to_glb_1_thread");
  two.put(row, "png_to_glb_2_threads");
  from_dicom.put(row, "dicom_to_glb_1_thread");
  from_dicom_two.put(row, "dicom_to_glb_2_threads");
  verified.put(row, "verify");
  return row;
}

}  // namespace trocar::pipeline::bench
