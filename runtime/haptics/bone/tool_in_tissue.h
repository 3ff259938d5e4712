// SPDX-License-Identifier: Apache-2.0
// Computes the values that the cutting law needs, from a tool and a tissue. The tissue is described
// by values per area, per length of perimeter and per area of wall. The tool is described by its
// shape. So the same tissue gives the right forces for tools of different shapes.
//
// Contract:
//  1. The strength of the tip without twist is
//       coverage * (pressure * A * (1 + mu cot(half angle)) + tearing * torn length).
//     A is the area of the displaced material: a disc, or a ring for a hollow tool. The term mu
//     cot(half angle) stands for the friction on the tip's faces. Here mu is the friction
//     coefficient, and the pressure is the same on all faces. The term is the same for a cone, a
//     pyramid and a bevel. It is 0 for a flat or hollow tip.
//  2. The torn length of a flat or hollow tip is the length of its outline, because the tip stamps
//     a disc or ring out of the material. The torn length of a pointed tip is the length of the
//     crack that the wedge opens (Shergold and Fleck, Proc. R. Soc. A 460, 2004): a diameter for a
//     cone or bevel, and a radius for each edge of a pyramid.
//  3. A tool of radius R that turns at the rate `twist` and advances at the speed `feed` has the
//     slice-push ratio xi = twist * R / feed, at most kMaxSlicePush. Twisting multiplies the
//     tearing force by 1 / (1 + xi^2). Let F be the tearing force without twist. Tearing with twist
//     needs the moment R F xi / (1 + xi^2) (Atkins, Xu and Jeronimidis, J. Mater. Sci. 39, 2004).
//     Friction on the faces acts along the direction of slip, so its component along the axis is
//     multiplied by 1 / sqrt(1 + xi^2). Its component around the axis needs the further moment
//       mu * pressure * A / sin(half angle) * lever * xi / sqrt(1 + xi^2).
//     Here `lever` is the mean lever of a disc or ring, 2 (R^3 - r^3) / (3 (R^2 - r^2)), with the
//     radius r of the bore. The pressure on the tip does not depend on the twist.
//  4. The stiffness of the tip is that of a rigid flat punch of radius R on an elastic half-space:
//     2 R E / (1 - nu^2), with the modulus E and Poisson's ratio nu.
//  5. Friction acts on the outer surface of the shaft and, in a hollow tool, on the surface of the
//     bore too. Walls press on the tool's projected width, 2 R.
//  6. A bevel has one face. Pressure and friction of this face push the tip to the side with the
//     force pressure * A * (cot(half angle) - mu). If mu is larger than cot(half angle), there is
//     no such force. On a cone or pyramid, the lateral forces cancel. Tearing causes no
//     lateral force.
#pragma once

#include <optional>
#include <string_view>

namespace trocar::runtime {

enum class ToolKind {
  kNeedleBevel,
  kNeedleConical,
  kNeedleDiamond,  ///< a pyramid of four faces
  kTrocar,         ///< a pyramid of three faces
  kJamshidi,       ///< a hollow needle with a flat edge, without its stylet
};
std::string_view name_of(ToolKind kind) noexcept;
std::optional<ToolKind> find_tool_kind(std::string_view name) noexcept;

struct ToolShape {
  ToolKind kind = ToolKind::kNeedleConical;
  double outer_radius_m = 1.525e-3;
  double inner_radius_m = 0;  ///< radius of the bore of a hollow tool
  /// Angle between the axis and the faces of the tip; pi / 2: the tip is flat. The tip of a hollow
  /// tool must be flat.
  double half_angle_rad = 0.5236;
};

struct CutMaterial {
  double strength_Pa = 0;      ///< pressure under a flat punch at which the material fails
  double tearing_N_per_m = 0;  ///< tearing force per torn length; equals the work per torn area
  double face_friction = 0;    ///< friction coefficient of the tip's faces
  double modulus_Pa = 0, poisson = 0.3;
  double friction_Pa = 0;          ///< shear stress at which the shaft slides along the hole's wall
  double wall_Pa_per_m = 0;        ///< lateral stiffness of the wall (Winkler foundation)
  double lateral_strength_Pa = 0;  ///< pressure at which the wall yields
};

/// Returns a text, without a full stop, that describes the first invalid value. Returns nothing if
/// all values are valid.
std::optional<std::string_view> error_of(const ToolShape& tool) noexcept;

inline constexpr double kMaxSlicePush = 10;
/// Returns the slice-push ratio: the circumferential speed of the tool's outline divided by the
/// feed, which is the speed along the axis. The ratio is at least 0, at most kMaxSlicePush, and 0
/// without twist.
double slice_push(const ToolShape& tool, double twist_rad_per_s, double feed_m_per_s) noexcept;

/// True if the tip is flat or hollow, so that it stamps its outline out of the material.
bool is_flat(const ToolShape& tool) noexcept;
double displaced_area_m2(const ToolShape& tool) noexcept;
double torn_length_m(const ToolShape& tool) noexcept;

/// Values that describe a tool in a tissue. Each value is meant for the field of CuttingSlab or
/// CuttingOptions that has the same name, with two exceptions: `strength_N` is meant for
/// strength_top_N and strength_bottom_N of a slab, and bone_volume.h computes
/// CuttingTool::bevel_plate from `lateral_N` and `strength_N`.
struct ToolInTissue {
  double strength_N = 0;  ///< force on the tip at which the cutting front advances
  double torsion_Nm = 0;  ///< moment that is needed to turn the tool (contract 3)
  double lateral_N = 0;   ///< lateral force of a bevel while the front advances (contract 6)
  double tip_N_per_m = 0;
  double friction_N_per_m = 0;
  double wall_N_per_m2 = 0, wall_strength_N_per_m = 0;
};

/// Computes these values for a tool and a tissue. `share`: the coverage, which is the fraction of
/// the area of the tool's outline that lies over material that is not yet cut. `slice_push`: result
/// of slice_push(). Preconditions: the tool is valid (error_of()), no value of the tissue is
/// negative, and its Poisson ratio is at most 0.5.
ToolInTissue tool_in_tissue(const ToolShape& tool, const CutMaterial& tissue, double share = 1,
                            double slice_push = 0) noexcept;

}  // namespace trocar::runtime
