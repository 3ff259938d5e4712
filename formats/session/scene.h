// SPDX-License-Identifier: Apache-2.0
// The scene: slices of an asset and their positions in the device's frame {B} (origin in the base,
// z up, metres), their tissues, the tool, and the simulated hand's trajectory. The file is JSON
// with the schema formats/session/scene.schema.json.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "formats/base/result.h"
#include "formats/session/force_law_kind.h"

namespace trocar {

inline constexpr const char* kSceneSchema = "trocar.scene/1";
inline constexpr std::size_t kMaxSceneSlices = 64;
inline constexpr int kMaxToolSides = 32;
inline constexpr std::size_t kMaxKeyframes = 4096;
inline constexpr std::size_t kMaxTissues = 64;
inline constexpr std::size_t kMaxZones = 32;
inline constexpr std::size_t kMaxZoneCorners = 256;
/// Smallest difference in height between two slices, so that their order is defined. A tolerance of
/// 1 pm for the rounding of numbers admits slices whose written heights differ by exactly this.
inline constexpr double kMinSliceGap_m = 1e-4;

/// Forces of a punctured sheet on the shaft in its hole: dry and viscous friction along the shaft
/// (A. Okamura, C. Simone, M. O'Leary, Force modeling for needle insertion into soft tissue, 2004),
/// and a spring from the hole's rim against lateral displacement. By default there is no force.
struct ShaftTissue {
  double dry_friction_N = 0;
  double viscous_friction_N_s_per_m = 0;
  /// Displacement over which dry friction builds up like the force of a spring. This makes it
  /// defined at rest.
  double presliding_m = 2e-4;
  double rim_stiffness_N_per_m = 0;  ///< spring towards the point where the shaft entered the hole
  friend bool operator==(const ShaftTissue&, const ShaftTissue&) = default;
};

/// The strength of bone from its HU: density = at_0_HU + per_HU * HU, and a published law gives the
/// strength (runtime/bone_cutting/material/bone_strength.h).
struct BoneByHu {
  std::string law;                    ///< name of the law
  std::string density = "qct";        ///< kind of the resulting density: "qct", "ash" or "apparent"
  double per_HU = 8e-4, at_0_HU = 0;  ///< g/cm^3
  bool calibration_is_given = false;  ///< false: the default calibration is assumed
  friend bool operator==(const BoneByHu&, const BoneByHu&) = default;
};

/// Resistance of a tissue to a tool that cuts through it (force law `cutting`).
struct CutTissue {
  std::optional<double> strength_MPa;  ///< cutting force per area of the tool's outline
  std::optional<BoneByHu> bone;        ///< strength from HU, if strength_MPa is absent
  double tearing_N_per_m = 0;          ///< additional force per length of the outline
  /// Ratio of the pressure under a flat tip to the bone's strength.
  double pressure_over_yield = 1;
  double modulus_MPa = 0;  ///< 0: the tip is as stiff as Tissue::stiffness_N_per_m
  /// Coulomb friction coefficient of the tip's faces, and of the shaft on the wall of its hole,
  /// which presses on it with the tissue's strength.
  double friction_coefficient = 0;
  double friction_kPa = 0;          ///< additional friction along the shaft, per area of its side
  double foundation_N_per_mm3 = 0;  ///< Winkler foundation: lateral pressure per displacement
  double lateral_strength_MPa = 0;  ///< pressure at which a wall yields
  friend bool operator==(const CutTissue&, const CutTissue&) = default;
};

/// One elastic sheet; the defaults are the paper's.
struct Tissue {
  double stiffness_N_per_m = 5000;
  /// The sheet is punctured in the tick in which the force would exceed threshold_N times the
  /// tool's coverage.
  double threshold_N = 35;
  double damping_N_s_per_m = 0;  ///< adds this times dx' to the force K dx; the sum is at least 0
  ShaftTissue shaft;
  /// If absent, stiffness and threshold apply to the scene's tool, even with the law `cutting`.
  std::optional<CutTissue> cut;
  /// The scene states stiffness_N_per_m. If it does not, the law `cutting` computes the stiffness of the tip in
  /// bone from the bone's modulus.
  bool stiffness_is_given = false;
  friend bool operator==(const Tissue&, const Tissue&) = default;
};

/// A named tissue. It applies to slices that were made from one of `labels`, or to slices whose
/// mean HU is in the range `hu`. If both are missing, it applies only to slices that name it.
struct NamedTissue {
  std::string name;
  std::vector<int> labels;
  std::optional<std::array<double, 2>> hu;
  Tissue tissue;
};

enum class NetworkSolver : std::uint8_t { kAuto, kLocal, kGlobal, kPropagation };

/// Soft tissue over the bone (force law `cutting`). Until it is punctured, it is a stiffening
/// spring, F = a1 z + a2 z^2. Afterwards it is cut at a constant force.
struct SceneLayer {
  std::string name;
  double top_z_m = 0, thickness_m = 0;
  double stiffness_N_per_m = 0, stiffening_N_per_m2 = 0;  ///< a1, a2
  double puncture_N = 0, cutting_N = 0;
  /// Fracture toughness, from which the force of puncture follows for the scene's tool; 0: puncture_N is given.
  /// Unless cutting_N is given, the force after the puncture then is the part of it that tears the tissue.
  double toughness_J_per_m2 = 0;
  bool cutting_is_given = false;
  double friction_N_per_m = 0;  ///< friction on the shaft per length of cut depth
};
inline constexpr std::size_t kMaxLayers = 8;

/// How the cutting tool is attached to the plate.
enum class ToolAxis : std::uint8_t {
  kAuto,     ///< rigid if the tissue is softer than the coupling, otherwise coupled
  kRigid,    ///< the tool is fixed to the plate
  kCoupled,  ///< springs connect tool and plate: SceneForceLaw::coupling_N_per_m
};
/// The choice whether the law `cutting` is evaluated at a predicted pose.
enum class PosePrediction : std::uint8_t {
  kAuto,  ///< evaluated one tick ahead if the device's damping is too small for the coupling
  kOn,
  kOff,
};

struct SceneForceLaw {
  ForceLawKind kind = ForceLawKind::kHooke;
  double force_scale = 1;  ///< factor on the tissue's wrench on the plate
  // kNetwork:
  NetworkSolver solver = NetworkSolver::kAuto;
  double decay_length_m = 0.01;  ///< decay length lambda of the sheet's displacement field
  double error_bound = 0.01;     ///< kAuto: relative error of force and displacement
  double radius_m = 0.04;        ///< kLocal: radius of the region around the tool
  int depth = 6;                 ///< kPropagation: number of vertex rings
  // kCutting:
  ToolAxis axis = ToolAxis::kAuto;
  /// 0: as stiff as the device holds (runtime/bone_cutting/contact/device_coupling.h).
  double coupling_N_per_m = 0, coupling_Nm_per_rad = 0;
  PosePrediction prediction = PosePrediction::kAuto;
  double tip_friction = 0.3;  ///< coefficient of the tip's friction on the bone that it presses on
  /// Crushed bone holds the tip against withdrawal with this fraction of the force that crushed it.
  double tip_hold = 0.25;
  bool twist = false;  ///< true: turning the tool while pushing it makes it cut more easily
};

/// The position of the slice plane (u, v in mm; asset.md, Frames) in {B}:
/// p = at + R_z(rotation) (uv - anchor). u -> x, v -> y, slice normal -> z: never mirrored.
struct Placement {
  /// The point of the slice plane that lies at `at_m`; if absent, the centroid of the material in
  /// the scene's first slice. It is the same for all slices, so that they stay aligned.
  std::optional<std::array<double, 2>> anchor_mm;
  std::array<double, 2> at_m{0, 0};
  double rotation_deg = 0;
};

/// A bone volume (force law `cutting`), given instead of Scene::slices: the non-empty slices of the
/// asset from one index to another, at their true spacing.
struct SceneBody {
  int from = 0, to = 0;     ///< AssetSlice::index, from <= to
  double top_z_m = 0;       ///< height in {B} of the highest of them
  double shell_m = 0;       ///< thickness of the cortical shell; 0: none
  double shell_factor = 1;  ///< shell's strength over that of the bone under the tool
  /// Radius within which nothing supports the shell, so that it breaks as a thin wall
  /// (runtime/bone_cutting/material/thin_wall.h) where that needs less force; 0: bone supports it everywhere.
  double shell_free_radius_m = 0;
};

struct SceneSlice {
  int index = 0;   ///< AssetSlice::index
  double z_m = 0;  ///< height in {B}
  /// NamedTissue::name. If absent, the tissue is chosen by label or HU; if none applies, it is
  /// Scene::tissue.
  std::optional<std::string> tissue;
};

/// A prism along the tool's axis. Its cross-section is a regular polygon, or the polygon
/// `outline_m`, around the axis.
struct SceneTool {
  /// Kind of tip (force law `cutting`), one of the names in
  /// runtime/bone_cutting/material/tool_in_tissue.h; empty: flat.
  std::string kind;
  double half_angle_deg = 30;  ///< angle between axis and faces of a tip that is not flat
  double inner_radius_m = 0;   ///< bore of a hollow tool
  int sides = 6;
  double radius_m = 0.003;  ///< radius of the circumscribed circle
  /// If not empty, a simple polygon, counter-clockwise seen from +z, that replaces `sides` and
  /// `radius_m`.
  std::vector<std::array<double, 2>> outline_m;
  double rotation_deg = 0;                        ///< rotation of the cross-section about the axis
  std::array<double, 3> tip_in_plate_m{0, 0, 0};  ///< lower end of the axis in the plate's frame
  /// The axis is the plate's z axis tilted by tilt_deg towards tilt_azimuth_deg from its x axis.
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

/// The simulated hand: an impedance that pulls the tool tip along a trajectory. Values that are
/// absent are those of the grip (runtime/simulation/hand.h).
struct SceneHand {
  /// A person moves the hand while the session runs (trocar-run --live). The trajectory then has one
  /// keyframe, the start, and let_go_t_s is absent.
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

/// The line that the tool's tip is to follow, from the entry point on.
struct PlannedLine {
  std::array<double, 3> entry_m{};
  std::array<double, 3> direction{};     ///< unit vector, into the tissue
  std::optional<double> entry_radius_m;  ///< allowed distance from the line at the entry point
  std::optional<double> corridor_m;      ///< allowed distance from the line below the entry point
};

/// A volume in which the tip must not be, such as the spinal canal.
struct ForbiddenZone {
  enum class Shape : std::uint8_t { kCapsule, kBox, kPrism };
  std::string name;
  Shape shape = Shape::kCapsule;
  std::array<double, 3> low_m{}, high_m{};  ///< the capsule's ends; the box's corners
  double radius_m = 0;                      ///< the capsule's radius
  /// The prism's cross-section, a simple polygon in x and y, which is extruded over z_m.
  std::vector<std::array<double, 2>> outline_m;
  std::array<double, 2> z_m{};
  double margin_m = 0;  ///< required distance between the tip and the volume
};

struct GoalTarget {
  std::array<double, 3> at_m{};
  double radius_m = 0;
};

/// The goals against which a session is scored (runtime/reporting/session_report.h). They do not
/// affect the simulation. Positions are those of the tool's tip in {B}.
struct SceneGoals {
  std::optional<GoalTarget> target;
  std::optional<PlannedLine> line;
  std::optional<double> force_max_N;   ///< largest allowed force on the hand
  std::optional<double> time_max_s;    ///< allowed time from first contact to target or last
                                       ///< puncture
  std::optional<double> plunge_max_m;  ///< allowed plunge after a break-through
  std::vector<ForbiddenZone> zones;
};

struct Scene {
  std::string name;
  std::filesystem::path asset;  ///< resolved against the scene file's folder
  std::optional<std::filesystem::path>
      device;  ///< resolved in the same way; absent: the built-in one
  double duration_s = 0;
  std::optional<double> rate_Hz;
  Placement placement;
  std::vector<SceneSlice>
      slices;  ///< in the file's order; for a bone volume, place_body() fills this list
  std::optional<SceneBody> body;
  std::vector<SceneLayer> layers;    ///< ordered from the topmost downwards
  Tissue tissue;                     ///< tissue of slices to which none of `tissues` applies
  bool tissue_is_given = false;      ///< false: the file has no `tissue`; defaults apply
  std::vector<NamedTissue> tissues;  ///< the first one that applies to a slice is chosen for it
  SceneForceLaw force_law;
  SceneTool tool;
  SceneHand hand;
  std::optional<SceneGoals> goals;
};

inline constexpr double kMinRate_Hz = 100, kMaxRate_Hz = 8000;
inline constexpr double kMaxDuration_s = 86400;

/// Reads a scene from JSON text, and resolves its paths against `folder`. Errors: (refused) unknown
/// or repeated keys, wrong types, values that are not finite or out of range. The message is one
/// line with `name` and the JSON path.
Result<Scene> parse_scene(std::string_view text, const std::string& name,
                          const std::filesystem::path& folder);
Result<Scene> read_scene(const std::filesystem::path& file);

}  // namespace trocar
