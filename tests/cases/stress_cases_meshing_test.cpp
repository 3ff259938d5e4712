// SPDX-License-Identifier: GPL-3.0-or-later
// The stress cases of meshing, tests/corpus/pslg: each outline or picture through all stages, with
// the checks of every stage and the results in the file.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "formats/asset/asset.h"
#include "formats/mesh/canonical_rotation.h"
#include "formats/mesh/mesh_quality.h"
#include "formats/mesh/mesh_validity.h"
#include "formats/mesh/refinement.h"
#include "formats/mesh/triangulation.h"
#include "pipeline/bake/mesh_slice.h"
#include "tests/cases/picture_checks.h"
#include "tests/cases/pslg_case.h"
#include "tests/support/memory_stack.h"
#include "tests/support/motions.h"
#include "tests/support/take.h"

namespace trocar::pipeline {
namespace {

using test::PslgCase;
using test::triangles_of;

std::string name_of(RefinementOutcome outcome) {
  switch (outcome) {
    case RefinementOutcome::kRefined:
      return "refined";
    case RefinementOutcome::kLatticeTooCoarse:
      return "lattice too coarse";
    case RefinementOutcome::kAngleNotReached:
      return "angle not reached";
    case RefinementOutcome::kVertexBudget:
      break;
  }
  return "vertex budget";
}

/// Computed from the coordinates of the corners; 60 without triangles.
double smallest_angle_deg(const SliceMesh& mesh) {
  double least = 60;
  for (const Triangle& t : mesh.triangles) {
    for (std::size_t i = 0; i < 3; ++i) {
      const LatticePoint a = mesh.vertices[t[i]], b = mesh.vertices[t[(i + 1) % 3]],
                         c = mesh.vertices[t[(i + 2) % 3]];
      const double angle = std::atan2(static_cast<double>(orient2d(a, b, c)),
                                      static_cast<double>(diametral_dot(b, c, a)));
      least = std::min(least, angle * 180 / std::numbers::pi);
    }
  }
  return least;
}

/// The picture as a scan whose slices are all the same.
MemoryStack stack_of(const test::Picture& picture) {
  MemoryStack out;
  for (const double z_mm : picture.z_mm) {
    out.images.push_back({picture.width, picture.height, picture.values});
    SlicePlane plane{picture.pixel_mm[0], picture.pixel_mm[1], Eigen::Affine3d::Identity(), z_mm};
    plane.T_lps_plane.translation() << picture.origin_mm[0], picture.origin_mm[1],
        picture.origin_mm[2] + z_mm;
    out.planes.push_back(plane);
  }
  return out;
}

class MeshingStress : public testing::TestWithParam<std::filesystem::path> {
 protected:
  void SetUp() override {
    const auto read =
        test::take(test::parse_pslg_case(test::text_of(GetParam()), GetParam().filename()));
    case_ = read;
  }

  // Checks counts and areas of an outline and its triangulation. The number of triangles is that
  // of Douglas-Peucker, where an outline is simplified at all.
  void expect_counts(const Pslg& outline, const SliceMesh& cdt,
                     SimplificationMethod method = SimplificationMethod::kDouglasPeucker) const {
    const test::PslgExpectation& e = case_.expect;
    const auto holes = std::count_if(outline.rings.begin(), outline.rings.end(),
                                     [](const Ring& r) { return doubled_area(r) < 0; });
    const auto expect_is = [](const char* what, std::int64_t is,
                              std::optional<std::int64_t> right) {
      EXPECT_EQ(is, right.value_or(is)) << what;
    };
    expect_is("rings", static_cast<std::int64_t>(outline.rings.size()), e.rings);
    expect_is("holes", holes, e.holes);
    expect_is("doubled area", doubled_area(outline), e.doubled_area_steps2);
    if (method == SimplificationMethod::kDouglasPeucker)
      expect_is("triangles", static_cast<std::int64_t>(cdt.triangles.size()), e.triangles);
    // Euler: a triangulation of disjoint rings without further points has this many triangles.
    std::set<LatticePoint> points;
    std::size_t corners = 0;
    for (const Ring& ring : outline.rings) {
      points.insert(ring.begin(), ring.end());
      corners += ring.size();
    }
    if (points.size() == corners) {
      const auto outer = static_cast<std::int64_t>(outline.rings.size()) - holes;
      EXPECT_EQ(static_cast<std::int64_t>(cdt.triangles.size()),
                static_cast<std::int64_t>(corners) + 2 * holes - 2 * outer);
    }
  }

