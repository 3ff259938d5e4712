// SPDX-License-Identifier: Apache-2.0
#include "runtime/haptics/sheet.h"

namespace trocar::runtime {
namespace {

constexpr double kHeightRounding_m = 1e-12;  // rounding error of a difference of heights
constexpr double kMaxHeight_m = 1;           // largest distance of a slice from {B}'s origin

/// Centroid of the material in mm.
std::array<double, 2> centroid_mm(const SliceMesh& mesh, const Lattice& lattice) {
  const LatticePoint origin = mesh.vertices.front();
  Eigen::Vector2d sum = Eigen::Vector2d::Zero();
  double area = 0;
  for (const Triangle& t : mesh.triangles) {
    const Eigen::Vector2d a = offset_in_steps(mesh.vertices[t[0]], origin);
    const Eigen::Vector2d b = offset_in_steps(mesh.vertices[t[1]], origin);
    const Eigen::Vector2d c = offset_in_steps(mesh.vertices[t[2]], origin);
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

// A coverage within kSnap of 0 or 1 is set to 0 or 1. The sum over triangles has an error of about 1e-13.
constexpr double kSnap = 1e-9;

/// A counter-clockwise polygon relative to a corner of the tool. Clipping to a half plane adds at most one
/// vertex to a convex polygon, and at most half its number of vertices to any polygon. So the capacity
/// suffices for the tool clipped to a triangle, and for a convex piece of the tool clipped to all pieces
/// of all holes.
struct Polygon {
  static constexpr int kCapacity =
      kMaxToolSides + 3 + kMaxPendingHoles * (kMaxToolSides + 2 * kMaxToolPieces);
  int size = 0;
  std::array<Eigen::Vector2d, kCapacity> points;
};
static_assert(Polygon::kCapacity >= kMaxToolSides * 27 / 8);

/// Sums of the doubled area and of six times the first moment. The terms are summed as integers, in units
/// of about 2^-56 of the tool's box, so the sum has the same bits in any order.
class Moments {
 public:
  /// `doubled_area` and `reach` (the largest |coordinate|) of a box around all pieces.
  Moments(double doubled_area, double reach) noexcept
      : area_unit_(unit(doubled_area)), first_unit_(unit(3 * doubled_area * reach)) {}

  void add(const Polygon& polygon) noexcept {
    for (int i = 2; i < polygon.size; ++i) {
      const Eigen::Vector2d &o = polygon.points[0], &p = polygon.points[i - 1],
                            &q = polygon.points[i];
      const Eigen::Vector2d a = p - o, b = q - o;
      const double doubled = a.x() * b.y() - a.y() * b.x();
      const Eigen::Vector2d first = doubled * (o + p + q);
      area_ += std::llrint(doubled / area_unit_);
      first_x_ += std::llrint(first.x() / first_unit_);
      first_y_ += std::llrint(first.y() / first_unit_);
    }
  }
  double area() const noexcept { return static_cast<double>(area_) * area_unit_; }
  Eigen::Vector2d centroid() const noexcept {
    const Eigen::Vector2d first(static_cast<double>(first_x_), static_cast<double>(first_y_));
    return first_unit_ / (3 * area()) * first;
  }

 private:
  // Returns a power of two, so that dividing by it is exact. Seven bits are spare for polygons that
  // overlap themselves, whose terms are larger than their sum.
  static double unit(double most) noexcept {
    int exponent = 0;
    std::frexp(most, &exponent);
    return std::ldexp(1.0, exponent - 56);
  }
  double area_unit_, first_unit_;
  std::int64_t area_ = 0, first_x_ = 0, first_y_ = 0;
};

/// Clips a polygon to the left side of a -> b (Sutherland and Hodgman, one plane). If a polygon
/// that is not convex falls into parts, the parts stay joined by edges along the line, which cancel
/// in the moments.
void clip(const Polygon& polygon, const Eigen::Vector2d& a, const Eigen::Vector2d& b,
          Polygon& result) noexcept {
  result.size = 0;
  const Eigen::Vector2d d = b - a;
  const auto side = [&](const Eigen::Vector2d& p) {
    return d.x() * (p.y() - a.y()) - d.y() * (p.x() - a.x());
  };
  for (int i = 0; i < polygon.size; ++i) {
    const Eigen::Vector2d& p = polygon.points[i];
    const Eigen::Vector2d& q = polygon.points[i + 1 == polygon.size ? 0 : i + 1];
    const double at_p = side(p), at_q = side(q);
    // Because of rounding, a convex polygon can cross a line more than twice, by about one rounding error.
    // Then the capacity bounds the size, and the loss is of the order of that error.
    if (at_p >= 0 && result.size < Polygon::kCapacity) result.points[result.size++] = p;
    if (((at_p > 0 && at_q < 0) || (at_p < 0 && at_q > 0)) && result.size < Polygon::kCapacity)
      result.points[result.size++] = p + (at_p / (at_p - at_q)) * (q - p);
  }
  if (result.size < 3) result.size = 0;
}

/// All convex pieces of all holes, as one list.
struct Holes {
  const Tool& tool;
  std::span<const LatticeOutline> outlines;
  LatticePoint origin;
  int size() const noexcept { return static_cast<int>(outlines.size()) * tool.pieces; }
  const ConvexPiece& piece(int k) const noexcept { return tool.piece[k % tool.pieces]; }
  Eigen::Vector2d corner(int k, int i) const noexcept {
    return offset_in_steps(
        outlines[static_cast<std::size_t>(k / tool.pieces)].points[piece(k).corner[i]], origin);
  }
};

/// Adds the part of a convex polygon outside the union of the holes from the k-th on. It cuts
/// off, edge by edge, the disjoint convex parts outside the k-th hole, and treats each of them
/// with the remaining holes.
void add_outside(const Polygon& polygon, const Holes& holes, int k, Moments& moments) noexcept {
  if (k == holes.size()) return moments.add(polygon);
  const int sides = holes.piece(k).size;
  Polygon rest = polygon, outside, inside;
  for (int i = 0; i < sides && rest.size > 0; ++i) {
    const Eigen::Vector2d a = holes.corner(k, i), b = holes.corner(k, i + 1 == sides ? 0 : i + 1);
    clip(rest, b, a, outside);
    if (outside.size > 0) add_outside(outside, holes, k + 1, moments);
    clip(rest, a, b, inside);
    std::swap(rest, inside);
  }
}

/// The tool's outline relative to its first corner.
Polygon whole_outline(const LatticeOutline& outline) noexcept {
  Polygon whole;
  whole.size = outline.size;
  for (int i = 0; i < outline.size; ++i)
    whole.points[i] = offset_in_steps(outline.points[i], outline.points[0]);
  return whole;
}

/// Whether one edge of a convex outline has the whole triangle on its outer side, with some distance, so that they
/// have no area in common.
bool is_beyond_an_edge(const Polygon& convex,
                       const std::array<Eigen::Vector2d, 3>& corner) noexcept {
  constexpr double kDistance_steps = 1e-3;
  for (int i = 0; i < convex.size; ++i) {
    const Eigen::Vector2d& a = convex.points[i];
    const Eigen::Vector2d d = convex.points[i + 1 == convex.size ? 0 : i + 1] - a;
    const auto side = [&](const Eigen::Vector2d& p) {
      return d.x() * (p.y() - a.y()) - d.y() * (p.x() - a.x());
    };
    const double limit = -kDistance_steps * (std::abs(d.x()) + std::abs(d.y()));
    if (side(corner[0]) < limit && side(corner[1]) < limit && side(corner[2]) < limit) return true;
  }
  return false;
}

/// The k-th convex piece of the tool's outline.
Polygon convex_part(const Tool& tool, int k, const Polygon& whole) noexcept {
  Polygon part;
  part.size = tool.piece[k].size;
  for (int i = 0; i < part.size; ++i)
    part.points[i] = whole.points[tool.piece[k].corner[i]];
  return part;
}

/// Returns empty sums whose units suit convex parts of that outline.
Moments moments_of_parts(const Polygon& whole) noexcept {
  double reach = 0;
  for (int i = 0; i < whole.size; ++i)
    reach = std::max(reach, whole.points[i].cwiseAbs().maxCoeff());
  return {4 * reach * reach, reach};  // values of the square around the origin with this half side
}

using Eigen::Vector2d;

/// The nodes of a raster.
struct Raster {
  double left_mm, bottom_mm, spacing_mm;
  int columns, rows;

  /// First node at or behind a coordinate, and last node at or before it, within the raster.
  static int first(double mm, double from_mm, double spacing_mm) {
    return std::max(0, static_cast<int>(std::ceil((mm - from_mm) / spacing_mm)));
  }
  static int last(double mm, double from_mm, double spacing_mm, int count) {
    return std::min(count - 1, static_cast<int>(std::floor((mm - from_mm) / spacing_mm)));
  }
  std::size_t index(int column, int row) const {
    return static_cast<std::size_t>(row) * static_cast<std::size_t>(columns) +
           static_cast<std::size_t>(column);
  }
  Vector2d node(int column, int row) const {
    return {left_mm + column * spacing_mm, bottom_mm + row * spacing_mm};
  }
};

/// Lowers the squared distances of the nodes within the reach of an edge.
void approach(const Raster& raster, const Vector2d& a, const Vector2d& b,
              std::vector<float>& squared_mm2) {
  constexpr double kReach_mm = EdgeDistance::kReach_mm;
  const Vector2d ab = b - a, low = a.cwiseMin(b).array() - kReach_mm,
                 high = a.cwiseMax(b).array() + kReach_mm;
  const double per_length2 = 1 / ab.squaredNorm(), h = raster.spacing_mm;
  const int right = Raster::last(high.x(), raster.left_mm, h, raster.columns),
            top = Raster::last(high.y(), raster.bottom_mm, h, raster.rows);
  for (int r = Raster::first(low.y(), raster.bottom_mm, h); r <= top; ++r) {
    for (int c = Raster::first(low.x(), raster.left_mm, h); c <= right; ++c) {
      const Vector2d p = raster.node(c, r) - a;
      const double part = std::clamp(p.dot(ab) * per_length2, 0.0, 1.0);
      float& squared = squared_mm2[raster.index(c, r)];
      squared = std::min(squared, static_cast<float>((p - part * ab).squaredNorm()));
    }
  }
}

/// Notes in each row where an edge crosses the line through its nodes.
void cross_rows(const Raster& raster, Vector2d a, Vector2d b,
                std::vector<std::vector<double>>& crossings_mm) {
  if (a.y() > b.y()) std::swap(a, b);
  const double h = raster.spacing_mm;
  for (int r = Raster::first(a.y(), raster.bottom_mm, h); r < raster.rows; ++r) {
    const double y_mm = raster.bottom_mm + r * h;
    if (!(y_mm < b.y())) break;
    const double part = (y_mm - a.y()) / (b.y() - a.y());
    crossings_mm[static_cast<std::size_t>(r)].push_back(a.x() + part * (b.x() - a.x()));
  }
}

}  // namespace

void Sheet::index_mesh() {
  grid = TriangleGrid(mesh);
  boundary_grid = TriangleGrid(mesh, GridTriangles::kBoundary);
}

std::vector<int> used_slices(const Scene& scene) {
  std::vector<int> indices;
  for (const SceneSlice& slice : scene.slices)
    indices.push_back(slice.index);
  if (const auto& body = scene.body) {
    for (int index = body->from; index <= body->to; ++index)
      indices.push_back(index);
  }
  return indices;
}

Result<void> place_body(Scene& scene, const Asset& asset, const std::string& name) {
  if (!scene.body) return {};
  const SceneBody& body = *scene.body;
  std::vector<const AssetSlice*> slices;
  for (const AssetSlice& slice : asset.slices) {
    if (slice.index >= body.from && slice.index <= body.to && !slice.mesh.triangles.empty())
      slices.push_back(&slice);
  }
  const std::string where =
      name + ": body of slices " + std::to_string(body.from) + " to " + std::to_string(body.to);
  if (slices.size() < 2) return refused(where + ": fewer than two of them have material");
  std::sort(slices.begin(), slices.end(),
            [](const AssetSlice* a, const AssetSlice* b) { return a->z_mm > b->z_mm; });
  scene.slices.clear();
  for (std::size_t i = 0; i < slices.size(); ++i) {
    const double below_m = (slices.front()->z_mm - slices[i]->z_mm) * 1e-3;
    if (i > 0) {
      const std::string pair = ": slices " + std::to_string(slices[i - 1]->index) + " and " +
                               std::to_string(slices[i]->index);
      const double gap_m = (slices[i - 1]->z_mm - slices[i]->z_mm) * 1e-3;
      if (!(gap_m >= kMinSliceGap_m - kHeightRounding_m))
        return refused(where + pair + " are less than 0.1 mm apart");
      const Eigen::Matrix3d a = slices[i - 1]->T_lps_plane.linear(),
                            b = slices[i]->T_lps_plane.linear();
      if (!(std::abs(a.col(2).normalized().dot(b.col(2).normalized())) > 1 - 1e-6))
        return refused(where + pair + " are not parallel");
    }
    if (!(body.top_z_m - below_m >= -kMaxHeight_m))
      return refused(where + ": reaches below -1 m; give a higher top_z_m or fewer slices");
    SceneSlice slice;
    slice.index = slices[i]->index;
    slice.z_m = body.top_z_m - below_m;
    scene.slices.push_back(slice);
  }
  return {};
}

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
    if (const Result<void> valid = check_mesh(slice->mesh); !valid)
      return refused(where + ": " + valid.error().message);
    slices.push_back(slice);
  }

