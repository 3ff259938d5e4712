// SPDX-License-Identifier: Apache-2.0
// The scene: slices of an asset and their places in the device's frame {B} (origin in the base, z
// up, metres), their tissues, the tool, and the simulated hand's trajectory. File: JSON, schema
// formats/session/scene.schema.json.
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

inline constexpr const char* kSceneSchema = "trocar.scene/1";
inline constexpr std::size_t kMaxSceneSlices = 64;
inline constexpr int kMaxToolSides = 32;
inline constexpr std::size_t kMaxKeyframes = 4096;
inline constexpr std::size_t kMaxTissues = 64;
inline constexpr std::size_t kMaxZones = 32;
inline constexpr std::size_t kMaxZoneCorners = 256;
/// Smallest distance of two slices in height, so that their order is defined. Slices whose written
/// heights differ by exactly this are taken: 1 pm is allowed for the rounding of the numbers.
inline constexpr double kMinSliceGap_m = 1e-4;

/// Forces of a punctured sheet on the shaft in its hole: dry and viscous friction along the shaft
/// (A. Okamura, C. Simone, M. O'Leary, Force modeling for needle insertion into soft tissue, 2004),
/// and a spring from the hole's rim against lateral displacement. All zero: no force.
struct ShaftTissue {
  double dry_friction_N = 0;
  double viscous_friction_N_s_per_m = 0;
  /// Displacement over which dry friction builds up like a spring, so that it is defined at rest.
  double presliding_m = 2e-4;
  double rim_stiffness_N_per_m = 0;  ///< for displacement from where the shaft entered the hole
  friend bool operator==(const ShaftTissue&, const ShaftTissue&) = default;
};

/// The strength of bone from its HU: density = at_0_HU + per_HU * HU, strength by a published law
/// (runtime/cutting/bone_strength.h).
struct BoneByHu {
  std::string law;                    ///< its name
  std::string density = "qct";        ///< what the calibration gives: "qct", "ash" or "apparent"
  double per_HU = 8e-4, at_0_HU = 0;  ///< g/cm^3
  bool calibration_is_given = false;  ///< else the default, which is assumed
  friend bool operator==(const BoneByHu&, const BoneByHu&) = default;
};

/// What a tissue opposes to any tool that cuts through it (force law `cutting`).
struct CutTissue {
  std::optional<double> strength_MPa;  ///< over the area of the tool's outline
  std::optional<BoneByHu> bone;        ///< else the strength comes from HU
  double tearing_N_per_m = 0;          ///< of the outline's length
  /// The pressure under a flat tip over the bone's strength.
  double pressure_over_yield = 1;
  double modulus_MPa = 0;  ///< 0: the tip is as stiff as Tissue::stiffness_N_per_m
  /// Of the tip's faces, and of the wall, which presses on the shaft as on the tip.
  double friction_coefficient = 0;
  double friction_kPa = 0;          ///< along the shaft, over the area of its wall; is added
  double bed_N_per_mm3 = 0;         ///< sideways: pressure for a displacement
  double lateral_strength_MPa = 0;  ///< pressure at which a wall yields
  friend bool operator==(const CutTissue&, const CutTissue&) = default;
};

/// One elastic sheet; the defaults are the paper's.
struct Tissue {
  double stiffness_N_per_m = 5000;
  double threshold_N = 35;       ///< times the share of the tool over material: the sheet is
                                 ///< punctured in the tick in which F would exceed it
  double damping_N_s_per_m = 0;  ///< times the rate of dx, added to K dx; the sum is never negative
  ShaftTissue shaft;
  /// None: stiffness and threshold are those of the scene's tool, also for the law `cutting`.
  std::optional<CutTissue> cut;
  friend bool operator==(const Tissue&, const Tissue&) = default;
};

/// A tissue with a name, and the slices that it applies to: those of an asset made from one of
/// these labels, or whose mean HU is in this range. With neither: only slices that name it.
struct NamedTissue {
  std::string name;
  std::vector<int> labels;
  std::optional<std::array<double, 2>> hu;
  Tissue tissue;
};

/// How a sheet's force on the tool is computed. To add a law:
///  1. an enumerator here and its row in kForceLaws;
///  2. its object in formats/session/scene.schema.json;
///  3. only if it has parameters: ForceLaw below and read_force_law() in scene.cpp;
///  4. its force: a case in sheet_force(), runtime/contact/puncture.cpp. A law that is not one of
///     sheets, as `cutting`, has its own branch in wanted_wrench(),
///     runtime/control/haptic_loop.cpp.
enum class ForceLawKind : std::uint8_t {
  kHooke,    ///< F = K dx
  kNetwork,  ///< the reaction of the sheet's spring network (runtime/deformation)
  kCutting,  ///< one body of bone that the tool cuts through (runtime/cutting)
};
struct ForceLawTraits {
  const char* name;     ///< in scenes and on the command line
  bool needs_response;  ///< a worker prepares the spring network's response ahead of the tool
                        ///< (runtime/session/responder.h)
};
/// In the order of ForceLawKind.
inline constexpr std::array kForceLaws{ForceLawTraits{"hooke", false},
                                       ForceLawTraits{"network", true},
                                       ForceLawTraits{"cutting", false}};
