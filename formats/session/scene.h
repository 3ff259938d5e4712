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

/// One elastic sheet; the defaults are the paper's.
struct Tissue {
  double stiffness_N_per_m = 5000;
  double threshold_N = 35;       ///< times the share of the tool over material: the sheet is
                                 ///< punctured in the tick in which F would exceed it
  double damping_N_s_per_m = 0;  ///< times the rate of dx, added to K dx; the sum is never negative
  ShaftTissue shaft;
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
///  4. its force: a case in sheet_force(), runtime/contact/puncture.cpp.
enum class ForceLawKind : std::uint8_t {
  kHooke,    ///< F = K dx
  kNetwork,  ///< the reaction of the sheet's spring network (runtime/deformation)
};
struct ForceLawTraits {
  const char* name;     ///< in scenes and on the command line
  bool needs_response;  ///< a worker prepares the spring network's response ahead of the tool
                        ///< (runtime/session/responder.h)
};
/// In the order of ForceLawKind.
inline constexpr std::array kForceLaws{ForceLawTraits{"hooke", false},
                                       ForceLawTraits{"network", true}};
static_assert(kForceLaws.size() == static_cast<std::size_t>(ForceLawKind::kNetwork) + 1,
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

struct ForceLaw {
  ForceLawKind kind = ForceLawKind::kHooke;
  // kNetwork:
  NetworkSolver solver = NetworkSolver::kAuto;
  double reach_m = 0.01;      ///< decay length lambda of the sheet's response
  double error_bound = 0.01;  ///< kAuto: relative error of force and displacement
  double radius_m = 0.04;     ///< kLocal: radius of the region around the tool
  int depth = 6;              ///< kPropagation: number of vertex rings
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

struct SceneSlice {
  int index = 0;   ///< AssetSlice::index
  double z_m = 0;  ///< height in {B}
  std::optional<std::string>
      tissue;  ///< NamedTissue::name; none: chosen by label, HU, or Scene::tissue
};

/// A prism along the tool's axis. Its cross-section is a regular polygon, or the polygon
/// `outline_m`, around the axis.
struct SceneTool {
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

struct Scene {
  std::string name;
  std::filesystem::path asset;                  ///< resolved against the scene file's folder
  std::optional<std::filesystem::path> device;  ///< resolved in the same way; none: built in
  double duration_s = 0;
  std::optional<double> rate_Hz;
  Placement placement;
  std::vector<SceneSlice> slices;    ///< in the file's order
  Tissue tissue;                     ///< of slices for which none of `tissues` is chosen
  bool tissue_is_given = false;      ///< by the file; else `tissue` is the default
  std::vector<NamedTissue> tissues;  ///< a slice gets the first that applies to it
  ForceLaw force_law;
  SceneTool tool;
  SceneHand hand;
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
