// SPDX-License-Identifier: Apache-2.0
// The scene of a session, and the names and traits of the force laws that a program needs to read
// it. The laws themselves are in runtime/haptics.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "formats/base/result.h"

namespace trocar {

/// Index of a law's row in the table of laws. Values beyond the last enumerator belong to laws that
/// add_force_law() added.
enum class ForceLawKind : std::uint8_t {
  kHooke,    ///< each slice is an elastic sheet: a spring, F = K dx
  kNetwork,  ///< each slice is an elastic sheet: a spring network (runtime/haptics/membrane)
  kCutting,  ///< the slices are one bone volume, which the tool cuts (runtime/haptics/bone)
};

struct ForceLawTraits {
  const char* name;  ///< name in scenes and on the command line
  /// True if the law uses a bone volume: the law accepts a scene's `body`, and reads the HU under
  /// the tool from Sheet::field.
  bool uses_bone_volume = false;
};

/// The shipped laws, in the order of ForceLawKind.
inline constexpr std::array kForceLaws{ForceLawTraits{"hooke"}, ForceLawTraits{"network"},
                                       ForceLawTraits{"cutting", true}};
static_assert(kForceLaws.size() == static_cast<std::size_t>(ForceLawKind::kCutting) + 1,
              "a row for each ForceLawKind");

/// The row of a law. Precondition: the table has this law.
const ForceLawTraits& traits_of(ForceLawKind law) noexcept;
inline const char* to_string(ForceLawKind law) noexcept {
  return traits_of(law).name;
}
/// The law of that name, or std::nullopt.
std::optional<ForceLawKind> force_law_from_string(std::string_view name) noexcept;
/// All names for a message, such as "hooke, network or cutting". `quote` is written before and
/// after each name.
std::string force_law_names(const std::string& quote = "");

/// Adds a row to the table. Only runtime::add_force_law() may call this function, and only while no
/// other thread reads the table.
ForceLawKind add_force_law(const ForceLawTraits& traits);

// The scene: slices of an asset and their positions in the device's frame {B} (origin in the base,
// z up, metres), their tissues, the tool, and the simulated hand's trajectory. With the force laws
// `hooke` and `network`, each slice is an elastic sheet. With the law `cutting`, all slices
// together are one bone volume. The file is JSON with the schema formats/session/scene.schema.json.

inline constexpr const char* kSceneSchema = "trocar.scene/1";
inline constexpr std::size_t kMaxSceneSlices = 64;
inline constexpr int kMaxToolSides = 32;
inline constexpr std::size_t kMaxKeyframes = 4096;
inline constexpr std::size_t kMaxTissues = 64;
inline constexpr std::size_t kMaxZones = 32;
inline constexpr std::size_t kMaxZoneCorners = 256;
/// Smallest difference in height between two slices, so that their order is defined. The reader of
/// a scene allows 1 pm less: otherwise, because of rounding, it might refuse slices whose written
/// heights differ by exactly 0.1 mm.
inline constexpr double kMinSliceGap_m = 1e-4;

/// Forces of a punctured sheet on the tool's shaft in the hole: dry and viscous friction along
/// the shaft (A. Okamura, C. Simone, M. O'Leary, Force modeling for needle insertion into soft
/// tissue, 2004), and a spring from the hole's rim against lateral displacement. By default
/// there is no force.
struct ShaftTissue {
  double dry_friction_N = 0;
  double viscous_friction_N_s_per_m = 0;
  /// Displacement of the shaft over which dry friction builds up, like the force of a spring. So
  /// the friction has a defined value even while the shaft does not move.
  double presliding_m = 2e-4;
  /// Stiffness of the spring that pulls the shaft to the point at which it entered the hole.
  double rim_stiffness_N_per_m = 0;
  friend bool operator==(const ShaftTissue&, const ShaftTissue&) = default;
};

/// The strength of bone from its HU. The density is at_0_HU + per_HU * HU, and a published law
/// gives the strength for this density (runtime/haptics/bone/bone_volume.h).
struct BoneByHu {
  std::string law;  ///< name of the law
  /// Kind of the resulting density: "qct" (mineral, calibrated by scanning a body of known
  /// density), "ash" (mass of the burnt bone per volume) or "apparent" (mass of the bone without
  /// marrow per volume).
  std::string density = "qct";
  double per_HU = 8e-4, at_0_HU = 0;  ///< g/cm^3 per HU, and g/cm^3 at 0 HU
  bool calibration_is_given = false;  ///< false: the default calibration is assumed
  friend bool operator==(const BoneByHu&, const BoneByHu&) = default;
};

/// Resistance of a tissue to a tool that cuts through it (force law `cutting`).
struct CutTissue {
  /// Strength of the material. The pressure on the area that the tip displaces (for a hollow tool,
  /// the ring) is this value times pressure_over_yield.
  std::optional<double> strength_MPa;
  std::optional<BoneByHu> bone;  ///< strength from HU, if strength_MPa is absent
  double tearing_N_per_m = 0;    ///< additional force per length of the outline
  /// Pressure under a flat tip that cuts, divided by the strength of the material.
  double pressure_over_yield = 1;
  /// Elastic modulus, from which the stiffness under the tip is computed. 0: not given. The modulus
  /// then follows from `bone` if the scene gives `bone` and no stiffness_N_per_m. Otherwise the
  /// stiffness is Tissue::stiffness_N_per_m.
  double modulus_MPa = 0;
  /// Coulomb friction coefficient of the tip's faces, and of the shaft on the wall of its hole. The
  /// pressure of the wall on the shaft is the strength times pressure_over_yield.
  double friction_coefficient = 0;
  double friction_kPa = 0;  ///< additional friction along the shaft, per area of the shaft's side
  /// Stiffness with which the wall of a hole resists lateral displacement of the shaft (Winkler
  /// foundation): pressure per displacement.
  double foundation_N_per_mm3 = 0;
  double lateral_strength_MPa = 0;  ///< pressure at which the wall of a hole yields
  friend bool operator==(const CutTissue&, const CutTissue&) = default;
};

/// The tissue of a slice. Stiffness and threshold have the values of the paper as defaults.
struct Tissue {
  double stiffness_N_per_m = 5000;
  /// The sheet is punctured in the tick in which the force would exceed threshold_N times the
  /// tool's coverage, which is the fraction of the area of the tool's outline that lies over
  /// material.
  double threshold_N = 35;
  /// The damping b in the force K dx + b dx'. The force is never below 0. K is the stiffness, dx
  /// the penetration and dx' the rate of the penetration.
  double damping_N_s_per_m = 0;
  ShaftTissue shaft;
  /// Resistance to cutting. If absent, the law `cutting` uses stiffness_N_per_m as the stiffness
  /// under the tip of the scene's tool, and threshold_N as the force that cuts this tissue.
  std::optional<CutTissue> cut;
  /// True if the scene gives stiffness_N_per_m. If false, and if CutTissue::bone is given, the law
  /// `cutting` computes the stiffness under the tip from the bone's elastic modulus.
  bool stiffness_is_given = false;
  friend bool operator==(const Tissue&, const Tissue&) = default;
};

/// A named tissue. It applies to slices that were made from one of `labels`, or to slices whose
/// mean HU is in the range `hu`. If `labels` and `hu` are both missing, the tissue applies only to
/// slices that name it.
struct NamedTissue {
  std::string name;
  std::vector<int> labels;
  std::optional<std::array<double, 2>> hu;
  Tissue tissue;
};

/// How the force law `network` computes the displacement of a sheet (runtime/haptics/membrane).
enum class NetworkSolver : std::uint8_t { kAuto, kLocal, kGlobal, kPropagation };

/// A layer of soft tissue over the bone (force law `cutting`). Until it is punctured, the layer is
/// a stiffening spring: at the indentation z its force is F = a1 z + a2 z^2. After the puncture it
/// is cut at a constant force.
struct SceneLayer {
  std::string name;
  double top_z_m = 0, thickness_m = 0;
  double stiffness_N_per_m = 0, stiffening_N_per_m2 = 0;  ///< a1, a2
  double puncture_N = 0, cutting_N = 0;                   ///< force at the puncture, and after it
  /// Fracture toughness; 0: the scene gives puncture_N. If the toughness is above 0, puncture_N is
  /// computed from it for the scene's tool. If the scene then does not give cutting_N, cutting_N
  /// becomes the part of puncture_N that tears the tissue.
  double toughness_J_per_m2 = 0;
  bool cutting_is_given = false;  ///< the scene gives cutting_N
  double friction_N_per_m = 0;    ///< friction on the shaft for each metre of depth cut
};
inline constexpr std::size_t kMaxLayers = 8;

/// How the tool is attached to the plate (force law `cutting`).
enum class ToolAxis : std::uint8_t {
  kAuto,  ///< kRigid if the tissue is softer than the coupling would be, otherwise kCoupled
  /// The tool is fixed to the plate. If the rendered stiffness would then exceed a limit of the
  /// device or the operator, kCoupled is used (cutting_force_law.h, contract 3).
  kRigid,
  kCoupled,  ///< springs connect tool and plate: SceneForceLaw::coupling_N_per_m
};

struct SceneForceLaw {
  ForceLawKind kind = ForceLawKind::kHooke;
  double force_scale = 1;  ///< factor on the tissue's wrench on the plate
  // kNetwork:
  NetworkSolver solver = NetworkSolver::kAuto;
  double decay_length_m = 0.01;  ///< distance (lambda) over which a sheet's displacement dies out
  double error_bound = 0.01;     ///< solver kAuto: largest relative error of force and displacement
  double radius_m = 0.04;        ///< kLocal: radius of the region around the tool
  int depth = 6;                 ///< kPropagation: number of rings of vertices around the tool
  // kCutting:
  ToolAxis axis = ToolAxis::kAuto;
  /// Stiffness of the coupling, the springs between tool and plate. 0: the largest stiffness that
  /// the device can render stably (runtime/haptics/bone/cutting_force_law.h).
  double coupling_N_per_m = 0, coupling_Nm_per_rad = 0;
  double tip_friction = 0.3;  ///< friction coefficient of a tip that slides on bone without cutting
  /// Crushed bone holds the tip against withdrawal with this fraction of the force that
  /// crushed the bone.
  double tip_hold = 0.25;
  bool twist = false;  ///< true: turning the tool while pushing it makes it cut more easily
};

/// The position of the slice planes in {B}. A point of a slice plane has the coordinates u and v in
/// mm (asset.md, Frames). The point's x and y in {B} are at_m + R * ((u, v) - anchor_mm). R is the
/// rotation about z by rotation_deg; the difference is converted from mm to m. Without rotation, u
/// points along x, v along y and the slice normal along z, so slices are never mirrored.
struct Placement {
  /// The point of the slice plane that lies at `at_m`; if absent, the centroid of the material in
  /// the scene's first slice. All slices have the same anchor, so that they stay aligned.
  std::optional<std::array<double, 2>> anchor_mm;
  std::array<double, 2> at_m{0, 0};
  double rotation_deg = 0;
};

/// A bone volume (force law `cutting`), which a scene gives instead of Scene::slices: the non-empty
/// slices of the asset from index `from` to index `to`, at their true spacing.
struct SceneBody {
  int from = 0, to = 0;     ///< AssetSlice::index, from <= to
  double top_z_m = 0;       ///< height in {B} of the highest slice
  double shell_m = 0;       ///< thickness of the cortical shell; 0: none
  double shell_factor = 1;  ///< ratio of the shell's strength to that of the bone under the tool
  /// At every position of the tool, the shell counts as unsupported within this radius around the
  /// tool. The shell then breaks as a thin wall (runtime/haptics/bone/bone_volume.h) if
  /// breaking needs less force than cutting. 0: bone supports the shell everywhere.
  double shell_free_radius_m = 0;
  /// HU of cortical bone. If a slice is thicker than a cortical wall, its HU are the mean of the
  /// wall and of the bone behind it. From cortex_HU and this mean, the law computes the thickness
  /// of the wall (runtime/haptics/bone/bone_volume.h). 0: no walls are computed, so the
  /// strength follows the HU of each slice. Absent: 1200 (kAssumedCortex_HU), or 0 with a shell.
  std::optional<double> cortex_HU = std::nullopt;
};

struct SceneSlice {
  int index = 0;   ///< AssetSlice::index
  double z_m = 0;  ///< height in {B}
  /// NamedTissue::name. If absent, the slice gets the first of Scene::tissues that applies to it by
  /// label or HU. If none applies, the slice gets Scene::tissue.
  std::optional<std::string> tissue;
};

/// The tool: a prism along the tool's axis. The cross-section is a regular polygon around the axis,
/// or the polygon `outline_m`.
struct SceneTool {
  /// Kind of tip (force law `cutting`), one of the names in
  /// runtime/haptics/bone/bone_volume.h; empty: flat.
  std::string kind;
  double half_angle_deg = 30;  ///< angle of the tip's faces to the axis; not used without `kind`
  /// The half angle of a tip of the kind `kind` if none is stated: 90 for a jamshidi, because its
  /// edge is flat, and 30 for the other kinds.
  static double usual_half_angle_deg(std::string_view kind) { return kind == "jamshidi" ? 90 : 30; }
  double inner_radius_m = 0;  ///< radius of the bore of a hollow tool
  int sides = 6;
  double radius_m = 0.003;  ///< radius of the circumscribed circle
  /// If not empty, a simple polygon, counter-clockwise seen from +z, that replaces `sides` and
  /// `radius_m`.
  std::vector<std::array<double, 2>> outline_m;
  /// Rotation of the cross-section about the axis. The slanted face of a tip `needle-bevel` looks
  /// along the cross-section's x axis, so this face turns too.
  double rotation_deg = 0;
  std::array<double, 3> tip_in_plate_m{0, 0, 0};  ///< lower end of the axis in the plate's frame
  /// The tool's axis is the plate's z axis, tilted by tilt_deg. The direction of the tilt has the
  /// angle tilt_azimuth_deg from the plate's x axis.
  double tilt_deg = 0, tilt_azimuth_deg = 0;
};
/// Largest angle between the tool's axis and {B}'s z. At larger angles a tool would slide instead
/// of puncturing.
inline constexpr double kMaxTilt_deg = 45;

struct TipKeyframe {
  double t_s = 0;
  std::array<double, 3> tip_m{};         ///< wanted tool tip in {B}
  std::array<double, 3> rotation_deg{};  ///< wanted rotation of the plate: a rotation vector in {B}
};

enum class HandGrip : std::uint8_t { kFirm, kLight, kStiff };

/// The simulated hand: an impedance that pulls the tool tip along a trajectory. Absent values are
/// taken from `grip` (runtime/device/simulated/hand.h).
struct SceneHand {
  /// True if a person moves the hand while the session runs (trocar-run --live). The trajectory
  /// then has one keyframe, the start, and let_go_t_s is absent.
  bool live = false;
  HandGrip grip = HandGrip::kFirm;
  std::optional<double> stiffness_N_per_m;
  std::optional<double> damping_N_s_per_m;
  std::optional<double> rotation_stiffness_Nm_per_rad;
  std::optional<double> rotation_damping_Nm_s_per_rad;
  std::optional<double> mass_kg;        ///< mass that moves with the tip
  std::optional<double> let_go_t_s;     ///< the hand exerts no force from this time on
  std::vector<TipKeyframe> trajectory;  ///< at least one; times ascend, the first is 0
};

/// The line that the tool's tip is to follow, from the entry point onwards.
struct PlannedLine {
  std::array<double, 3> entry_m{};
  std::array<double, 3> direction{};     ///< unit vector, into the tissue
  std::optional<double> entry_radius_m;  ///< largest distance from the line at the entry point
  std::optional<double> corridor_m;      ///< largest distance from the line below the entry point
};

/// A volume in which the tip must not be, such as the spinal canal.
struct ForbiddenZone {
  enum class Shape : std::uint8_t { kCapsule, kBox, kPrism };
  std::string name;
  Shape shape = Shape::kCapsule;
  /// Ends of a capsule's axis, or opposite corners of a box.
  std::array<double, 3> low_m{}, high_m{};
  double radius_m = 0;  ///< radius of a capsule
  /// Cross-section of a prism: a simple polygon in x and y, which is extruded over z_m.
  std::vector<std::array<double, 2>> outline_m;
  std::array<double, 2> z_m{};  ///< lowest and highest z of a prism
  double margin_m = 0;          ///< required distance between the tip and the volume
};

struct GoalTarget {
  std::array<double, 3> at_m{};
  double radius_m = 0;
};

/// The goals against which a session is scored (runtime/report/session_report.h). The goals do
/// not affect the simulation. Positions are those of the tool's tip in {B}.
struct SceneGoals {
  std::optional<GoalTarget> target;
  std::optional<PlannedLine> line;
  std::optional<double> force_max_N;  ///< largest allowed force on the hand
  /// Longest allowed time from the first contact until the tip reaches the target or, if the goals
  /// have no target, until the last puncture.
  std::optional<double> time_max_s;
  std::optional<double> plunge_max_m;  ///< largest allowed motion of the tip after a break-through
  std::vector<ForbiddenZone> zones;
};

struct Scene {
  std::string name;
  std::filesystem::path asset;  ///< resolved against the scene file's folder
  /// Device description, resolved like `asset`. Absent: the built-in device.
  std::optional<std::filesystem::path> device;
  double duration_s = 0;
  std::optional<double> rate_Hz;
  Placement placement;
  /// The slices, in the order of the file. For a bone volume, place_body() fills this list.
  std::vector<SceneSlice> slices;
  std::optional<SceneBody> body;
  std::vector<SceneLayer> layers;    ///< ordered from the topmost downwards
  Tissue tissue;                     ///< tissue of slices to which none of `tissues` applies
  bool tissue_is_given = false;      ///< false: the file has no `tissue`; defaults apply
  std::vector<NamedTissue> tissues;  ///< a slice gets the first one that applies (SceneSlice)
  SceneForceLaw force_law;
  SceneTool tool;
  SceneHand hand;
  std::optional<SceneGoals> goals;
};

inline constexpr double kMinRate_Hz = 100, kMaxRate_Hz = 8000;
inline constexpr double kMaxDuration_s = 86400;

/// Reads a scene from JSON text, and resolves its paths against `folder`. Errors: kRefused if a key
/// is unknown, repeated or missing, if a type is wrong, or if a value is not finite or out of
/// range. The message is one line with `name` and the JSON path.
Result<Scene> parse_scene(std::string_view text, const std::string& name,
                          const std::filesystem::path& folder);
Result<Scene> read_scene(const std::filesystem::path& file);

}  // namespace trocar
