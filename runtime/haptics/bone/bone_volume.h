// SPDX-License-Identifier: Apache-2.0
// The bone volume of a scene, its strength, and the resistance of its layers to the tool.
#pragma once

#include <array>
#include <optional>
#include <span>
#include <string_view>
#include <vector>

#include "formats/session/scene.h"
#include "runtime/haptics/bone/cutting_law.h"
#include "runtime/haptics/sheet.h"
#include "runtime/haptics/tool.h"

namespace trocar::runtime {

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

// The strength of bone from CT. A linear calibration maps HU to density, and published laws, chosen by name,
// map density to modulus and strength. Densities are in g/cm^3, moduli and strengths in MPa.
//
// Each law holds for the kind of density that its authors measured, and these kinds differ.
// Quantitative CT (QCT) measures a mineral density against a phantom of K2HPO4. This density is
// about equal to the ash density of the same bone, which is the mineral mass divided by the volume.
// The ash density is 0.6 times the apparent density, which is the wet mass without marrow divided
// by the volume. Here every density states its kind, and a session refuses a calibration whose kind
// is not that of its law.
//
// Sources of the laws, and how they were checked (never against the papers' full texts):
//  - Kopperdahl 2002: the title names quantitative CT. The coefficients of the linear law appear in
//    two public programs for vertebrae. One program uses them with K2HPO4-equivalent density, and
//    the other one calls the density apparent. The power law appears in the first program. Trocar
//    uses both laws with QCT density.
//  - Morgan 2003: the abstract names apparent density, and exponents from 1.49 to 2.18 that depend
//    on the anatomical site. The coefficients for vertebrae appear in the same two programs.
//  - Keller 1994: one public program has the coefficients for ash density of the spine, and other
//    programs use Keller's law for the femur with ash density. Trocar uses the law with ash
//    density.
//
// Contract:
// Values are those of the published formulas. If a formula gives less than 0, the value is 0.

enum class DensityKind { kQct, kAsh, kApparent };
std::string_view name_of(DensityKind kind) noexcept;

/// density = at_0_HU + per_HU * HU. The default is a typical value for scanners at 120 kV (0.8
/// mg/cm^3 of K2HPO4 per HU), not a measurement. `is_assumed` is true if no calibration was given,
/// so that the default is used.
struct HuCalibration {
  double per_HU = 8e-4, at_0_HU = 0;  ///< g/cm^3 per HU, g/cm^3
  DensityKind kind = DensityKind::kQct;
  bool is_assumed = true;
};
/// value = constant + factor * density^exponent
struct DensityLaw {
  double constant = 0, factor = 0, exponent = 1;
};

struct BoneLaw {
  std::string_view name, source;
  DensityLaw modulus_MPa;
  std::optional<DensityLaw>
      strength_MPa;  ///< yield strength in compression; none: the source gives no strength
  DensityKind kind = DensityKind::kQct;
};

/// All laws.
std::span<const BoneLaw> bone_laws() noexcept;
/// The law of that name, or null.
const BoneLaw* find_bone_law(std::string_view name) noexcept;

/// Returns the law's value at a density in g/cm^3. The value is at least 0.
double value_of(const DensityLaw& law, double density) noexcept;

/// Ash density over apparent density (E. Schileo et al., J. Biomech. 41, 2008). There is no conversion
/// from or to QCT density, because each published one holds for one phantom and scanner only.
inline constexpr double kAshOverApparent = 0.598;

// The bone volume of a scene, for one tool: the slabs, the sheet that each slab belongs to, and the
// resistance of each slab to the tool. A sheet is a slice that is placed in the scene, and a slab
// is the bone around it. The slices of the scene's `body` form one solid. In a scene without a
// `body`, slices that are at most kMaxSlabGap_m apart form a solid, and a slice that is farther
// from all others is a slab of thickness 0.
//
// Contract:
//  1. Two successive slices of a solid are neighbours, unless the asset has empty slices (slices
//     without material) between them. The slabs of two neighbours meet half-way, whatever the
//     distance. On a side without a neighbour, a slab extends as far as on its other side. A slab
//     without any neighbour extends, on each side, by half the smallest spacing of the solid's
//     slices. So there is a gap between slabs where slices are empty.
//  2. If a tissue has a CutTissue (strength per area and so on), the functions above compute the
//     values for the tool. A tissue without CutTissue directly states the forces on the scene's
//     tool: the tissue's threshold is the strength against the tip, and the tissue's stiffness
//     is the stiffness against the tip, whatever the tip's shape. If such a tissue states no rim
//     stiffness and its slab has a thickness above 0, the hole's walls have the tissue's threshold
//     and stiffness, each divided by the tool's area, as their strength and stiffness per area.
//  3. Bone pushes a bevelled tip to one side. The ratio of this lateral force to the strength (the
//     length of CuttingTool::bevel_plate) is constant during a session. The ratio is that of the
//     uppermost tissue that has a CutTissue and a strength above 0, at the mean HU of its slice.
//     Without such a tissue, there is no lateral force.
//  4. A cortical shell of thickness `shell_m` lies where the tool enters the bone and where the
//     tool leaves the bone. Slabs within a shell have the shell's strength. Each slice's bone is
//     divided into slabs at all depths at which a shell can end, so that only the strengths of the
//     slabs change when the tool moves, not their depths. A shell can begin at the top and at the
//     bottom of each sheet, and it can extend over several sheets of different thicknesses. The
//     depth at which a shell ends is exact up to kMinPart_m.
//  5. If a tissue takes its strength from HU, the slab where the tool enters the bone and the slab
//     where the tool leaves the bone can contain a thin cortical wall.
//     SceneBody::cortex_HU states the HU of such a wall. A scene without a `body` has no such
//     walls, nor does a scene that states a shell and no cortex_HU.

inline constexpr double kMaxSlabGap_m = 3e-3;
/// Tolerance that is added to kMaxSlabGap_m, so that rounding does not separate two slices whose
/// distance is exactly kMaxSlabGap_m.
inline constexpr double kSlabGapRounding_m = 1e-9;
/// When the bone of a slice is divided into slabs, two depths that differ by at most this length
/// count as one.
inline constexpr double kMinPart_m = 1e-6;
/// Number of holes that the law `cutting` remembers during a session.
inline constexpr std::size_t kMaxRememberedHoles = 32;

/// A sheet's resistance to the tool at full coverage.
struct BoneSheet {
  /// Force on the tip at which the cutting front advances in bone of the slice's mean HU. (This
  /// force is called the strength of the front.)
  double nominal_N = 0;
  double shell_factor = 1;  ///< shell's strength, divided by strength of bone under the tool
  /// Thickness of the shell, and the radius within which no bone supports the shell. Radius 0: bone
  /// supports the shell everywhere.
  double shell_m = 0, shell_free_radius_m = 0;
  double tip_N_per_m = 0;  ///< stiffness of the tip against the front
  /// Law that gives the strength from HU. Null: the strength is that of `material` everywhere.
  const BoneLaw* law = nullptr;
  HuCalibration calibration;
  double pressure_over_yield = 1;  ///< pressure under a flat tip divided by the yield strength
  /// Increase of the shaft's friction per embedded length if pressure_Pa() increases by 1 Pa.
  double friction_N_per_m_Pa = 0;
  double cortex_HU = 0;  ///< HU of cortical walls (contract 5); 0: there are no such walls
  CutMaterial material;  ///< values at the slice's mean HU
  bool states_tool_forces = false;  ///< the tissue states the tool's forces (contract 2)
  int first_slab = 0, slabs = 0;    ///< index of the sheet's first slab, and number of its slabs
  double top_m = 0, bottom_m = 0;   ///< depths of the top and the bottom of the sheet's slabs
  bool meets_above = false, meets_below = false;  ///< a neighbour exists above, below (contract 1)