static_assert(kForceLaws.size() == static_cast<std::size_t>(ForceLawKind::kCutting) + 1,
              "a row for each ForceLawKind");
constexpr const char* to_string(ForceLawKind law) noexcept {
  return kForceLaws[static_cast<std::size_t>(law)].name;
}
constexpr bool needs_response(ForceLawKind law) noexcept {
  return kForceLaws[static_cast<std::size_t>(law)].needs_response;
}
/// The law of that name, or none.
std::optional<ForceLawKind> force_law_from_string(std::string_view name) noexcept;
/// All names, each between two `quote`s, as a list with "or": for messages.
std::string force_law_names(const std::string& quote = "");

enum class NetworkSolver : std::uint8_t { kAuto, kLocal, kGlobal, kPropagation };

/// Soft tissue over the bone (force law `cutting`): a spring that stiffens, F = a1 z + a2 z^2,
/// until it is punctured, then cut at a constant force.
struct SceneLayer {
  std::string name;
  double top_z_m = 0, thickness_m = 0;
  double stiffness_N_per_m = 0, stiffening_N_per_m2 = 0;  ///< a1, a2
  double puncture_N = 0, cutting_N = 0;
  double friction_N_per_m = 0;  ///< of the shaft, of cut depth
};
inline constexpr std::size_t kMaxLayers = 8;

/// How the tool that cuts hangs on the plate.
enum class ToolAxis : std::uint8_t {
  kAuto,     ///< rigid where the tissue is softer than the coupling, else coupled
  kRigid,    ///< the tool is the plate
  kCoupled,  ///< by springs: ForceLaw::coupling_N_per_m
};
/// Where the law `cutting` is evaluated.
enum class PosePrediction : std::uint8_t {
  kAuto,  ///< a tick ahead if the device's damping is too small for the coupling
  kOn,
  kOff,
};

struct ForceLaw {
  ForceLawKind kind = ForceLawKind::kHooke;
  // kNetwork:
  NetworkSolver solver = NetworkSolver::kAuto;
  double reach_m = 0.01;      ///< decay length lambda of the sheet's response
  double error_bound = 0.01;  ///< kAuto: relative error of force and displacement
  double radius_m = 0.04;     ///< kLocal: radius of the region around the tool
  int depth = 6;              ///< kPropagation: number of vertex rings
  // kCutting:
  ToolAxis axis = ToolAxis::kAuto;
  double coupling_N_per_m = 10'000, coupling_Nm_per_rad = 25;
  PosePrediction prediction = PosePrediction::kAuto;
  double tip_friction = 0;  ///< coefficient of the tip across its axis, on what it presses on
  bool twist = false;       ///< turning the tool while it is pushed makes it cut more easily
  double force_scale = 1;   ///< the plate gets this times the tissue's wrench
};

/// Where the slice plane (u, v in mm; asset.md, Frames) lies in {B}:
/// p = at + R_z(rotation) (uv - anchor). u -> x, v -> y, slice normal -> z: never mirrored.
struct Placement {
  /// The point of the slice plane that lies at `at_m`; none: the centroid of the material of
  /// the scene's first slice. The same for all slices, so that they stay aligned.
  std::optional<std::array<double, 2>> anchor_mm;
  std::array<double, 2> at_m{0, 0};
  double rotation_deg = 0;
};

/// A run of slices at their true spacing (force law `cutting`), in place of Scene::slices: those
/// of the asset from one index to another that have material.
struct SceneBody {
  int from = 0, to = 0;     ///< AssetSlice::index, from <= to
  double top_z_m = 0;       ///< height in {B} of the highest of them
  double shell_m = 0;       ///< thickness of the cortical shell; 0: none
  double shell_factor = 1;  ///< its strength over that of the bone at the slice's outline
};

struct SceneSlice {
  int index = 0;   ///< AssetSlice::index
  double z_m = 0;  ///< height in {B}
  std::optional<std::string>
      tissue;  ///< NamedTissue::name; none: chosen by label, HU, or Scene::tissue
};