  PlanarTransform transform;
  transform.lattice = asset.lattice;
  transform.at_m = Eigen::Vector2d(scene.placement.at_m.data());
  const std::array<double, 2> anchor_mm = scene.placement.anchor_mm
                                              ? *scene.placement.anchor_mm
                                              : centroid_mm(slices.front()->mesh, asset.lattice);
  transform.anchor_mm = Eigen::Vector2d(anchor_mm.data());
  const double rotation_rad = scene.placement.rotation_deg * std::numbers::pi / 180;
  transform.cosine = std::cos(rotation_rad);
  transform.sine = std::sin(rotation_rad);

  // The tool's outlines must be simple polygons even after rounding to the lattice.
  const Tool tool = make_tool(scene.tool);
  if (smallest_clearance_m(tool) < kMinClearance * asset.lattice.step_m()) {
    return refused(name + ": the scene's tool has corners too close for the asset's lattice of " +
                   std::to_string(asset.lattice.step_mm()) + " mm");
  }
  if (tool.pieces == 0) {
    return refused(name + ": the scene's tool has more than " + std::to_string(kMaxToolPieces) +
                   " convex parts");
  }

  std::vector<std::unique_ptr<const Sheet>> sheets;
  for (std::size_t i = 0; i < slices.size(); ++i) {
    auto sheet = std::make_unique<Sheet>();
    sheet->slice_index = slices[i]->index;
    sheet->z_m = scene.slices[i].z_m;
    sheet->tissue = choose_tissue(scene, scene.slices[i], asset, *slices[i]).tissue;
    sheet->transform = transform;
    sheet->mesh = std::move(*make_sheet_mesh(slices[i]->mesh, kSpareVertices, kSpareTriangles));
    sheet->index_mesh();
    if (!slices[i]->hu.empty())
      sheet->hu = std::make_shared<const std::vector<float>>(slices[i]->hu);
    if (traits_of(scene.force_law.kind).uses_bone_volume) {
      sheet->field = std::make_shared<const SliceField>(
          slices[i]->mesh, slices[i]->hu, asset.lattice, asset.hu.find(slices[i]->index));
      sheet->edge = std::make_shared<const EdgeDistance>(slices[i]->pslg, asset.lattice);
    }
    sheets.push_back(std::move(sheet));
  }
  std::sort(sheets.begin(), sheets.end(),
            [](const auto& a, const auto& b) { return a->z_m > b->z_m; });
  return sheets;
}

Pose over_anchor(const Sheet& sheet, const Tool& tool) noexcept {
  Pose T_device_plate;
  T_device_plate.p_m << sheet.transform.at_m, sheet.z_m;
  T_device_plate.p_m -= tool.tip_plate_m;
  return T_device_plate;
}

Overlap overlap(const Sheet& sheet, const Tool& tool, const LatticeOutline& outline,
                std::span<const LatticeOutline> holes) noexcept {
  Overlap result;
  if (outline.size < 3 || outline.size != tool.sides) return result;
  const LatticePoint origin = outline.points[0];
  const Polygon whole = whole_outline(outline);
  Polygon first, second;
  Moments covered = moments_of_parts(whole), all = covered;
  const Holes pending{tool, holes, origin};
  const auto add = [&](const Polygon& part, const std::array<Eigen::Vector2d, 3>& corner) {
    clip(part, corner[0], corner[1], first);
    clip(first, corner[1], corner[2], second);
    clip(second, corner[2], corner[0], first);
    if (first.size > 0) add_outside(first, pending, 0, covered);
  };
  sheet.grid.for_each(sheet.mesh, box_around(outline), [&](std::uint32_t index) {
    const Triangle& t = sheet.mesh.triangles[index];
    const std::array<Eigen::Vector2d, 3> corner{offset_in_steps(sheet.mesh.vertices[t[0]], origin),
                                                offset_in_steps(sheet.mesh.vertices[t[1]], origin),
                                                offset_in_steps(sheet.mesh.vertices[t[2]], origin)};
    if (tool.pieces == 1 && is_beyond_an_edge(whole, corner)) return;
    if (holes.empty()) return add(whole, corner);
    for (int k = 0; k < tool.pieces; ++k)  // add_outside() needs convex parts
      add(convex_part(tool, k, whole), corner);
  });

  all.add(whole);
  const Eigen::Vector2d offset(origin.x, origin.y);
  result.coverage = covered.area() / all.area();
  result.centroid_steps = offset + all.centroid();
  if (!(result.coverage > kSnap))
    result.coverage = 0;
  else if (result.coverage > 1 - kSnap)
    result.coverage = 1;
  else
    result.centroid_steps = offset + covered.centroid();
  return result;
}

double outline_outside(const Tool& tool, const LatticeOutline& outline,
                       std::span<const LatticeOutline> holes) noexcept {
  if (outline.size < 3 || outline.size != tool.sides) return 1;
  const Polygon whole = whole_outline(outline);
  Moments outside = moments_of_parts(whole), all = outside;
  const Holes open{tool, holes, outline.points[0]};
  for (int k = 0; k < tool.pieces; ++k)
    add_outside(convex_part(tool, k, whole), open, 0, outside);
  all.add(whole);
  const double share = outside.area() / all.area();
  if (!(share > kSnap)) return 0;
  return share > 1 - kSnap ? 1 : share;
}

EdgeDistance::EdgeDistance(const Pslg& outline, const Lattice& lattice) {
  std::vector<LatticePoint> corners;
  for (const Ring& ring : outline.rings)
    corners.insert(corners.end(), ring.begin(), ring.end());
  if (corners.empty()) return;
  const LatticeBox box = box_around(corners);
  const double step_mm = lattice.step_mm();
  const double width_mm = static_cast<double>(std::int64_t{box.high.x} - box.low.x) * step_mm +
                          2 * kReach_mm,
               height_mm = static_cast<double>(std::int64_t{box.high.y} - box.low.y) * step_mm +
                           2 * kReach_mm;
  spacing_mm_ = std::max(kSpacing_mm, std::sqrt(width_mm * height_mm / kMaxNodes));
  left_mm_ = box.low.x * step_mm - kReach_mm;
  bottom_mm_ = box.low.y * step_mm - kReach_mm;
  columns_ = static_cast<int>(width_mm / spacing_mm_) + 2;
  rows_ = static_cast<int>(height_mm / spacing_mm_) + 2;
  const Raster raster{left_mm_, bottom_mm_, spacing_mm_, columns_, rows_};
  distance_mm_.assign(raster.index(0, rows_), static_cast<float>(kReach_mm * kReach_mm));
  std::vector<std::vector<double>> crossings_mm(static_cast<std::size_t>(rows_));
  for (const Ring& ring : outline.rings) {
    for (std::size_t i = 0; i < ring.size(); ++i) {
      const LatticePoint from = ring[i], to = ring[(i + 1) % ring.size()];
      const Vector2d a = Vector2d(from.x, from.y) * step_mm, b = Vector2d(to.x, to.y) * step_mm;
      approach(raster, a, b, distance_mm_);
      cross_rows(raster, a, b, crossings_mm);
    }
  }
  for (int r = 0; r < rows_; ++r) {
    std::vector<double>& crossed_mm = crossings_mm[static_cast<std::size_t>(r)];
    std::sort(crossed_mm.begin(), crossed_mm.end());
    std::size_t passed = 0;
    for (int c = 0; c < columns_; ++c) {
      while (passed < crossed_mm.size() && crossed_mm[passed] <= raster.node(c, r).x())
        ++passed;
      float& distance = distance_mm_[raster.index(c, r)];
      distance = std::copysign(std::sqrt(distance), passed % 2 == 1 ? 1.0F : -1.0F);
    }
  }
}

EdgeDistance::Sample EdgeDistance::at(const PlanarTransform& transform,
                                      const Vector2d& at_m) const noexcept {
  const Vector2d at_mm = transform.to_lattice(at_m) * transform.lattice.step_mm();
  const double x = (at_mm.x() - left_mm_) / spacing_mm_, y = (at_mm.y() - bottom_mm_) / spacing_mm_;
  Sample out;
  if (!(x >= 0 && y >= 0 && x < columns_ - 1 && y < rows_ - 1)) return out;
  const int c = static_cast<int>(x), r = static_cast<int>(y);
  const auto* low = distance_mm_.data() + static_cast<std::ptrdiff_t>(r) * columns_ + c;
  const auto* high = low + columns_;
  const double u = x - c, v = y - r;
  const double bottom = low[0] + u * (low[1] - low[0]), top = high[0] + u * (high[1] - high[0]);
  out.distance_m = 1e-3 * (bottom + v * (top - bottom));
  const double by_x = ((1 - v) * (low[1] - low[0]) + v * (high[1] - high[0])) / spacing_mm_,
               by_y = (top - bottom) / spacing_mm_;
  out.gradient = {transform.cosine * by_x - transform.sine * by_y,
                  transform.sine * by_x + transform.cosine * by_y};
  return out;
}

}  // namespace trocar::runtime