  // The outline's corners are kept, and its edges recede by less than three steps, which bounds the
  // lost area. Where areas are kept the points on both sides of a ring's edges make up for each
  // other, but for the last one: half a step along the longest edge.
  static void expect_of_outline(const SliceMesh& mesh, const Pslg& outline, bool keeps_area) {
    const std::set<LatticePoint> points(mesh.vertices.begin(), mesh.vertices.end());
    double perimeter = 0, longest = 0;
    for (const Ring& ring : outline.rings) {
      double longest_here = 0;
      for (std::size_t i = 0; i < ring.size(); ++i) {
        EXPECT_TRUE(points.contains(ring[i])) << ring[i].x << ", " << ring[i].y << " is missing";
        const double edge =
            std::sqrt(static_cast<double>(distance2(ring[i], ring[(i + 1) % ring.size()])));
        perimeter += edge;
        longest_here = std::max(longest_here, edge);
      }
      longest += longest_here;
    }
    const std::int64_t lost = doubled_area(outline) - doubled_area(mesh);
    EXPECT_GE(lost, keeps_area ? -static_cast<std::int64_t>(longest) : 0);
    EXPECT_LE(static_cast<double>(lost), keeps_area ? longest : 2 * 3 * perimeter);
  }

  void expect_refined(const Refined& refined, const Pslg& outline, bool keeps_area = false) const {
    expect_of_outline(refined.mesh, outline, keeps_area);
    const test::PslgExpectation& e = case_.expect;
    const SliceMesh& mesh = refined.mesh;
    const auto ok = check_mesh_against_pslg(mesh, boundary_rings(mesh));
    EXPECT_TRUE(ok) << ok.error().message;
    EXPECT_TRUE(is_constrained_delaunay(mesh));
    EXPECT_EQ(name_of(refined.outcome), e.refinement);
    if (e.refined_triangles_max > 0) {
      EXPECT_LE(static_cast<std::int64_t>(mesh.triangles.size()), e.refined_triangles_max);
    }
    const MeshQuality quality = measure_quality(refined, case_.lattice, case_.min_angle_deg);
    EXPECT_LE(std::int64_t{quality.below_min_angle}, e.sharp_max);
    EXPECT_GE(smallest_angle_deg(mesh), e.min_angle_deg_min.value_or(0));
    if (refined.outcome == RefinementOutcome::kRefined) {
      EXPECT_EQ(quality.below_unexplained, 0U);
      EXPECT_EQ(quality.below_min_angle, quality.below_at_small_input_angle);
    }
    EXPECT_LE(std::int64_t{quality.negative_stiffness_edges}, e.negative_stiffness_max);
    if (refined.outcome == RefinementOutcome::kRefined) {
      EXPECT_LE(quality.max_area_mm2, case_.max_area_mm2);
    }
  }

  RefinementOptions refinement() const {
    RefinementOptions options;
    options.min_angle_deg = case_.min_angle_deg;
    options.max_area_mm2 = case_.max_area_mm2;
    return options;
  }

  void outline_is_right() const {
    const auto valid = check_pslg(case_.outline);
    ASSERT_EQ(static_cast<bool>(valid), case_.expect.meshed)
        << (valid ? "not refused" : valid.error().message);
    if (!valid) {
      EXPECT_EQ(valid.error().code, ExitCode::kRefused);
      EXPECT_NE(valid.error().message.find(case_.expect.because), std::string::npos)
          << valid.error().message;
      return;
    }
    const auto cdt = test::take(triangulate(case_.outline));
    test::take(check_mesh_against_pslg(cdt.mesh, case_.outline));
    EXPECT_TRUE(is_constrained_delaunay(cdt.mesh));
    expect_counts(case_.outline, cdt.mesh);
    const Refined refined = refine(cdt, case_.lattice, refinement());
    expect_refined(refined, case_.outline);
    expect_stored_if_it_fits(refined.mesh);
    if (case_.also_at) expect_moves_along(cdt, refined.mesh, {0, *case_.also_at});
    for (int quarters = 0; quarters < 4; ++quarters)
      expect_moves_along(cdt, refined.mesh, {quarters, far_from(case_.outline, quarters)});
  }

