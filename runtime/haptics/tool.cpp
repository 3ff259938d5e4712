// SPDX-License-Identifier: Apache-2.0
#include "runtime/haptics/tool.h"

#include <limits>

namespace trocar::runtime {
namespace {

using Corners = std::vector<Eigen::Vector2d>;
using Piece = std::vector<std::uint8_t>;

double orientation(const Eigen::Vector2d& a, const Eigen::Vector2d& b, const Eigen::Vector2d& c) {
  return (b.x() - a.x()) * (c.y() - a.y()) - (b.y() - a.y()) * (c.x() - a.x());
}

bool is_convex(const Corners& p, const Piece& piece) {
  const std::size_t n = piece.size();
  for (std::size_t i = 0; i < n; ++i) {
    if (orientation(p[piece[i]], p[piece[(i + 1) % n]], p[piece[(i + 2) % n]]) < 0) return false;
  }
  return true;
}

// Triangulates a simple counter-clockwise polygon by ear clipping; empty if it is not simple.
std::vector<Piece> ears(const Corners& p) {
  std::vector<Piece> out;
  Piece rest;
  for (std::size_t i = 0; i < p.size(); ++i)
    rest.push_back(static_cast<std::uint8_t>(i));
  while (rest.size() > 3) {
    const std::size_t n = rest.size();
    std::size_t ear = n;
    for (std::size_t i = 0; i < n && ear == n; ++i) {
      const auto &a = p[rest[(i + n - 1) % n]], &b = p[rest[i]], &c = p[rest[(i + 1) % n]];
      if (orientation(a, b, c) <= 0) continue;
      bool is_free = true;
      for (std::size_t j = 2; j + 1 < n; ++j) {
        const Eigen::Vector2d& q = p[rest[(i + j) % n]];
        is_free = is_free && !(orientation(a, b, q) >= 0 && orientation(b, c, q) >= 0 &&
                               orientation(c, a, q) >= 0);
      }
      if (is_free) ear = i;
    }
    if (ear == n) return {};  // not simple
    out.push_back({rest[(ear + n - 1) % n], rest[ear], rest[(ear + 1) % n]});
    rest.erase(rest.begin() + static_cast<std::ptrdiff_t>(ear));
  }
  out.push_back(rest);
  return out;
}

// Returns the union of two pieces that share an edge; empty if they share none.
Piece joined(const Piece& a, const Piece& b) {
  for (std::size_t i = 0; i < a.size(); ++i) {
    for (std::size_t j = 0; j < b.size(); ++j) {
      if (a[i] != b[(j + 1) % b.size()] || a[(i + 1) % a.size()] != b[j]) continue;
      Piece out;
      for (std::size_t k = 1; k <= a.size(); ++k)
        out.push_back(a[(i + k) % a.size()]);
      for (std::size_t k = 2; k < b.size(); ++k)
        out.push_back(b[(j + k) % b.size()]);
      return out;
    }
  }
  return {};
}

std::vector<Piece> convex_pieces(const Corners& p) {
  Piece all;
  for (std::size_t i = 0; i < p.size(); ++i)
    all.push_back(static_cast<std::uint8_t>(i));
  if (is_convex(p, all)) return {all};
  std::vector<Piece> pieces = ears(p);
  for (std::size_t i = 0; i < pieces.size(); ++i) {
    for (std::size_t j = i + 1; j < pieces.size();) {
      const Piece both = joined(pieces[i], pieces[j]);
      if (both.empty() || !is_convex(p, both)) {
        ++j;
        continue;
      }
      pieces[i] = both;
      pieces.erase(pieces.begin() + static_cast<std::ptrdiff_t>(j));
      j = i + 1;
    }
  }
  return pieces;
}

Corners cross_section(const SceneTool& scene_tool) {
  Corners out;
  const double start_rad = scene_tool.rotation_deg * std::numbers::pi / 180;
  if (scene_tool.outline_m.empty()) {
    for (int i = 0; i < scene_tool.sides; ++i) {
      const double angle_rad = start_rad + 2 * std::numbers::pi * i / scene_tool.sides;
      out.push_back(scene_tool.radius_m *
                    Eigen::Vector2d(std::cos(angle_rad), std::sin(angle_rad)));
    }
  }
  const double cosine = std::cos(start_rad), sine = std::sin(start_rad);
  for (const std::array<double, 2>& p : scene_tool.outline_m)
    out.emplace_back(cosine * p[0] - sine * p[1], sine * p[0] + cosine * p[1]);
  return out;
}

}  // namespace

Tool make_tool(const SceneTool& scene_tool) {
  const double tilt_rad = scene_tool.tilt_deg * std::numbers::pi / 180;
  const double azimuth_rad = scene_tool.tilt_azimuth_deg * std::numbers::pi / 180;
  const Eigen::Quaterniond q_plate_tool(Eigen::AngleAxisd(
      tilt_rad, Eigen::Vector3d(-std::sin(azimuth_rad), std::cos(azimuth_rad), 0)));
  const Corners section = cross_section(scene_tool);
  Tool tool;
  tool.sides = static_cast<int>(section.size());
  tool.tip_plate_m = Eigen::Vector3d(scene_tool.tip_in_plate_m.data());
  tool.axis_plate = q_plate_tool * Eigen::Vector3d::UnitZ();
  const double rotation_rad = scene_tool.rotation_deg * std::numbers::pi / 180;
  tool.side_plate =
      q_plate_tool * Eigen::Vector3d(std::cos(rotation_rad), std::sin(rotation_rad), 0);
  for (std::size_t i = 0; i < section.size(); ++i) {
    tool.corner_plate_m[i] =
        tool.tip_plate_m + q_plate_tool * Eigen::Vector3d(section[i].x(), section[i].y(), 0);
  }
  const std::vector<Piece> pieces = convex_pieces(section);
  if (pieces.size() > kMaxToolPieces) return tool;
  for (const Piece& piece : pieces) {
    ConvexPiece& out = tool.piece[tool.pieces++];
    out.size = static_cast<int>(piece.size());
    std::copy(piece.begin(), piece.end(), out.corner.begin());
  }
  return tool;
}

Eigen::Vector2d PlanarTransform::to_lattice(const Eigen::Vector2d& p_m) const noexcept {
  const Eigen::Vector2d d_mm = (p_m - at_m) * 1e3;
  const Eigen::Vector2d uv_mm(anchor_mm.x() + cosine * d_mm.x() + sine * d_mm.y(),
                              anchor_mm.y() - sine * d_mm.x() + cosine * d_mm.y());
  return uv_mm * std::ldexp(1.0, lattice.bits);
}

Eigen::Vector2d PlanarTransform::to_scene(const Eigen::Vector2d& steps) const noexcept {
  const Eigen::Vector2d d_m = (steps * lattice.step_mm() - anchor_mm) * 1e-3;
  return at_m +
         Eigen::Vector2d(cosine * d_m.x() - sine * d_m.y(), sine * d_m.x() + cosine * d_m.y());
}

Ring to_ring(const LatticeOutline& outline) {
  return Ring(outline.points.begin(), outline.points.begin() + outline.size);
}

LatticeBox box_around(const LatticeOutline& outline) noexcept {
  return box_around(
      std::span<const LatticePoint>(outline.points.data(), static_cast<std::size_t>(outline.size)));
}

bool is_upright(const Tool& tool, const Pose& T_device_plate) noexcept {
  static const double least = std::cos(kMaxTilt_deg * std::numbers::pi / 180) - 1e-9;
  return (T_device_plate.q * tool.axis_plate).z() >= least;
}

Eigen::Vector3d axis_at(const Tool& tool, const Pose& T_device_plate, double z_m) noexcept {
  const Eigen::Vector3d tip_m = T_device_plate * tool.tip_plate_m;
  const Eigen::Vector3d axis = T_device_plate.q * tool.axis_plate;
  return tip_m + (z_m - tip_m.z()) / axis.z() * axis;
}

LatticeOutline outline_on_lattice(const Tool& tool, const Pose& T_device_plate,
                                  const PlanarTransform& transform, double z_m) noexcept {
  LatticeOutline outline;
  if (!is_upright(tool, T_device_plate)) return outline;
  const Eigen::Vector3d axis = T_device_plate.q * tool.axis_plate;
  for (int i = 0; i < tool.sides; ++i) {
    const Eigen::Vector3d corner_m = T_device_plate * tool.corner_plate_m[i];
    const double up_m = (z_m - corner_m.z()) / axis.z();
    const Eigen::Vector2d steps = transform.to_lattice(corner_m.head<2>() + up_m * axis.head<2>());
    // Written so that nan fails as well.
    if (!(steps.cwiseAbs().maxCoeff() <= 0.5 * kMaxCoordinate)) return {};
    outline.points[i] = {static_cast<std::int32_t>(std::lrint(steps.x())),
                         static_cast<std::int32_t>(std::lrint(steps.y()))};
  }
  outline.size = tool.sides;
  return outline;
}

double smallest_clearance_m(const Tool& tool) noexcept {
  double least_m = std::numeric_limits<double>::infinity();
  for (int i = 0; i < tool.sides; ++i) {
    const Eigen::Vector3d& a = tool.corner_plate_m[i];
    const Eigen::Vector3d along = tool.corner_plate_m[(i + 1) % tool.sides] - a;
    for (int j = 0; j < tool.sides; ++j) {
      if (j == i || j == (i + 1) % tool.sides) continue;
      const Eigen::Vector3d to = tool.corner_plate_m[j] - a;
      const double at = std::clamp(to.dot(along) / along.squaredNorm(), 0.0, 1.0);
      least_m = std::min(least_m, (to - at * along).norm());
    }
  }
  return least_m;
}

void enter_hole(const ShaftSection& section, ShaftState& state) noexcept {
  state.in_hole = true;
  state.hole_m = section.at_m.head<2>();
  state.has_hole_position = state.has_last = true;
  state.last_m = section.inserted_m;
  state.spring_m = state.viscous_N = 0;
}

void reset_motion(ShaftState& state) noexcept {
  state.has_hole_position = state.has_last = false;
  state.spring_m = state.viscous_N = 0;
}

Eigen::Vector3d shaft_force(const ShaftTissue& tissue, const ShaftSection& section,
                            double pose_interval_s, ShaftState& state,
                            const PreviousShaft& previous) noexcept {
  if (!state.in_hole) return Eigen::Vector3d::Zero();
  if (!state.has_hole_position) state.hole_m = section.at_m.head<2>();
  state.has_hole_position = true;
  const double moved_m = state.has_last ? section.inserted_m - state.last_m : 0;
  const bool is_steady = state.has_last && previous.ago_s > 0;
  state.has_last = true;
  state.last_m = section.inserted_m;
  state.spring_m = std::clamp(state.spring_m + moved_m, -tissue.presliding_m, tissue.presliding_m);
  if (pose_interval_s > 0) {
    state.viscous_N = is_steady ? tissue.viscous_friction_N_s_per_m *
                                      (section.inserted_m - previous.inserted_m) / previous.ago_s
                                : tissue.viscous_friction_N_s_per_m * moved_m / pose_interval_s;
  }
  const double along_N =
      tissue.dry_friction_N * state.spring_m / tissue.presliding_m + state.viscous_N;
  Eigen::Vector3d force_N = along_N * section.axis;
  force_N.head<2>() -= tissue.rim_stiffness_N_per_m * (section.at_m.head<2>() - state.hole_m);
  return force_N;
}

void add_shaft(const ShaftTissue& tissue, const ShaftSection& section, const ShaftState& state,
               LocalEnvironment& local) noexcept {
  if (!state.in_hole) return;
  const double dry_N_per_m = tissue.dry_friction_N / tissue.presliding_m;
  local.axis = section.axis;
  local.dry_N += dry_N_per_m * state.spring_m;
  local.dry_max_N += tissue.dry_friction_N;
  if (state.spring_m < tissue.presliding_m) local.dry_in_N_per_m += dry_N_per_m;
  if (state.spring_m > -tissue.presliding_m) local.dry_out_N_per_m += dry_N_per_m;
  local.viscous_N_s_per_m += tissue.viscous_friction_N_s_per_m;
  const Eigen::Vector2d aside_m = section.at_m.head<2>() - state.hole_m;
  local.rim_N -= tissue.rim_stiffness_N_per_m * aside_m;
  local.rim_N_per_m += tissue.rim_stiffness_N_per_m;
  local.stored_J += 0.5 * dry_N_per_m * state.spring_m * state.spring_m +
                    0.5 * tissue.rim_stiffness_N_per_m * aside_m.squaredNorm();
}

void shift_shaft(double inserted_m, ShaftState& state) noexcept {
  state.last_m += inserted_m;
}

}  // namespace trocar::runtime
