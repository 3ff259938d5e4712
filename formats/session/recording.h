// SPDX-License-Identifier: Apache-2.0
// The recording of a session: CSV, one row for each tick, a header with every column's name and
// unit. Numbers are in shortest round-trip form, so that reading gives the written values bit for
// bit. Reading is strict: exactly these columns, every field complete.
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
#include "formats/session/recording_origin.h"

namespace trocar {

/// The tool's contact state at the active slice.
enum class ContactPhase : std::uint8_t {
  kFree,       ///< "free": above every slice
  kContact,    ///< "contact": a slice bears the force
  kPunctured,  ///< "punctured": the tip is below the slice that was punctured last
  kBeside,     ///< "beside": below a slice, beside its material or through an older hole
  kFault,      ///< "fault": latched; torques ramp to zero
};

/// Why the loop entered its safe state; to_string() gives the name in recording and summary,
/// fault_words.h what it means and what to do.
enum class Fault : std::uint8_t {
  kNone,
  kNoData,            ///< no data from the device for too long
  kLinkLost,          ///< the device's link is lost
  kWriteFailed,       ///< the device did not accept the torques
  kEncoderNotFinite,  ///< an encoder angle is nan or infinite
  kEncoderJump,       ///< an encoder moved faster than the mechanism can
  kJointLimit,        ///< a motor angle is outside its limits
  kPoseResidual,      ///< the encoders contradict each other, or give no pose
  kSingularity,       ///< the Jacobian's inverse condition number, or a leg's distance to the end
                      ///< of its reach, is too small
  kTorqueNotFinite,   ///< the computed wrench or torques are not finite
  kDeadlineMissed,    ///< the gap between two ticks was too long, or too many were late in a row
  kRemeshBacklog,     ///< more cuts wait for their mesh than the queue holds
  kToolTilt,          ///< the tool's axis is too far from upright
  kEmergencyStop,     ///< the device's emergency stop is pressed, or the operator's
  kMotorFault,        ///< the device reports a motor that does not produce its torque
  kWorkspace,         ///< the plate is outside its box, or tilted too far
  kSpeed,             ///< the plate moves or rotates too fast
  kTorqueLimit,       ///< a motor's wanted torque exceeds the session's limit
  kTorqueRate,        ///< the wanted torques rise faster than they may, for too long
  kMotorOverload,     ///< a motor exceeded its i2t limit, or too little of the wanted wrench
                      ///< was rendered for too long
  kEnergy,            ///< the environment gave the hand more energy than it may
  kPaused,            ///< the operator pauses the session
  kForcesOff,         ///< the operator has turned the forces off
};
inline constexpr int kFaults = 23;

/// State of the safety layer (runtime/control/safety.h).
enum class SafetyState : std::uint8_t {
  kIdle,        ///< "idle": nothing read from the device yet
  kReady,       ///< "ready": no fault, torques are zero
  kRunning,     ///< "running": forces are rendered
  kFault,       ///< "fault": latched; torques ramp to zero and stay there
  kRecovering,  ///< "recovering": recovery was requested; torques are zero until the cause is gone
};
inline constexpr int kSafetyStates = 5;

const char* to_string(ContactPhase phase);
const char* to_string(Fault fault);
const char* to_string(SafetyState state);
/// Of a status that is recorded, not kEndOfData.
const char* to_string(DeviceStatus status);

/// One tick. Everything in frame {B}; wrenches are at the plate's origin: force, then torque.
struct RecordingRow {
  double t_s = 0;                            ///< tick / rate
  std::array<double, 3> p_m{};               ///< plate's origin
  std::array<double, 4> q{1, 0, 0, 0};       ///< plate's orientation, w x y z
  std::array<double, 3> tool_m{};            ///< tool tip
  std::array<double, 6> wrench_wanted{};     ///< N, N*m
  std::array<double, 6> wrench_delivered{};  ///< by the torques tau_Nm
  std::array<double, 8> tau_Nm{};            ///< leg-major: th1, th4 of leg 1, ...
  std::array<double, 16> encoder_rad{};      ///< leg-major: th1, th2, th3, th4 of leg 1, ...
  ContactPhase phase = ContactPhase::kFree;
  std::int32_t active_slice = -1;   ///< asset's slice index; -1: none
  double penetration_m = 0;         ///< of the active slice; in the tick of a puncture the
                                    ///< penetration at which it happened
  double wrench_scale = 1;          ///< < 1: scaled down to what the motors can produce
  double pose_residual_m = 0;       ///< of the fit of the pose to the encoders
  std::int64_t cuts_published = 0;  ///< holes whose new mesh is in use, over all slices
  /// The network's latest response (force law `network`). It is computed outside the haptic thread,
  /// so it is an input of this tick like the encoders. Sheet -1: none.
  std::int32_t response_sheet = -1;  ///< 0: the scene's topmost
  double response_stiffness_N_per_m = 0;
  std::array<double, 2> response_offset_m{};  ///< of the force, from the tool's centre
  Fault fault = Fault::kNone;
  // What else a tick's torques depend on, so that a replay gives them to the last bit.
  DeviceStatus device_read = DeviceStatus::kOk, device_write = DeviceStatus::kOk;
  double state_t_s = 0;                ///< on the device's clock: when these encoders were read
  Fault outside_fault = Fault::kNone;  ///< found outside of the tick: late ticks, a full queue
  std::uint8_t recovery_asked = 0;     ///< 1: the operator requested recovery at this tick
  // Results of the tick.
  SafetyState safety = SafetyState::kIdle;
  double authority = 1;    ///< share of the wanted wrench; < 1 after a recovery
  double passivity_J = 0;  ///< the observer's energy; < 0: more was given to the hand than taken
  double passivity_N_s_per_m = 0;  ///< damping added by the controller
  double motor_heat_max = 0;       ///< largest i2t thermal state of a motor; 1: its limit
  /// Force law `cutting` only: of the tissue, before the scene's force scale.
  struct Cutting {
    std::array<double, 6> wrench_tissue{};  ///< on the plate, N, N*m
    double front_z_m = 0;                   ///< height of the front, or of the next bone below
    /// Mean HU under the tool in the front's slice, before any cut; -1000: no material, 0: the
    /// asset has no HU.
    double front_HU = 0;
    double tip_N = 0;        ///< along the shaft
    double embedded_m = 0;   ///< length of the shaft in the body
    double cut_J = 0;        ///< front work since the session began
    double absorbed_J = 0;   ///< work of the hand on the tissue since it began
    double stored_J = 0;     ///< in all elements now
    std::int32_t steps = 0;  ///< of Newton's method
  } cutting;
};

/// The header line without its line feed: t_s,x_m,y_m,z_m,qw,qx,qy,qz,tool_x_m,...,
/// fx_wanted_N,...,tz_wanted_Nm,fx_delivered_N,...,tau_1_1_Nm,tau_1_4_Nm,... (leg, joint),
/// th_1_1_rad,th_1_2_rad,... (leg, joint),state,active_slice,penetration_m,wrench_scale,
/// pose_residual_m,cuts_published,response_sheet,response_stiffness_N_per_m,response_x_m,
/// response_y_m,fault,device_read,state_t_s,device_write,outside_fault,recovery_asked,safety,
/// authority,passivity_J,passivity_N_s_per_m,motor_heat_max,origin. The last, to_text() of the
/// RecordingOrigin, is empty but in the first row. Of a session whose origin says
/// `force-law=cutting` there are further columns before it:
/// fx_tissue_N,...,tz_tissue_Nm,front_z_m,front_HU,tip_N,embedded_m,cut_J,absorbed_J,
/// tissue_stored_J,steps.
const std::string& recording_header(bool with_cutting = false);

/// Added to a recording's name while it is being written.
inline constexpr const char* kPartialSuffix = ".partial";

/// Writes a CSV under the target's name with kPartialSuffix. commit() renames it to the target.
/// Without commit(), or after a failure such as a full disk, it stays there with the whole rows
/// that could be written, unless there are none. If the program is killed the rows of the last 1
/// MiB may be missing and the last line may be cut.
class RecordingWriter {
 public:
  /// Fails (unwritable) also if the target exists and is not a regular file, or is being recorded.
  /// A partial file that an interrupted recording left is renamed to NAME.partial.1, .2 and so on.
  static Result<RecordingWriter> open(const std::filesystem::path& file,
                                      const RecordingOrigin& origin = {});
  RecordingWriter(RecordingWriter&& other) noexcept;
  RecordingWriter& operator=(RecordingWriter&&) = delete;
  ~RecordingWriter();

