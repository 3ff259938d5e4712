// SPDX-License-Identifier: GPL-3.0-or-later
#include "tests/bench/true_outlines.h"

#include <algorithm>
#include <cmath>
#include <map>

#include "pipeline/contour/contour.h"
#include "pipeline/open/open_stack.h"
#include "sample_ct/render.h"
#include "tests/bench/bench.h"

namespace trocar::pipeline::bench {
namespace {

using sample::CrossSection;
using sample::SectionDistance;
using sample::Vec2;
using trocar::bench::take;

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
        for (; next < length; next += step_mm) {
          const double d = std::abs(to(a + (next / length) * ab));
          sum_mm += d;
          most_mm = std::max(most_mm, d);
          ++samples;
        }
        next -= length;
      }
    }
  }
  double mean_mm() const { return sum_mm / std::max(samples, 1); }
};

}  // namespace

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

}  // namespace trocar::pipeline::bench
