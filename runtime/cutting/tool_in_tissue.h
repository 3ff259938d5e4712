// SPDX-License-Identifier: Apache-2.0
// What the cutting law needs of a tool in a tissue: the tissue is known per area, perimeter and
// wall, the tool by its shape, so that different tools in the same bone differ as they should.
//
// Contract (tests/runtime/cutting/tool_in_tissue_test.cpp):
//  1. Tip: strength = share * (pressure * A * (1 + mu cot(half angle)) + tearing * torn length). A
//  is
//     the cross-section that is displaced: the disc, of a hollow tool the ring. The factor is the
//     friction of the tip's faces on material that presses with the same pressure everywhere; it is
//     the same for a cone, a pyramid and a bevel.
//  2. Torn length: the outline of a flat or hollow tip, which stamps a ring out of the material; of
//     a tip that is a point, the crack that the wedge opens (Shergold and Fleck, Proc. R. Soc. A
//     460, 2004): a diameter for a cone or bevel, a radius for each edge of a pyramid.
//  3. Twist: with the slice-push ratio xi = twist * R / feed the tearing falls by 1 / (1 + xi^2)
//  and
//     takes a moment of xi / (1 + xi^2) of it times R (Atkins, Xu and Jeronimidis, J. Mater. Sci.
//     39, 2004); friction on the faces turns with the direction of slip, 1 / sqrt(1 + xi^2). The
//     pressure stays. xi is at most kMostSlicePush.
//  4. Tip stiffness: a rigid flat punch on an elastic half-space, 2 R E / (1 - nu^2).
//  5. Friction acts on the outer wall, of a hollow tool on its core too. Walls press on the
//     tool's projected width, 2 R.
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
  double inner_radius_m = 0;  ///< of a hollow tool
  /// Between the axis and the faces of a tip; pi / 2: flat.
  double half_angle_rad = 0.5236;
};

struct CutMaterial {
  double strength_Pa = 0;      ///< pressure under a flat punch at which it fails
  double tearing_N_per_m = 0;  ///< of torn length: energy a new area (J/m^2)
  double face_friction = 0;    ///< coefficient, of the tip's faces
  double modulus_Pa = 0, poisson = 0.3;
  double friction_Pa = 0;          ///< of the wall along the shaft, at which it slides
  double presliding_Pa_per_m = 0;  ///< stiffness of that friction before
  double wall_Pa_per_m = 0;        ///< stiffness of the wall sideways
  double lateral_strength_Pa = 0;  ///< of the wall, at which it yields
};

/// The first value that cannot be, as text without a full stop; none: all can be.
std::optional<std::string_view> error_of(const ToolShape& tool) noexcept;
std::optional<std::string_view> error_of(const CutMaterial& tissue) noexcept;

inline constexpr double kMostSlicePush = 10;
/// How the tool is turned while it is pushed: slice-push ratio of the tool's outline, at least 0,
/// at most kMostSlicePush; 0 without twist.
double slice_push(const ToolShape& tool, double twist_rad_per_s, double feed_m_per_s) noexcept;

double displaced_area_m2(const ToolShape& tool) noexcept;
double torn_length_m(const ToolShape& tool) noexcept;

/// In the words of CuttingSlab and CuttingOptions.
struct ToolInTissue {
  double strength_N = 0;  ///< of the front
  double twist_Nm = 0;    ///< moment that the twist takes for the tearing at that strength
  double tip_N_per_m = 0;
  double friction_N_per_m = 0, presliding_m = 0;
  double wall_N_per_m2 = 0, wall_strength_N_per_m = 0;
};

/// `share`: of the outline that is over material not yet cut. The tool and tissue must be without
/// error.
ToolInTissue tool_in_tissue(const ToolShape& tool, const CutMaterial& tissue, double share = 1,
                            double slice_push = 0) noexcept;

/// Outer radius of a needle by its gauge (Birmingham wire gauge, ISO 9626); none: not in the table.
std::optional<double> gauge_radius_m(int gauge) noexcept;

}  // namespace trocar::runtime
