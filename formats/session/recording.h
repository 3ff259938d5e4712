// SPDX-License-Identifier: Apache-2.0
// The recording: one CSV row a tick, a header that names every column and its unit,
// numbers in shortest round-trip form, so that what is read back is bit for bit what
// was written. Reading is strict: exactly these columns, every field complete.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "formats/base/result.h"
#include "formats/session/device_status.h"

namespace trocar {

/// What the tool does at the active slice, as a word in the recording.
enum class ContactPhase : std::uint8_t {
  kFree,       ///< "free": above every slice
  kContact,    ///< "contact": a slice bears the force
  kPunctured,  ///< "punctured": the slice that gave way last, tip below it
  kBeside,     ///< "beside": below a slice without having met material, or through an old hole
  kFault,      ///< "fault": latched; torques ramp to zero
};

/// Why the loop went into its safe state, as a word in the recording and the summary.
enum class Fault : std::uint8_t {
  kNone,
  kNoData,            ///< the device's link was silent for too long
  kLinkLost,          ///< the device's link is gone
  kWriteFailed,       ///< the device did not take the torques
  kEncoderNotFinite,  ///< an encoder angle is nan or infinite
  kEncoderJump,       ///< an encoder moved faster than the mechanism can
  kJointLimit,        ///< a motor angle is outside its limits
  kPoseResidual,      ///< the encoders contradict each other, or give no pose
  kSingularity,       ///< the Jacobian's inverse condition number, or a leg's distance to the end
                      ///< of its reach, is too small
  kTorqueNotFinite,   ///< the computed wrench or torques are not finite
  kDeadlineMissed,    ///< the gap between two ticks was too long, or too many were late in a row
  kRemeshBacklog,     ///< more cuts wait for their mesh than can be kept track of
  kToolTilt,          ///< the tool's axis is too far from upright
  kEmergencyStop,     ///< the device's emergency stop is pressed
  kMotorFault,        ///< the device reports a motor that does not give its torque
  kWorkspace,         ///< the plate is outside its box, or tilted too far
  kSpeed,             ///< the plate moves or turns too fast
  kTorqueLimit,       ///< a torque beyond the session's limit was asked of a motor
  kTorqueRate,        ///< the wanted torques rise faster than they may, for too long
  kMotorOverload,     ///< a motor has overdrawn its i2t budget, or gave too little for too long
};
inline constexpr int kFaults = 20;

/// What the loop is allowed to do, as a word in the recording (runtime/control/safety.h).
enum class SafetyState : std::uint8_t {
  kIdle,        ///< "idle": nothing was read from the device yet
  kReady,       ///< "ready": all is well, torques are zero
  kRunning,     ///< "running": forces are rendered
  kFault,       ///< "fault": latched; torques go to zero and stay there
  kRecovering,  ///< "recovering": asked for; torques are zero until the cause is gone
};
inline constexpr int kSafetyStates = 5;

const char* to_word(ContactPhase phase);
const char* to_word(Fault fault);
const char* to_word(SafetyState state);
/// Of a status that is recorded, not kEndOfData.
const char* to_word(DeviceStatus status);

/// One tick. Frame {B} throughout; wrenches are at the plate's origin: f, then t.
struct RecordingRow {
  double t_s = 0;                            ///< tick / rate
  std::array<double, 3> p_m{};               ///< plate's origin
  std::array<double, 4> q{1, 0, 0, 0};       ///< plate's orientation, w x y z
  std::array<double, 3> tool_m{};            ///< tool tip
  std::array<double, 6> wrench_wanted{};     ///< N, N*m
  std::array<double, 6> wrench_delivered{};  ///< what the torques below give
  std::array<double, 8> tau_Nm{};            ///< leg-major: th1, th4 of leg 1, ...
  std::array<double, 16> encoder_rad{};      ///< leg-major: th1, th2, th3, th4 of leg 1, ...
  ContactPhase phase = ContactPhase::kFree;
  std::int32_t active_slice = -1;   ///< asset's slice index; -1: none
  double penetration_m = 0;         ///< of the active slice; in the tick in which it
                                    ///< gives way, the one that broke it
  double wrench_scale = 1;          ///< < 1: scaled down, the motors cannot give it
  double pose_residual_m = 0;       ///< of the fit of the pose to the encoders
  std::int64_t cuts_published = 0;  ///< holes whose new mesh is in use, all slices
  /// The network's latest answer (law `network`), found off the haptic thread: an input of this
  /// tick like the encoders. Sheet -1: none.
  std::int32_t response_sheet = -1;  ///< the scene's topmost is 0
  double response_stiffness_N_per_m = 0;
  std::array<double, 2> response_offset_m{};  ///< of the force, from the tool's middle
  Fault fault = Fault::kNone;
  // What else a tick's torques depend on, so that a replay gives them to the last bit.
  DeviceStatus device_read = DeviceStatus::kOk, device_write = DeviceStatus::kOk;
  Fault outside_fault = Fault::kNone;  ///< found outside of the tick: late ticks, a full queue
  std::uint8_t recovery_asked = 0;     ///< 1: the operator asked for recovery at this tick
  // What the loop made of it.
  SafetyState safety = SafetyState::kIdle;
  double authority = 1;            ///< share of the wanted wrench; < 1 after a recovery
  double passivity_J = 0;          ///< the observer's balance; < 0: more was given than taken
  double passivity_N_s_per_m = 0;  ///< damping that the controller adds
  double motor_heat_max = 0;       ///< the largest share of its i2t budget that a motor has spent
};

/// The header line without its end: t_s,x_m,y_m,z_m,qw,qx,qy,qz,tool_x_m,...,
/// fx_wanted_N,...,tz_wanted_Nm,fx_delivered_N,...,tau_1_1_Nm,tau_1_4_Nm,... (leg, joint),
/// th_1_1_rad,th_1_2_rad,... (leg, joint),state,active_slice,penetration_m,wrench_scale,
/// pose_residual_m,cuts_published,response_sheet,response_stiffness_N_per_m,response_x_m,
/// response_y_m,fault,device_read,device_write,outside_fault,recovery_asked,safety,authority,
/// passivity_J,passivity_N_s_per_m,motor_heat_max
const std::string& recording_header();

/// A CSV that grows beside its target and replaces it in commit(); without that it is removed.
class RecordingWriter {
 public:
  /// Unwritable also where something is that is not a regular file.
  static Result<RecordingWriter> open(const std::filesystem::path& file);
  RecordingWriter(RecordingWriter&& other) noexcept;
  RecordingWriter& operator=(RecordingWriter&&) = delete;
  ~RecordingWriter();

  Result<void> append(std::span<const RecordingRow> rows);
  Result<void> commit();

 private:
  RecordingWriter(std::filesystem::path file, std::string temporary, int fd);
  Result<void> flush();
  Error failure(int error) const;

  std::filesystem::path file_;
  std::string temporary_;  ///< empty once committed or moved from
  int fd_ = -1;
  std::string buffer_;
};

/// The whole recording. Refused, naming line and column: another header, a missing or spare
/// field, a number that is not one or is not finite (encoders and responses excepted: a
/// broken one is what a recording may be about), t_s not ascending, an unknown word, no row at all.
Result<std::vector<RecordingRow>> parse_recording(std::string_view csv, const std::string& name);
Result<std::vector<RecordingRow>> read_recording(const std::filesystem::path& file);

}  // namespace trocar