  /// After a failure, which names the number of rows kept and their file, only the destructor may
  /// be called; likewise with commit().
  Result<void> append(std::span<const RecordingRow> rows);
  Result<void> commit();
  /// The file while it is being written.
  std::filesystem::path partial_file() const { return partial_; }

 private:
  RecordingWriter(std::filesystem::path file, std::string partial, int fd, bool with_cutting);
  Result<void> flush();
  void end();
  Error failure(int error);

  std::filesystem::path file_;
  std::string partial_;  ///< empty once committed or moved from
  int fd_ = -1;
  std::string buffer_;
  bool with_cutting_ = false;
  std::string origin_;       ///< until the first row is written
  std::uint64_t lines_ = 0;  ///< written as a whole, with the header
};

/// The whole recording. Refused, naming line and column: another header, a missing or surplus
/// field, text that is not a number, a number that is not finite (allowed in encoders and
/// responses: such faults are recorded), t_s not ascending, an unknown name, no row. Columns that
/// recordings of older versions do not have may be absent. `origin`: gets the
/// recording's, without entries if it has none.
Result<std::vector<RecordingRow>> parse_recording(std::string_view csv, const std::string& name,
                                                  RecordingOrigin* origin = nullptr);
Result<std::vector<RecordingRow>> read_recording(const std::filesystem::path& file,
                                                 RecordingOrigin* origin = nullptr);

}  // namespace trocar
