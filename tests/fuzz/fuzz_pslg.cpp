// SPDX-License-Identifier: GPL-3.0-or-later
// An outline, or a picture and its outline, through every stage of meshing; stress cases also into
// an asset and back. All checks hold, or the input is refused. In: a stress case
// (tests/corpus/pslg), or bytes that encode rings or pixels.
#include <algorithm>
#include <array>
#include <cmath>
#include <string>

#include "formats/asset/asset.h"
#include "formats/mesh/mesh_quality.h"
#include "formats/mesh/mesh_validity.h"
#include "formats/mesh/refinement.h"
#include "formats/mesh/triangulation.h"
#include "pipeline/contour/contour.h"
#include "pipeline/contour/simplification.h"
#include "tests/cases/pslg_case.h"
#include "tests/fuzz/harness.h"

namespace {

using namespace trocar;            // NOLINT(google-build-using-namespace): a program of one file
using namespace trocar::pipeline;  // NOLINT(google-build-using-namespace)
using fuzz::fail;
using test::triangles_of;

constexpr std::size_t kMaxCorners = 3000;
constexpr int kMaxPixelsAcross = 64;
constexpr std::uint32_t kMaxVertices = 4000;

void expect(const Result<void>& proof, const char* stage) {
  if (!proof) fail(std::string(stage) + ": " + proof.error().message);
}

// Every boundary vertex of a refined mesh is within three steps of the segment that it splits, on
// the side of the material.
void expect_near_outline(const Refined& refined) {
  const std::vector<LatticePoint>& at = refined.mesh.vertices;
  for (std::size_t v = 0; v < at.size(); ++v) {
    const std::int32_t s = refined.origins[v].segment;
    if (s < 0) continue;
    const Refined::Segment& segment = refined.segments[static_cast<std::size_t>(s)];
    const LatticePoint a = at[segment.from], b = at[segment.to];
    const double off = static_cast<double>(orient2d(a, b, at[v])) /
                       std::sqrt(static_cast<double>(distance2(a, b)));
    if (!(off >= 0 && off < 3)) fail("a boundary vertex " + std::to_string(off) + " steps off");
  }
}

// An asset with a slice per height is unchanged, to the bit, by encoding and decoding, or is
// refused.
void expect_stored(const SliceMesh& mesh, const test::PslgCase& options) {
  Asset asset;
  asset.lattice = options.lattice;
  const test::Picture one;
  const test::Picture& picture = options.picture ? *options.picture : one;
  for (std::size_t k = 0; k < picture.z_mm.size(); ++k) {
    AssetSlice slice;
    slice.index = static_cast<int>(k);
    slice.z_mm = picture.z_mm[k];
    slice.T_lps_plane.translation() << picture.origin_mm[0], picture.origin_mm[1],
        picture.origin_mm[2] + slice.z_mm;
    slice.pslg = boundary_rings(mesh);
    slice.mesh = mesh;
    asset.slices.push_back(std::move(slice));
  }
  const auto bytes = encode_asset(asset);
  if (!bytes) return fuzz::expect_refusal(bytes.error());
  const auto back = decode_asset(*bytes, "input.glb");
  if (!back) fail("asset: " + back.error().message);
  expect(verify_asset(*back, "input.glb"), "asset");
  for (std::size_t k = 0; k < asset.slices.size(); ++k) {
    const AssetSlice &is = back->slices[k], &was = asset.slices[k];
    if (triangles_of(is.mesh) != triangles_of(was.mesh) || is.z_mm != was.z_mm ||
        is.T_lps_plane.matrix() != was.T_lps_plane.matrix())
      fail("asset: a slice is changed");
  }
}

void mesh_outline(const Pslg& outline, const test::PslgCase& options) {
  const auto cdt = triangulate(outline);
  if (!cdt) fail("triangulation: " + cdt.error().message);
  expect(check_mesh_against_pslg(cdt->mesh, outline), "triangulation");
  if (!is_constrained_delaunay(cdt->mesh)) fail("triangulation: not Delaunay");

  RefinementOptions refinement;
  refinement.min_angle_deg = options.min_angle_deg;
  refinement.max_area_mm2 = options.max_area_mm2;
  refinement.max_vertices = kMaxVertices;
  const Refined refined = refine(*cdt, options.lattice, refinement);
  expect(check_mesh_against_pslg(refined.mesh, boundary_rings(refined.mesh)), "refinement");
  if (!is_constrained_delaunay(refined.mesh)) fail("refinement: not Delaunay");
  if (refined.origins.size() != refined.mesh.vertices.size()) fail("refinement: origins missing");
  expect_near_outline(refined);
  double perimeter = 0;
  for (const Ring& ring : outline.rings) {
    for (std::size_t i = 0; i < ring.size(); ++i)
      perimeter += std::sqrt(static_cast<double>(distance2(ring[i], ring[(i + 1) % ring.size()])));
  }
  const std::int64_t lost = doubled_area(outline) - doubled_area(refined.mesh);
  if (lost < 0 || static_cast<double>(lost) > 2 * 3 * perimeter) fail("refinement: another area");
  const MeshQuality quality =
      measure_quality(refined, options.lattice, std::min(refined.angle_deg, 60.0));
  if (!std::isfinite(quality.min_angle_deg) || !std::isfinite(quality.max_area_mm2))
    fail("quality: not finite");
  if (refined.outcome == RefinementOutcome::kRefined && quality.below_unexplained > 0)
    fail("refinement: an unexplained sharp triangle");
  // Only for stress cases: on random bytes it finds little, and takes as long as all other checks.
  if (!options.right.empty()) expect_stored(refined.mesh, options);
}

// A translated outline gives the translated mesh.
void expect_moves(const Pslg& outline, const test::PslgCase& options) {
  Pslg moved = outline;
  for (Ring& ring : moved.rings) {
    for (LatticePoint& p : ring) {
      const std::int64_t x = std::int64_t{p.x} + options.also_at->x,
                         y = std::int64_t{p.y} + options.also_at->y;
      if (std::max(std::abs(x), std::abs(y)) > kMaxCoordinate) return;
      p = {static_cast<std::int32_t>(x), static_cast<std::int32_t>(y)};
    }
  }
  const auto there = triangulate(moved), here = triangulate(outline);
  if (!there) fail("triangulation elsewhere: " + there.error().message);
  if (triangles_of(there->mesh) != triangles_of(here->mesh, *options.also_at))
    fail("triangulation: another mesh after a translation");
}

void check_outline(const Pslg& outline, const test::PslgCase& options) {
  const auto valid = check_pslg(outline);
  if (!valid) return fuzz::expect_refusal(valid.error());
  mesh_outline(outline, options);
  if (options.also_at) expect_moves(outline, options);
  for (const auto method : {SimplificationMethod::kDouglasPeucker, SimplificationMethod::kArea}) {
    const Pslg simple = simplify(outline, options.lattice, {options.tolerance_mm, method});
    expect(check_pslg(simple), "simplification");
    if (simple.rings.size() != outline.rings.size())
      fail("simplification: another number of rings");
    const double moved_mm = hausdorff_mm(outline, simple, options.lattice);
    if (!(moved_mm <= options.tolerance_mm * (1 + 1e-12))) fail("simplification: beyond tolerance");
    if (simple.rings != outline.rings) mesh_outline(simple, options);
  }
}

void check_picture(const test::Picture& picture, const test::PslgCase& options) {
  const double narrowest_mm = std::min(picture.pixel_mm[0], picture.pixel_mm[1]);
  const double extent_mm =
      std::max(picture.width * picture.pixel_mm[0], picture.height * picture.pixel_mm[1]);
  // mesh_slice() refuses both.
  if (narrowest_mm < kMinStepsPerPixel * options.lattice.step_mm() ||
      extent_mm / options.lattice.step_mm() > 0xffffff)
    return;
  const Image image{picture.width, picture.height, picture.values};
  Field field = segment(image, PixelUnit::kHounsfield, Threshold{50});
  if (picture.is_mask)
    field =
        segment(LabelImage{image.width, image.height, {image.values.begin(), image.values.end()}},
                PixelUnit::kHounsfield, Labels{{100}});
  const PixelGrid grid{picture.pixel_mm[0], picture.pixel_mm[1], 0, 0, options.lattice};
  const Pslg all =
      contours(field, grid, picture.as_chains ? ContourKind::kPixel : ContourKind::kSubpixel);
  expect(check_pslg(all), "contour");
  check_outline(drop_small_rings(all, options.min_region_mm2, options.lattice), options);
}

test::Picture picture_of(fuzz::Bytes& bytes, int kind) {
  test::Picture out;
  out.width = 1 + bytes.below(24);
  out.height = 1 + bytes.below(24);
  out.is_mask = kind == 1;
  out.as_chains = kind == 2;
  std::uint8_t bits = 0;
  for (int i = 0; i < out.width * out.height; ++i) {
    if (kind == 3) {
      out.values.push_back(bytes.next());
    } else {
      bits = i % 8 == 0 ? bytes.next() : static_cast<std::uint8_t>(bits >> 1);
      out.values.push_back((bits & 1) != 0 ? 100.0F : 0.0F);
    }
  }
  return out;
}

// Rings with small coordinates, scaled and translated: degenerate ones are frequent.
Pslg rings_of(fuzz::Bytes& bytes) {
  Pslg out;
  const int scale = bytes.below(4);
  const std::int32_t factor = scale == 0 ? 1 : scale == 1 ? 7 : scale == 2 ? 400 : 1 << 21;
  const LatticePoint origin =
      bytes.below(2) == 0 ? LatticePoint{} : LatticePoint{bytes.small() << 22, bytes.small() << 22};
  for (std::size_t corners = 0; !bytes.empty() && corners < 200;) {
    Ring ring;
    for (int n = 3 + bytes.below(12); n > 0; --n)
      ring.push_back({origin.x + bytes.small() * factor, origin.y + bytes.small() * factor});
    corners += ring.size();
    // Usually the right orientation; else the outline is refused.
    if (bytes.below(8) != 0 && out.rings.empty() && doubled_area(ring) < 0)
      std::reverse(ring.begin(), ring.end());
    out.rings.push_back(std::move(ring));
  }
  return out;
}

void check_bytes(fuzz::Bytes bytes) {
  test::PslgCase options;
  options.min_angle_deg = bytes.below(61);
  options.max_area_mm2 = std::ldexp(1.0, bytes.below(20) - 4);
  options.tolerance_mm = bytes.below(32) / 8.0;
  const int kind = bytes.below(4);
  if (kind == 0) {
    check_outline(rings_of(bytes), options);
  } else {
    check_picture(picture_of(bytes, kind), options);
  }
}

test::Picture cropped(test::Picture picture) {
  const int width = std::min(picture.width, kMaxPixelsAcross),
            height = std::min(picture.height, kMaxPixelsAcross);
  std::vector<float> values;
  for (int y = 0; y < height; ++y) {
    const auto row = picture.values.begin() + std::ptrdiff_t{y} * picture.width;
    values.insert(values.end(), row, row + width);
  }
  picture.width = width;
  picture.height = height;
  picture.values = std::move(values);
  return picture;
}

std::size_t corners_of(const Pslg& outline) {
  std::size_t sum = 0;
  for (const Ring& ring : outline.rings)
    sum += ring.size();
  return sum;
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return 0;
  if (data[0] != '{') {
    check_bytes({data, size});
    return 0;
  }
  const auto read =
      test::parse_pslg_case({reinterpret_cast<const char*>(data), size}, "input.json");
  if (!read) return 0;
  // The few large cases are cropped or skipped here; their own test runs them completely.
  if (read->picture) {
    check_picture(cropped(*read->picture), *read);
  } else if (corners_of(read->outline) <= kMaxCorners) {
    check_outline(read->outline, *read);
  }
  return 0;
}