  // A large translation that keeps the rotated outline on the lattice.
  static LatticePoint far_from(const Pslg& outline, int quarters) {
    LatticePoint by{123'456'789, -198'765'432};
    for (const Ring& ring : test::Motion{quarters, {}}(outline).rings) {
      for (const LatticePoint p : ring) {
        by = {std::clamp(by.x, -kMaxCoordinate - p.x, kMaxCoordinate - p.x),
              std::clamp(by.y, -kMaxCoordinate - p.y, kMaxCoordinate - p.y)};
      }
    }
    return by;
  }

  // The moved outline gives the moved mesh, to the bit. Exception: an outline that a rotation may
  // map to itself, where ties (four cocircular corners, positions of refinement points) can be
  // broken differently.
  void expect_moves_along(const Triangulation& here, const SliceMesh& refined_here,
                          const test::Motion& motion) const {
    const auto there = test::take(triangulate(motion(case_.outline)));
    CentroidOffset own;
    for (const Ring& ring : case_.outline.rings) {
      for (const LatticePoint p : ring)
        own.add(p);
    }
    const bool undecided = motion.quarters != 0 && own.x() == 0 && own.y() == 0;
    const std::string what = std::to_string(motion.quarters) + " quarter turns";
    if (!undecided || !test::has_ties(here.mesh)) {
      EXPECT_EQ(triangles_of(there.mesh), triangles_of(motion(here.mesh))) << what;
    }
    const Refined refined_there = refine(there, case_.lattice, refinement());
    if (!undecided) {
      EXPECT_EQ(triangles_of(refined_there.mesh), triangles_of(motion(refined_here))) << what;
    }
    expect_refined(refined_there, motion(case_.outline));
    expect_stored_if_it_fits(refined_there.mesh);
  }

  MeshOptions mesh_options(SimplificationMethod method) const {
    MeshOptions options;
    options.segmentation = Threshold{50};
    if (case_.picture->is_mask) options.segmentation = Labels{{100}};
    options.contour = case_.picture->as_chains ? ContourKind::kPixel : ContourKind::kSubpixel;
    options.simplification.tolerance_mm = case_.tolerance_mm;
    options.simplification.method = method;
    options.refinement = refinement();
    options.min_region_mm2 = case_.min_region_mm2;
    options.lattice = case_.lattice;
    return options;
  }

  // Twice the area that moves if every vertex moves by half a step along a grid line of the pixels.
  static double most_by_rounding(const Pslg& contours) {
    double out = 0;
    for (const Ring& ring : contours.rings) {
      for (std::size_t i = 0; i < ring.size(); ++i) {
        const LatticePoint p = ring[i], q = ring[(i + 2) % ring.size()];
        out += 0.5 * std::max(std::abs(q.x - p.x), std::abs(q.y - p.y));
      }
    }
    return out;
  }

  // Checks the full contours from the pixels alone.
  void expect_pixels_on_the_right_side(const Pslg& contours) const {
    const test::Picture& picture = *case_.picture;
    if (case_.min_region_mm2 > 0) return;
    const double steps_per_mm = 1 / case_.lattice.step_mm();
    test::PixelTruth truth{picture.width, picture.height, {}};
    truth.step_u = picture.pixel_mm[0] * steps_per_mm;
    truth.step_v = picture.pixel_mm[1] * steps_per_mm;
    truth.as_chains = picture.as_chains;
    truth.half_way = picture.is_mask;
    for (const float v : picture.values)
      truth.material.push_back(picture.is_mask ? v == 100 : v >= 50);
    EXPECT_EQ(test::wrong_pixel(truth, contours), "");
    if (const auto area = test::exact_doubled_area(truth)) {
      // The borders of a mask are smoothed: each keeps its area except for rounding to the lattice.
      const auto off = static_cast<double>(doubled_area(contours) - *area);
      const double most = std::min(1e-3 * static_cast<double>(*area), most_by_rounding(contours));
      EXPECT_LE(std::abs(off), picture.is_mask ? most : 0);
    }
  }

