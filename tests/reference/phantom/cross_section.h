// SPDX-License-Identifier: Apache-2.0
// Ground truth of the sample scan, against which errors of contours are measured: the exact outline of the bone at any
// height. It is the curve in the plane at this height on which a smooth function has the value 0
// (the level set 0 of the function).
//
// There are two ground truths:
//  - surface_section: the anatomy, that is, the bone's outer surface;
//  - iso_section: the curve on which a noiseless scanner measures the iso-value. The scanner
//    averages over the area of a pixel and the thickness of a slice, after the phantom's blur
//    (point spread). A perfect contouring program would find this curve in the scan. For 226 HU
//    this curve lies a few tenths of a mm outside the anatomy, because 226 HU is below the mean of
//    bone and soft tissue.
//
// Method: A quadtree discards squares that are too far from the bone's surface to meet the curve.
// Marching squares traces the curve in the remaining squares. Every crossing of the curve with a
// side of a square is refined by bracketing root finding (ITP: Oliveira and Takahashi 2020). Every
// chord is split until its distance from the curve is at most the tolerance.
#pragma once

#include <functional>
#include <vector>

#include "formats/base/result.h"
#include "sample_ct/render.h"

namespace trocar::sample {

/// The inverse of to_anatomy().
Vec3 to_scan(const PhantomOptions& phantom, Vec3 p_anatomy);

/// The signed distance of sample_bone() at a point of the anatomical frame, and of the scan frame.
double bone_distance_mm(Vec3 p);
double bone_distance_mm(const PhantomOptions& phantom, Vec3 p_scan);

/// Noiseless HU at a point of the scan frame, before any pixel or slice averages it.
double field_hu(const PhantomOptions& phantom, Vec3 p_scan);

struct SectionOptions {
  /// Cell size of marching squares. Islands and gaps smaller than a cell may be missed. The cell
  /// size is halved, up to four times, if the outline bends too sharply within a cell.
  double cell_mm = 0.2;
  double tolerance_mm = 1e-3;  ///< largest distance of the true curve from a chord
};

/// An exact cross-section. Its rings lie in the x-y plane of the scan frame (mm); they are simple
/// and disjoint, and do not repeat the first point. Outer rings have positive area
/// (counter-clockwise from x to y) and holes have negative area, so the material is on the left.
/// Every point of a ring lies on the level set within 1e-9 mm, and every chord within tolerance_mm.
/// Each ring starts at its point with the smallest y and, among points of this y, the smallest x.
/// Rings are ordered by their first points.
struct CrossSection {
  double z_mm = 0;
  double tolerance_mm = 0;
  std::vector<std::vector<Vec2>> rings;
  /// Area within the curve, computed as that of the rings' polygons plus a parabolic segment over
  /// each chord.
  double area_mm2 = 0;
  double area_error_mm2 = 0;  ///< bound on area_mm2's error: perimeter * tolerance / 4
};

/// The function whose level set 0 is traced. value(p) is positive in the material. Within the
/// distance clear_mm(p) of the point p, the sign of value() does not change.
struct PlaneField {
  std::function<double(Vec2)> value;
  std::function<double(Vec2)> clear_mm;
};

/// Traces the level set 0 of the field in the rectangle from `lower` to `upper` (mm). Evaluates the
/// field O(n) times if the curve crosses n cells. Errors: kRefused if the curve leaves the
/// rectangle; kUsage if an option is not positive, or if the rectangle is empty or wider than 1024
/// cells; kBug if the outline bends too sharply for the smallest cells.
Result<CrossSection> trace_section(const PlaneField& field, Vec2 lower, Vec2 upper, double z_mm,
                                   const SectionOptions& options);

/// The bone's outer surface at height z. Does not fail for |z| <= 40 mm with the default options.
Result<CrossSection> surface_section(const PhantomOptions& phantom, double z_mm,
                                     const SectionOptions& options = {});

/// The curve on which a noiseless scanner measures iso_hu in a slice whose middle is at height z.
/// Errors: kUsage unless iso_hu is above the HU of all soft tissue (110) and below the HU of the
/// whole cancellous core (the core's mean minus its texture). Otherwise the curve would follow the
/// texture and not the bone.
Result<CrossSection> iso_section(const PhantomOptions& phantom, const ScanGeometry& scan,
                                 double z_mm, double iso_hu = 226,
                                 const SectionOptions& options = {});

/// Signed distance in the plane to the rings of a cross-section, negative in the material. The
/// distance from the true curve differs by at most tolerance_mm. The constructor takes O(n), a
/// query near the outline O(1).
class SectionDistance {
 public:
  explicit SectionDistance(const CrossSection& section);
  /// +infinity if the section is empty.
  double operator()(Vec2 p) const;

 private:
  struct Segment {
    Vec2 a, b;
  };
  bool inside(Vec2 p) const;

  std::vector<Segment> segments_;
  std::vector<std::vector<int>> buckets_;  // segments by grid cell, row by row
  std::vector<std::vector<int>> strips_;   // segments by grid row, for inside()
  Vec2 origin_;
  double cell_mm_ = 1;
  int columns_ = 0, rows_ = 0;
};

}  // namespace trocar::sample
