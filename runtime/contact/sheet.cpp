// SPDX-License-Identifier: Apache-2.0
#include "runtime/contact/sheet.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <utility>

#include "formats/mesh_validity.h"

namespace trocar::runtime {
namespace {

constexpr double kSnap = 1e-9;

/// A convex polygon, counter-clockwise, relative to a corner of the tool. A half plane adds at
/// most one vertex: tool, triangle's three sides and every side of every hole fit.
struct Piece {
  static constexpr int kCapacity = kMaxToolSides * (1 + kMaxPendingHoles) + 3;
  int size = 0;
  std::array<Eigen::Vector2d, kCapacity> points;
};

double doubled_area(const Piece& piece) noexcept {
  double sum = 0;
  for (int i = 2; i < piece.size; ++i) {
    const Eigen::Vector2d a = piece.points[i - 1] - piece.points[0];
    const Eigen::Vector2d b = piece.points[i] - piece.points[0];
    sum += a.x() * b.y() - a.y() * b.x();
  }
  return sum;
}

/// What of the piece lies left of a -> b (Sutherland and Hodgman, one plane).
void clip(const Piece& piece, const Eigen::Vector2d& a, const Eigen::Vector2d& b,
          Piece& result) noexcept {
  result.size = 0;
  const Eigen::Vector2d d = b - a;
  const auto side = [&](const Eigen::Vector2d& p) {
    return d.x() * (p.y() - a.y()) - d.y() * (p.x() - a.x());
  };
  for (int i = 0; i < piece.size; ++i) {
    const Eigen::Vector2d& p = piece.points[i];
    const Eigen::Vector2d& q = piece.points[i + 1 == piece.size ? 0 : i + 1];
    const double at_p = side(p), at_q = side(q);
    // Rounding can make a convex polygon cross a line more than twice by a hair; the
    // capacity is then the bound, and what is lost is of the size of that hair.
    if (at_p >= 0 && result.size < Piece::kCapacity) result.points[result.size++] = p;
    if (((at_p > 0 && at_q < 0) || (at_p < 0 && at_q > 0)) && result.size < Piece::kCapacity) {
      result.points[result.size++] = p + (at_p / (at_p - at_q)) * (q - p);
    }
  }
  if (result.size < 3) result.size = 0;
}

Eigen::Vector2d relative(LatticePoint p, LatticePoint origin) noexcept {
  return {static_cast<double>(std::int64_t{p.x} - origin.x),
          static_cast<double>(std::int64_t{p.y} - origin.y)};
}

/// Doubled area of the piece less the union of the holes: cut off, side by side, what lies outside
/// of the first hole (disjoint convex pieces), and judge these against the others.
double doubled_area_outside(const Piece& piece, std::span<const LatticeOutline> holes,
                            LatticePoint origin) noexcept {
  if (holes.empty()) return doubled_area(piece);
  const LatticeOutline& hole = holes.front();
  double sum = 0;
  Piece rest = piece, outside, inside;
  for (int i = 0; i < hole.size && rest.size > 0; ++i) {
    const Eigen::Vector2d a = relative(hole.points[i], origin);
    const Eigen::Vector2d b = relative(hole.points[i + 1 == hole.size ? 0 : i + 1], origin);
    clip(rest, b, a, outside);
    if (outside.size > 0) sum += doubled_area_outside(outside, holes.subspan(1), origin);
    clip(rest, a, b, inside);
    std::swap(rest, inside);
  }
  return sum;
}

/// Centroid of the material in mm.
std::array<double, 2> centroid_mm(const SliceMesh& mesh, const Lattice& lattice) {
  const LatticePoint origin = mesh.vertices.front();
  Eigen::Vector2d sum = Eigen::Vector2d::Zero();
  double area = 0;
  for (const Triangle& t : mesh.triangles) {
    const Eigen::Vector2d a = relative(mesh.vertices[t[0]], origin);
    const Eigen::Vector2d b = relative(mesh.vertices[t[1]], origin);
    const Eigen::Vector2d c = relative(mesh.vertices[t[2]], origin);
    const double doubled = (b - a).x() * (c - a).y() - (b - a).y() * (c - a).x();
    sum += doubled * (a + b + c) / 3;
    area += doubled;
  }
  sum /= area;
  return {(origin.x + sum.x()) * lattice.step_mm(), (origin.y + sum.y()) * lattice.step_mm()};
}

const AssetSlice* find_slice(const Asset& asset, int index) {
  const auto found = std::find_if(asset.slices.begin(), asset.slices.end(),
                                  [&](const AssetSlice& slice) { return slice.index == index; });
  return found == asset.slices.end() ? nullptr : &*found;
}

}  // namespace

Result<std::vector<std::unique_ptr<const Sheet>>> place_slices(const Scene& scene,
                                                               const Asset& asset,
                                                               const std::string& name) {
  std::vector<const AssetSlice*> slices;
  for (const SceneSlice& wanted : scene.slices) {
    const std::string where = name + ": slice " + std::to_string(wanted.index);
    const AssetSlice* slice = find_slice(asset, wanted.index);
    if (slice == nullptr) {
      return refused(where + ": the asset has no such slice" +
                     (asset.slices.empty()
                          ? std::string(" (it has none)")
                          : " (it has " + std::to_string(asset.slices.front().index) + " to " +
                                std::to_string(asset.slices.back().index) + ")"));
    }
    if (slice->mesh.triangles.empty()) return refused(where + ": has no material");
    if (const Result<void> valid = check_mesh(slice->mesh); !valid) {
      return refused(where + ": " + valid.error().message);
    }
    slices.push_back(slice);
  }

  PlanarTransform transform;
  transform.lattice = asset.lattice;
  transform.at_m = Eigen::Vector2d(scene.placement.at_m.data());
  const std::array<double, 2> anchor_mm = scene.placement.anchor_mm.value_or(
      scene.placement.anchor_mm ? std::array<double, 2>{}
                                : centroid_mm(slices.front()->mesh, asset.lattice));
  transform.anchor_mm = Eigen::Vector2d(anchor_mm.data());
  const double rotation_rad = scene.placement.rotation_deg * std::numbers::pi / 180;
  transform.cosine = std::cos(rotation_rad);
  transform.sine = std::sin(rotation_rad);

  // An upright tool over the anchor must survive the rounding with all of its corners.
  Pose T_device_plate;
  T_device_plate.p_m.head<2>() = transform.at_m;
  const Tool tool = make_tool(scene.tool);
  T_device_plate.p_m -= tool.tip_plate_m;
  if (outline_on_lattice(tool, T_device_plate, transform).size < scene.tool.sides) {
    return refused(name + ": the scene's tool has corners too close for the asset's lattice of " +
                   std::to_string(asset.lattice.step_mm()) + " mm");
  }

  std::vector<std::unique_ptr<const Sheet>> sheets;
  for (std::size_t i = 0; i < slices.size(); ++i) {
    auto sheet = std::make_unique<Sheet>();
    sheet->slice_index = slices[i]->index;
    sheet->z_m = scene.slices[i].z_m;
    sheet->transform = transform;
    sheet->mesh = slices[i]->mesh;
    sheet->grid = TriangleGrid(sheet->mesh);
    sheets.push_back(std::move(sheet));
  }
  std::sort(sheets.begin(), sheets.end(),
            [](const auto& a, const auto& b) { return a->z_m > b->z_m; });
  return sheets;
}

std::unique_ptr<const Sheet> with_mesh(const Sheet& sheet, SliceMesh mesh) {
  auto next = std::make_unique<Sheet>();
  next->slice_index = sheet.slice_index;
  next->z_m = sheet.z_m;
  next->transform = sheet.transform;
  next->mesh = std::move(mesh);
  next->grid = TriangleGrid(next->mesh);
  next->cuts = sheet.cuts + 1;
  return next;
}

double overlap_fraction(const Sheet& sheet, const LatticeOutline& tool,
                        std::span<const LatticeOutline> holes) noexcept {
  if (tool.size < 3) return 0;
  const LatticePoint origin = tool.points[0];
  Piece whole, first, second;
  LatticeBox box{origin, origin};
  whole.size = tool.size;
  for (int i = 0; i < tool.size; ++i) {
    const LatticePoint p = tool.points[i];
    whole.points[i] = relative(p, origin);
    box.lowest = {std::min(box.lowest.x, p.x), std::min(box.lowest.y, p.y)};
    box.highest = {std::max(box.highest.x, p.x), std::max(box.highest.y, p.y)};
  }
  double doubled_overlap = 0;
  sheet.grid.for_each(sheet.mesh, box, [&](std::uint32_t index) {
    const Triangle& t = sheet.mesh.triangles[index];
    const Eigen::Vector2d a = relative(sheet.mesh.vertices[t[0]], origin);
    const Eigen::Vector2d b = relative(sheet.mesh.vertices[t[1]], origin);
    const Eigen::Vector2d c = relative(sheet.mesh.vertices[t[2]], origin);
    clip(whole, a, b, first);
    clip(first, b, c, second);
    clip(second, c, a, first);
    if (first.size > 0) doubled_overlap += doubled_area_outside(first, holes, origin);
  });
  const double fraction = doubled_overlap / doubled_area(whole);
  if (!(fraction > kSnap)) return 0;
  return fraction > 1 - kSnap ? 1 : fraction;
}

}  // namespace trocar::runtime
