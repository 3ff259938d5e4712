// SPDX-License-Identifier: Apache-2.0
// The scene: which slices of which asset hang where in the device's frame {B}
// (origin in the base, z up, metres), what they are made of, what the tool is and
// what the simulated hand does. JSON, schema in formats/scene.schema.json.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "formats/result.h"

namespace trocar {

inline constexpr const char* kSceneSchema = "trocar.scene/1";
inline constexpr std::size_t kMaxSceneSlices = 64;
inline constexpr int kMaxToolSides = 32;
inline constexpr std::size_t kMaxKeyframes = 4096;
/// Two slices closer than this have no defined order for a tool that comes from above.
inline constexpr double kMinSliceGap_m = 1e-4;

/// One elastic sheet; the defaults are the paper's.
struct Tissue {
  double stiffness_N_per_m = 5000;
  double threshold_N = 35;       ///< the sheet gives way in the tick in which it would be exceeded
  double damping_N_s_per_m = 0;  ///< added to K dx, on the rate of dx; the sum never pulls
};

enum class ForceLaw : std::uint8_t { kHooke };

/// Where the slice plane (u along the image's columns, v along its rows, mm) lies in {B}:
/// p = at + R_z(rotation) (uv - anchor). u -> x, v -> y, slice normal -> z: never mirrored.
struct Placement {
  /// The point of the slice plane that lies at `at_m`; none: the centroid of the material of
  /// the first of the scene's slices. The same point serves all slices, so they stay in register.
  std::optional<std::array<double, 2>> anchor_mm;
  std::array<double, 2> at_m{0, 0};
  double rotation_deg = 0;
};

struct SceneSlice {
  int index = 0;   ///< AssetSlice::index
  double z_m = 0;  ///< height in {B}
};

/// A regular polygon whose plane is the plate's x-y plane.
struct SceneTool {
  int sides = 6;
  double radius_m = 0.003;                        ///< of the circumscribed circle
  double rotation_deg = 0;                        ///< of the first corner from the plate's x axis
  std::array<double, 3> tip_in_plate_m{0, 0, 0};  ///< centre of the polygon in the plate's frame
};

struct TipKeyframe {
  double t_s = 0;
  std::array<double, 3> tip_m{};  ///< wanted tool tip in {B}
};

/// The simulated hand: an impedance that pulls the tool tip along a trajectory. What is not
/// given is the simulated device's default.
struct SceneHand {
  std::optional<double> stiffness_N_per_m;
  std::optional<double> damping_N_s_per_m;
  std::optional<double> rotation_stiffness_Nm_per_rad;
  std::optional<double> rotation_damping_Nm_s_per_rad;
  std::vector<TipKeyframe> trajectory;  ///< >= 1, in ascending time, the first at 0
};

struct Scene {
  std::string name;
  std::filesystem::path asset;                  ///< resolved against the scene file's folder
  std::optional<std::filesystem::path> device;  ///< device description, likewise; none: built in
  double duration_s = 0;
  std::optional<double> rate_Hz;
  Placement placement;
  std::vector<SceneSlice> slices;  ///< in the file's order
  Tissue tissue;
  ForceLaw force_law = ForceLaw::kHooke;
  SceneTool tool;
  SceneHand hand;
};

inline constexpr double kMinRate_Hz = 100, kMaxRate_Hz = 8000;
inline constexpr double kMaxDuration_s = 86400;

/// Strict: unknown or repeated keys, wrong types, values that are not finite or out of range
/// are refused, with `name` and the JSON path in one line. Paths are resolved against `folder`.
Result<Scene> parse_scene(std::string_view text, const std::string& name,
                          const std::filesystem::path& folder);
Result<Scene> read_scene(const std::filesystem::path& file);

}  // namespace trocar