  void picture_is_right(SimplificationMethod method) const {
    const bool keeps_area = method == SimplificationMethod::kArea;
    const MemoryStack stack = stack_of(*case_.picture);
    Asset asset;
    asset.lattice = case_.lattice;
    for (int k = 0; k < stack.size(); ++k) {
      const auto meshed = mesh_slice(stack, k, mesh_options(method));
      ASSERT_EQ(static_cast<bool>(meshed), case_.expect.meshed)
          << (meshed ? "not refused" : meshed.error().message);
      if (!meshed) {
        EXPECT_EQ(meshed.error().code, ExitCode::kRefused);
        EXPECT_NE(meshed.error().message.find(case_.expect.because), std::string::npos)
            << meshed.error().message;
        return;
      }
      const MeshedMaterial* const slice = &meshed->materials[0];
      // Without a tolerance none holds for the points that refinement puts on the outline.
      if (!keeps_area || case_.tolerance_mm > 0) {
        EXPECT_LE(slice->simplification_error_mm, case_.tolerance_mm * (1 + 1e-12));
      }
      const auto contours_ok = check_pslg(slice->contours);
      EXPECT_TRUE(contours_ok) << contours_ok.error().message;
      expect_pixels_on_the_right_side(slice->contours);
      const auto cdt_ok = check_mesh_against_pslg(slice->cdt, slice->pslg);
      EXPECT_TRUE(cdt_ok) << cdt_ok.error().message;
      expect_counts(slice->pslg, slice->cdt, method);
      expect_refined(slice->refined, slice->pslg, keeps_area);
      AssetSlice out;
      out.index = k;
      out.z_mm = stack.plane(k).z_mm;
      out.T_lps_plane = stack.plane(k).T_lps_plane;
      out.pslg = slice->outline.pslg();
      out.mesh = slice->refined.mesh;
      asset.slices.push_back(std::move(out));
    }
    expect_stored_in_an_asset(asset);
  }

  // An asset's positions have 24 bits, relative to the plane's origin or to the first vertex.
  static bool fits_an_asset(const SliceMesh& mesh) {
    std::int64_t extent = 0;
    for (const LatticePoint p : mesh.vertices) {
      for (const LatticePoint q : {mesh.vertices[0], LatticePoint{}})
        extent = std::max(
            {extent, std::abs(std::int64_t{p.x} - q.x), std::abs(std::int64_t{p.y} - q.y)});
    }
    return extent <= kMaxAssetSpan;
  }

  // Stored in an asset, or refused with a hint.
  void expect_stored_if_it_fits(const SliceMesh& mesh) const {
    Asset asset;
    asset.lattice = case_.lattice;
    asset.slices.emplace_back();
    asset.slices[0].mesh = mesh;
    asset.slices[0].pslg = boundary_rings(mesh);
    if (fits_an_asset(mesh)) return expect_stored_in_an_asset(asset);
    const auto bytes = encode_asset(asset);
    ASSERT_FALSE(bytes);
    EXPECT_EQ(bytes.error().code, ExitCode::kRefused);
    EXPECT_NE(bytes.error().message.find("use a coarser lattice"), std::string::npos);
  }

  // Encoding and decoding gives the same triangles and planes.
  static void expect_stored_in_an_asset(const Asset& asset) {
    const auto bytes = test::take(encode_asset(asset));
    const auto back = test::take(decode_asset(bytes, "case.glb"));
    const auto proved = verify_asset(back, "case.glb");
    EXPECT_TRUE(proved) << proved.error().message;
    ASSERT_EQ(back.slices.size(), asset.slices.size());
    for (std::size_t k = 0; k < asset.slices.size(); ++k) {
      EXPECT_EQ(triangles_of(back.slices[k].mesh), triangles_of(asset.slices[k].mesh));
      EXPECT_EQ(back.slices[k].z_mm, asset.slices[k].z_mm);
      EXPECT_EQ(back.slices[k].T_lps_plane.matrix(), asset.slices[k].T_lps_plane.matrix());
    }
  }

  PslgCase case_;
};

TEST_P(MeshingStress, IsRight) {
  SCOPED_TRACE(GetParam().filename().string() + ": correct is: " + case_.right);
  if (case_.picture) {
    for (const SimplificationMethod method :
         {SimplificationMethod::kDouglasPeucker, SimplificationMethod::kArea}) {
      SCOPED_TRACE(method == SimplificationMethod::kArea ? "area" : "Douglas-Peucker");
      picture_is_right(method);
    }
  } else {
    outline_is_right();
  }
}

INSTANTIATE_TEST_SUITE_P(Meshing, MeshingStress,
                         testing::ValuesIn(test::case_files(TROCAR_CORPUS "/pslg")),
                         [](const auto& at) { return test::test_name(at.param); });

}  // namespace
}  // namespace trocar::pipeline
