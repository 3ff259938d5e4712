// SPDX-License-Identifier: Apache-2.0
// Computes the values that the cutting law needs, from a tool and a tissue. The tissue is described by values per
// area, per length of perimeter and per area of wall, and the tool by its shape, so that different tools in the same
// bone differ correctly.
//
// Contract (tests/runtime/bone_cutting/material/tool_in_tissue_test.cpp):
//  1. Tip: strength = coverage * (pressure * A * (1 + mu cot(half angle)) + tearing * torn length). A is the
//     displaced cross-section: the disc, or the ring of a hollow tool. The factor in brackets is due to friction of
//     the tip's faces against material that presses on all of them with the same pressure. It is the same for a cone,
//     a pyramid and a bevel.
//  2. Torn length: for a flat or hollow tip it is the length of the outline, because the tip stamps a disc or ring out of
//     the material. For a pointed tip it is the length of the crack that the wedge opens (Shergold and Fleck, Proc. R.
//     Soc. A 460, 2004): a diameter for a cone or bevel, and a radius for each edge of a pyramid.
//  3. Twist: the slice-push ratio is xi = twist * R / feed, at most kMaxSlicePush. Twisting multiplies the tearing force
//     by 1 / (1 + xi^2). The moment that it needs is xi / (1 + xi^2) times the tearing force without twist, times R
//     (Atkins, Xu and Jeronimidis, J. Mater. Sci. 39, 2004). Friction on the faces acts along the direction of slip, so
//     its part along the axis is multiplied by 1 / sqrt(1 + xi^2). The pressure does not change.
//  4. Tip stiffness: that of a rigid flat punch on an elastic half-space, 2 R E / (1 - nu^2).
//  5. Friction acts on the outer wall and, in a hollow tool, on the core too. Walls press on the tool's
//     projected width, 2 R.
#pragma once

#include <optional>
#include <string_view>

namespace trocar::runtime {

enum class ToolKind {
  kNeedleBevel,
  kNeedleConical,
  kNeedleDiamond,  ///< a pyramid of four faces
  kTrocar,         ///< a pyramid of three faces
  kJamshidi,       ///< hollow with a flat edge, its stylet out
};
std::string_view name_of(ToolKind kind) noexcept;
std::optional<ToolKind> find_tool_kind(std::string_view name) noexcept;

struct ToolShape {
  ToolKind kind = ToolKind::kNeedleConical;
  double outer_radius_m = 1.525e-3;
  double inner_radius_m = 0;  ///< radius of the bore of a hollow tool
  /// Angle between the axis and the faces of the tip; pi / 2: flat.
  double half_angle_rad = 0.5236;
};

struct CutMaterial {
  double strength_Pa = 0;      ///< pressure under a flat punch at which the material fails
  double tearing_N_per_m = 0;  ///< tearing work per torn length and depth (J/m^2)
  double face_friction = 0;    ///< friction coefficient of the tip's faces
  double modulus_Pa = 0, poisson = 0.3;
  double friction_Pa = 0;          ///< shear stress at which the wall slides along the shaft
  double presliding_Pa_per_m = 0;  ///< stiffness of the friction before it slides
  double wall_Pa_per_m = 0;        ///< lateral stiffness of the wall (Winkler foundation)
  double lateral_strength_Pa = 0;  ///< pressure at which the wall yields
};

/// Describes the first invalid value, as text without a full stop; none: all values are valid.
std::optional<std::string_view> error_of(const ToolShape& tool) noexcept;
std::optional<std::string_view> error_of(const CutMaterial& tissue) noexcept;

inline constexpr double kMaxSlicePush = 10;
/// Slice-push ratio at the tool's outline: the speed of the outline by rotation, divided by the feed. It is at least 0,
/// at most kMaxSlicePush, and 0 without twist.
double slice_push(const ToolShape& tool, double twist_rad_per_s, double feed_m_per_s) noexcept;

/// True if the tip is flat or hollow, so that it stamps its outline out of the material.
bool is_flat(const ToolShape& tool) noexcept;
double displaced_area_m2(const ToolShape& tool) noexcept;
double torn_length_m(const ToolShape& tool) noexcept;

/// Values for the fields of the same names in CuttingSlab and CuttingOptions.
struct ToolInTissue {
  double strength_N = 0;  ///< strength of the front
  double twist_Nm = 0;    ///< moment that the twist needs for the tearing at that strength
  double tip_N_per_m = 0;
  double friction_N_per_m = 0, presliding_m = 0;
  double wall_N_per_m2 = 0, wall_strength_N_per_m = 0;
};

/// `share`: the coverage, which is the fraction of the outline over material not yet cut. Tool and tissue must
/// be valid (error_of()).
ToolInTissue tool_in_tissue(const ToolShape& tool, const CutMaterial& tissue, double share = 1,
                            double slice_push = 0) noexcept;

/// Outer radius of a needle by its gauge (Birmingham wire gauge, ISO 9626); none: not in the table.
std::optional<double> gauge_radius_m(int gauge) noexcept;

}  // namespace trocar::runtime
