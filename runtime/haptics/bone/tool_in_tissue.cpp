// SPDX-License-Identifier: Apache-2.0
#include "runtime/haptics/bone/tool_in_tissue.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <utility>

namespace trocar::runtime {
namespace {

constexpr double kPi = std::numbers::pi;

constexpr std::array<std::pair<ToolKind, std::string_view>, 5> kNames{{
    {ToolKind::kNeedleBevel, "needle-bevel"},
    {ToolKind::kNeedleConical, "needle-conical"},
    {ToolKind::kNeedleDiamond, "needle-diamond"},
    {ToolKind::kTrocar, "trocar"},
    {ToolKind::kJamshidi, "jamshidi"},
}};

}  // namespace

std::string_view name_of(ToolKind kind) noexcept {
  for (const auto& [each, name] : kNames)
    if (each == kind) return name;
  return "unknown";
}

std::optional<ToolKind> find_tool_kind(std::string_view name) noexcept {
  for (const auto& [kind, each] : kNames)
    if (each == name) return kind;
  return std::nullopt;
}

std::optional<std::string_view> error_of(const ToolShape& tool) noexcept {
  if (!(tool.outer_radius_m > 0) || !std::isfinite(tool.outer_radius_m))
    return "the tool's outer radius must be above 0";
  if (!(tool.inner_radius_m >= 0 && tool.inner_radius_m < tool.outer_radius_m))
    return "the tool's inner radius must be at least 0 and less than the outer";
  if ((tool.kind == ToolKind::kJamshidi) != (tool.inner_radius_m > 0))
    return "a jamshidi is hollow (inner radius above 0), other tools are not";
  // Below 3 degrees the tip is a needle's length of its own.
  if (!(tool.half_angle_rad >= kPi / 60 - 1e-9 && tool.half_angle_rad <= kPi / 2 + 1e-9))
    return "the tip's half angle must be within 3 and 90 degrees";
  if (tool.kind == ToolKind::kJamshidi && tool.half_angle_rad < kPi / 2 - 1e-9)
    return "a jamshidi's edge is flat, so its half angle must be 90 degrees";
  return std::nullopt;
}

double slice_push(const ToolShape& tool, double twist_rad_per_s, double feed_m_per_s) noexcept {
  const double across = std::abs(twist_rad_per_s) * tool.outer_radius_m;
  if (!(across > 0)) return 0;
  const double along = std::max(feed_m_per_s, 0.0);
  return across >= kMaxSlicePush * along ? kMaxSlicePush : across / along;
}

bool is_flat(const ToolShape& tool) noexcept {
  return tool.inner_radius_m > 0 || tool.half_angle_rad >= kPi / 2;
}

double displaced_area_m2(const ToolShape& tool) noexcept {
  return kPi *
         (tool.outer_radius_m * tool.outer_radius_m - tool.inner_radius_m * tool.inner_radius_m);
}

double torn_length_m(const ToolShape& tool) noexcept {
  if (is_flat(tool)) return 2 * kPi * (tool.outer_radius_m + tool.inner_radius_m);
  if (tool.kind == ToolKind::kNeedleDiamond) return 4 * tool.outer_radius_m;
  if (tool.kind == ToolKind::kTrocar) return 3 * tool.outer_radius_m;
  return 2 * tool.outer_radius_m;
}

ToolInTissue tool_in_tissue(const ToolShape& tool, const CutMaterial& tissue, double share,
                            double slice_push) noexcept {
  const double R = tool.outer_radius_m, around = 2 * kPi * (R + tool.inner_radius_m);
  const double xi2 = slice_push * slice_push;
  const double faces =
      is_flat(tool) ? 0 : tissue.face_friction / std::tan(tool.half_angle_rad) / std::sqrt(1 + xi2);
  const double tearing = share * tissue.tearing_N_per_m * torn_length_m(tool) / (1 + xi2);
  ToolInTissue out;
  const double r = tool.inner_radius_m, lever_m = 2 * (R * R + R * r + r * r) / (3 * (R + r));
  const double pressed_N = share * tissue.strength_Pa * displaced_area_m2(tool);
  out.strength_N = pressed_N * (1 + faces) + tearing;
  out.torsion_Nm = slice_push * tearing * R + tissue.face_friction * pressed_N /
                                                  std::sin(tool.half_angle_rad) * lever_m *
                                                  slice_push / std::sqrt(1 + xi2);
  if (tool.kind == ToolKind::kNeedleBevel && !is_flat(tool))
    out.lateral_N =
        pressed_N * std::max(1 / std::tan(tool.half_angle_rad) - tissue.face_friction, 0.0);
  out.tip_N_per_m = 2 * R * tissue.modulus_Pa / (1 - tissue.poisson * tissue.poisson);
  out.friction_N_per_m = tissue.friction_Pa * around;
  out.wall_N_per_m2 = tissue.wall_Pa_per_m * 2 * R;
  out.wall_strength_N_per_m = tissue.lateral_strength_Pa * 2 * R;
  return out;
}

}  // namespace trocar::runtime