/// A prism along the tool's axis. Its cross-section is a regular polygon, or the polygon
/// `outline_m`, around the axis.
struct SceneTool {
  /// Of its tip, by the names of runtime/cutting/tool_in_tissue.h; empty: flat (force law
  /// `cutting`).
  std::string kind;
  double half_angle_deg = 30;  ///< of a tip that is not flat: between the axis and its faces
  double inner_radius_m = 0;   ///< of a hollow tool
  int sides = 6;
  double radius_m = 0.003;  ///< of the circumscribed circle
  /// If not empty, replaces `sides` and `radius_m`; simple, counter-clockwise seen from +z.
  std::vector<std::array<double, 2>> outline_m;
  double rotation_deg = 0;                        ///< of the cross-section about the axis
  std::array<double, 3> tip_in_plate_m{0, 0, 0};  ///< lower end of the axis in the plate's frame
  /// The axis is the plate's z axis tilted by tilt_deg towards tilt_azimuth_deg from its x axis.
  double tilt_deg = 0, tilt_azimuth_deg = 0;
};
/// Largest angle between the tool's axis and {B}'s z. With a larger one the tool would slide
/// instead of puncturing.
inline constexpr double kMaxTilt_deg = 45;

struct TipKeyframe {
  double t_s = 0;
  std::array<double, 3> tip_m{};         ///< wanted tool tip in {B}
  std::array<double, 3> rotation_deg{};  ///< wanted rotation of the plate: axis times angle, in {B}
};

enum class HandGrip : std::uint8_t { kFirm, kLight, kStiff };

/// The simulated hand: an impedance that pulls the tool tip along a trajectory. Absent values are
/// those of the grip (runtime/simulation/hand.h).
struct SceneHand {
  HandGrip grip = HandGrip::kFirm;
  std::optional<double> stiffness_N_per_m;
  std::optional<double> damping_N_s_per_m;
  std::optional<double> rotation_stiffness_Nm_per_rad;
  std::optional<double> rotation_damping_Nm_s_per_rad;
  std::optional<double> mass_kg;        ///< mass that moves with the tip
  std::optional<double> let_go_t_s;     ///< the hand exerts no force from this time on
  std::vector<TipKeyframe> trajectory;  ///< at least 1, in ascending time, the first at 0
};

/// The line that the tool's tip is to follow, from the entry point on.
struct PlannedLine {
  std::array<double, 3> entry_m{};
  std::array<double, 3> direction{};     ///< unit, into the tissue
  std::optional<double> entry_radius_m;  ///< largest distance from the line at the entry point
  std::optional<double> corridor_m;      ///< and anywhere below it
};

/// A volume in which the tip must not be, such as the spinal canal.
struct ForbiddenZone {
  enum class Shape : std::uint8_t { kCapsule, kBox, kPrism };
  std::string name;
  Shape shape = Shape::kCapsule;
  std::array<double, 3> low_m{}, high_m{};  ///< the capsule's ends; the box's corners
  double radius_m = 0;                      ///< of the capsule
  /// Of the prism: a simple polygon in x and y, extruded over z_m.
  std::vector<std::array<double, 2>> outline_m;
  std::array<double, 2> z_m{};
  double margin_m = 0;  ///< distance to be kept from it
};

struct GoalTarget {
  std::array<double, 3> at_m{};
  double radius_m = 0;
};

/// What a session is scored against (runtime/session/session_report.h); nothing here changes it.
/// Places are of the tool's tip, in {B}.
struct SceneGoals {
  std::optional<GoalTarget> target;
  std::optional<PlannedLine> line;
  std::optional<double> force_max_N;   ///< on the hand
  std::optional<double> time_max_s;    ///< from the first contact to the target or last puncture
  std::optional<double> plunge_max_m;  ///< after a break-through
  std::vector<ForbiddenZone> zones;
};

struct Scene {
  std::string name;
  std::filesystem::path asset;                  ///< resolved against the scene file's folder
  std::optional<std::filesystem::path> device;  ///< resolved in the same way; none: built in
  double duration_s = 0;
  std::optional<double> rate_Hz;
  Placement placement;
  std::vector<SceneSlice> slices;  ///< in the file's order; with a body made by place_body()
  std::optional<SceneBody> body;
  std::vector<SceneLayer> layers;    ///< from above
  Tissue tissue;                     ///< of slices for which none of `tissues` is chosen
  bool tissue_is_given = false;      ///< by the file; else `tissue` is the default
  std::vector<NamedTissue> tissues;  ///< a slice gets the first that applies to it
  ForceLaw force_law;
  SceneTool tool;
  SceneHand hand;
  std::optional<SceneGoals> goals;
};

inline constexpr double kMinRate_Hz = 100, kMaxRate_Hz = 8000;
inline constexpr double kMaxDuration_s = 86400;

/// Reads a scene from JSON text. Unknown or repeated keys, wrong types, and values that are not
/// finite or out of range are refused, with `name` and the JSON path in one line. Paths are
/// resolved against `folder`.
Result<Scene> parse_scene(std::string_view text, const std::string& name,
                          const std::filesystem::path& folder);
Result<Scene> read_scene(const std::filesystem::path& file);

}  // namespace trocar