  /// Pressure at which bone of this HU fails under a flat tip. Precondition: `law` is not null.
  double pressure_Pa(double hu) const noexcept;
  CutMaterial material_at(double hu) const noexcept;  ///< values in bone of this HU
  /// Friction of the shaft per embedded length in bone of this HU. `nominal_N_per_m`: this friction
  /// in bone of the slice's mean HU.
  double friction_N_per_m(double hu, double nominal_N_per_m) const noexcept;
  /// Strength of the shell over bone of this HU. `strength_N`: strength of that bone.
  /// Where nothing supports the shell, its strength is at most that of a thin wall.
  double shell_N(const ToolShape& shape, double hu, double strength_N) const noexcept;
  /// Strength of the front in bone of this HU. `slice_push`: result of slice_push().
  double strength_N(const ToolShape& shape, double hu, double slice_push = 0) const noexcept;
  /// Moment that is needed to turn the tool in bone of this HU (ToolInTissue::torsion_Nm); 0 if the
  /// tissue states the tool's forces. `slice_push`: result of slice_push().
  double torsion_Nm(const ToolShape& shape, double hu, double slice_push) const noexcept;
};

struct BoneVolume {
  Tool tool;
  double radius_m = 0;  ///< radius of the disc that has the area of the tool's cross-section
  ToolShape shape;
  bool twists = false;             ///< SceneForceLaw::twist
  CuttingOptions options;          ///< coupling as the scene states it; choose_coupling() limits it
  double shell_m = 0;              ///< thickness of the cortical shell; 0: there is none
  std::vector<BoneSheet> sheets;   ///< in the order of the session's sheets: topmost first
  std::vector<CuttingSlab> slabs;  ///< strength of each slab: nominal_N of its sheet
  std::vector<int> sheet_of_slab;  ///< index of each slab's sheet
  std::vector<SoftLayer> layers;   ///< uppermost first
  /// Largest stiffness that the tool can meet along its axis (tip, soft layers and friction in
  /// bone), and across its axis (walls).
  double along_N_per_m = 0, across_N_per_m = 0;
  /// Largest stiffness of the elements that yield under a small force: friction and hold of the
  /// tip, and friction in soft layers. along_N_per_m and across_N_per_m do not contain it.
  double yielding_N_per_m = 0;
  double viscous_N_s_per_m = 0;  ///< viscous friction along the shaft, summed over all slabs
};

/// Computes the forces of those soft layers of the scene whose fracture toughness is given. Errors:
/// those of tool_shape().
Result<void> resolve_layers(Scene& scene);

/// Makes the bone volume. `sheets`: the result of place_slices() for a scene with the force law
/// `cutting`. Errors: those of tool_shape(), and kRefused in these cases:
///  - A bone law does not exist, gives no strength, or needs another kind of density than that of
///    the calibration.
///  - The strength is to follow from HU, and a slice has no HU.
///  - The scene states a free radius of the shell, and a tissue has no bone law.
///  - resolve_layers() has not computed the force of a layer.
Result<BoneVolume> make_bone_volume(const Scene& scene, std::span<const Sheet* const> sheets);

// Computes how the strength of bone varies with depth within each slab, from one strength per
// slice. A slab extends half-way to the neighbouring slices. Within a slab the strength is linear
// in depth, and the mean of the strength is the slice's value, wherever the slice lies in the slab.
// So the work of cutting through the slab is the slab's thickness times the slice's value.
//
// Contract: The mean strength of a slab is the
// value of its slice. In the first and the last slab the strength is constant. In every other slab
// the straight line through the values of the two neighbouring slices gives the slope of the
// strength. A slope limiter (B. van Leer, J. Comput. Phys. 23, 1977) reduces the slope where the
// strength at an end of the slab would leave an allowed range. The range goes from the smaller to
// the larger of two values, the slab's own and that of the neighbour on that side, and is then
// widened by 5 % of the slab's own value on either side. It contains no negative values. The range
// prevents overshoot at a jump, such as a thin cortex next to soft bone. Because of the 5 %, a
// strength that varies smoothly keeps its maxima.

/// Returns the strength at the top and at the bottom of a slab (see above). `above_N`,
/// `above_gap_m`: strength and distance of the slice above; a distance of 0 means that there is
/// none. `below_N`, `below_gap_m`: likewise for the slice below.
std::array<double, 2> strength_ends(double strength_N, double above_N, double above_gap_m,
                                    double below_N, double below_gap_m,
                                    double thickness_m) noexcept;

// Finds a wall of cortical bone that is thinner than its slab (the bone around one slice). The HU
// of such a slab are the mean of the wall and of the bone behind the wall. A strength from these HU
// would be too low in the wall and too high behind it. If the HU of cortical bone are known, the
// wall's thickness follows from the slab's mean HU (cortical bone mapping, after G. Treece et al.,
// Med. Image Anal. 14, 2010, but without a model of the scanner's blur).
//
// Contract:
//  1. The result is 0 (no wall) if `slab_HU` exceeds `inside_HU` by less than kMinContrast_HU, or
//     if the wall of items 2 and 3 would be thinner than kMinWall_m. The HU of cancellous bone (the
//     porous bone inside) vary by less than kMinContrast_HU from slice to slice, so cancellous bone
//     is not taken for a wall.
//  2. Otherwise, if `slab_HU` is at least `cortex_HU`, the wall fills the slab.
//  3. Otherwise, the result is the thickness t for which `slab_HU` is the mean of two parts, each
//     weighted by its thickness: a wall of thickness t with the HU `cortex_HU`, and the rest of the
//     slab with the HU `inside_HU`.

/// HU of cortical bone that are assumed if the scene states neither SceneBody::cortex_HU nor a
/// shell (an outer layer of bone with a given thickness). Cortical bone usually has 1,000 to 1,500
/// HU.
inline constexpr double kAssumedCortex_HU = 1200;
inline constexpr double kMinContrast_HU = 200, kMinWall_m = 0.4e-3;

/// Returns the thickness of the wall at a face of a slab of bone. `slab_HU`: mean HU of the slab.
/// `inside_HU`: HU of the bone behind the wall, which is the bone of the next slab.
double wall_thickness_m(double slab_HU, double inside_HU, double cortex_HU,
                        double slab_thickness_m) noexcept;

// The force with which a tool breaks through a layer of soft tissue, computed from the tissue's
// fracture toughness. A pointed tip opens a crack. When the point comes out of the bottom of the
// layer, the length of the crack equals the width of the tip at the top of the layer, but is at
// most the length of the crack that the whole tool opens (torn_length_m()). Tearing accounts for
// 61 % of the force on the tool, and spreading and friction account for the rest (A. Barnett, Y.-S.
// Lee, J. Moore, J. Manuf. Sci. Eng. 138, 2016).
//
// Contract:
//  1. Let h be the thickness of the layer, and alpha the half angle of the tip
//     (ToolShape::half_angle_rad).
//       pointed tip: force = toughness * min(torn length, 2 h tan(alpha)) / 0.61
//       flat or hollow tip: force = toughness * torn length / 0.61

/// Force of tearing divided by the whole force on the tool.
inline constexpr double kTearingFraction = 0.61;

/// Returns the force (contract 1). `toughness_J_per_m2`: work per area of crack. Precondition: the
/// tool is valid (error_of()).
double membrane_break_N(double toughness_J_per_m2, double thickness_m,
                        const ToolShape& tool) noexcept;

// The force with which a tip breaks through a thin wall of cortical bone that has nothing behind
// it, such as the wall of a pedicle. The model of the wall is a rigid-plastic plate. The plate is
// simply supported or clamped along a circle whose radius is called the free radius. It breaks by
// bending along plastic hinge lines (H. Hopkins, W. Prager, J. Mech. Phys. Solids 2, 1953, for a
// plate that is loaded over a disc) or by punching, whichever needs less force. The model is
// experimental: measured forces of thin walls differ from its results by factors of up to 3
// (tests/bench/published_forces.json).
//
// Contract:
//  1. Let t be the thickness, a the radius of the tip and R the free radius. The other names are
//     members of ThinWall.
//       bending = clamping * pi * (flow * t^2 / 4) / (1 - 2 min(a, R) / (3 R))
//       punching = 2 pi a t * shear
//  2. The flow stress of cortex is proportional to the square of the apparent density. At
//     1.9 g/cm^3 the flow stress is 100 MPa.

struct ThinWall {
  double thickness_m = 0, free_radius_m = 0;
  double flow_Pa = 100e6;  ///< flow stress in bending
  double shear_Pa =
      51.6e6;           ///< shear strength of cortex (C. Turner et al., J. Orthop. Res. 19, 2001)
  double clamping = 3;  ///< edge of the wall; 2: simply supported, 4: clamped, 3: in between
};

/// Flow stress of cortical bone of this apparent density (contract 2).
double cortex_flow_Pa(double apparent_g_per_cm3) noexcept;

double bending_N(const ThinWall& wall, double tip_radius_m) noexcept;
double punching_N(const ThinWall& wall, double tip_radius_m) noexcept;
/// Returns the smaller of bending_N() and punching_N().
double break_N(const ThinWall& wall, double tip_radius_m) noexcept;

}  // namespace trocar::runtime
