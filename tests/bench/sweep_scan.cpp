// SPDX-License-Identifier: GPL-3.0-or-later
#include "tests/bench/sweep_scan.h"
#include "pipeline/contour/contour.h"
#include "pipeline/open/open_stack.h"
#include "sample_ct/render.h"

#include <algorithm>
#include <cmath>

namespace trocar::pipeline::bench {
namespace {

constexpr Lattice kFinest{kMaxLatticeBits};

sample::ScanGeometry phantom_geometry() {
  return *sample::sample_geometry(512, 35);
}

double ring_area_mm2(const std::vector<sample::Vec2>& ring) {
  double doubled = 0;
  for (std::size_t i = 0; i < ring.size(); ++i)
    doubled += cross(ring[i], ring[(i + 1) % ring.size()]);
  return 0.5 * doubled;
}

// The widest of the intervals into which the rings' areas (mm^2) divide low .. high.
double middle_of_widest_gap(const std::vector<sample::CrossSection>& slices, double low,
                            double high) {
  std::vector<double> areas{low, high};
  for (const sample::CrossSection& slice : slices) {
    for (const auto& ring : slice.rings) {
      const double area = std::abs(ring_area_mm2(ring));
      if (area > low && area < high) areas.push_back(area);
    }
  }
  std::sort(areas.begin(), areas.end());
  std::size_t widest = 1;
  for (std::size_t i = 1; i < areas.size(); ++i)
    if (areas[i] - areas[i - 1] > areas[widest] - areas[widest - 1]) widest = i;
  return 0.5 * (areas[widest - 1] + areas[widest]);
}

// Chooses the scan's min_region_mm2 and removes smaller rings from the true outlines.
void take_truths(std::vector<sample::CrossSection> sections, SweepScan& scan) {
  scan.min_region_mm2 = middle_of_widest_gap(sections, 0.9, 1.1);
  for (sample::CrossSection& section : sections) {
    std::erase_if(section.rings, [&](const auto& ring) {
      const double area = ring_area_mm2(ring);
      if (std::abs(area) >= scan.min_region_mm2) return false;
      section.area_mm2 -= area;
      return true;
    });
    scan.truths.emplace_back(std::move(section));
  }
}

}  // namespace

Result<sample::CrossSection> PhantomTruths::at(int slice) {
  for (const auto& [known, section] : known_)
    if (known == slice) return section;
  const sample::ScanGeometry scan = phantom_geometry();
  auto section =
      sample::iso_section({}, scan, sample::pixel_centre_mm(scan, 0, 0, slice).z, kIso_HU);
  if (!section) return section.error();
  for (auto& ring : section->rings)
    for (sample::Vec2& p : ring)
      p = p - sample::Vec2{scan.first_pixel_mm.x, scan.first_pixel_mm.y};
  known_.emplace_back(slice, *section);
  return section;
}

Result<SweepScan> phantom_scan(const std::vector<int>& slices, double noise_hu,
                               PhantomTruths& truths) {
  const sample::PhantomOptions phantom;
  const sample::ScanGeometry scan = phantom_geometry();
  SweepScan out;
  std::vector<sample::CrossSection> sections;
  out.pixel_mm = scan.pixel_mm;
  for (const int k : slices) {
    if (k < 0 || k >= scan.slices) return usage("the phantom has slices 0 to 34");
    auto truth = truths.at(k);
    if (!truth) return truth.error();
    sections.push_back(std::move(*truth));
    const std::vector<double> hu = sample::render_slice(phantom, scan, k);
    const std::vector<double> noise =
        noise_hu > 0 ? sample::noise_slice(scan, phantom.seed, noise_hu, k) : std::vector<double>();
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
    out.stack.names.push_back("phantom slice " + std::to_string(k));
  }
  if (sections.empty()) return usage("no slices chosen");
  take_truths(std::move(sections), out);
  return out;
}

Result<SweepScan> file_scan(const std::filesystem::path& path, int first, int stride) {
  if (first < 0 || stride < 1) return usage("first must be >= 0 and stride >= 1");
  const auto stack = open_stack({path}, {});
  if (!stack) return stack.error();
  SweepScan out;
  std::vector<sample::CrossSection> sections;
  for (int k = first; k < (*stack)->size(); k += stride) {
    auto image = (*stack)->read(k);
    if (!image) return image.error();
    const SlicePlane& plane = (*stack)->plane(k);
    out.pixel_mm = std::min(plane.spacing_u_mm, plane.spacing_v_mm);
    out.stack.images.push_back(std::move(*image));
    out.stack.planes.push_back(plane);
    out.stack.names.push_back((*stack)->name(k));
    const Field field =
        segment(out.stack.images.back(), PixelUnit::kHounsfield, Threshold{kIso_HU});
    const PixelGrid grid{plane.spacing_u_mm, plane.spacing_v_mm, 0, 0, kFinest};
    sections.push_back(as_section(contours(field, grid, ContourKind::kSubpixel), kFinest));
  }
  take_truths(std::move(sections), out);
  if (out.truths.empty()) return usage(path.string() + ": has no slice " + std::to_string(first));
  return out;
}

}  // namespace trocar::pipeline::bench
