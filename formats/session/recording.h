// SPDX-License-Identifier: Apache-2.0
// The recording of a session: its rows, its origin, its file.
#pragma once

#include <array>
#include <chrono>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "formats/base/files.h"
#include "formats/base/result.h"

namespace trocar {

/// The status that a haptic device returns for a read or a write. It is recorded in each tick. The
/// comments give each status's name in recordings, in quotes.
enum class DeviceStatus : std::uint8_t {
  kOk,             ///< "ok"
  kNoData,         ///< "no_data": a read gave no new state, or a write was not accepted
  kLinkLost,       ///< "link_lost"
  kEmergencyStop,  ///< "emergency_stop": the stop is pressed; the drives hold the torques at zero
  kMotorFault,     ///< "motor_fault": the drives report a motor that does not give its torque
  kEndOfData,      ///< the end of a replayed recording; never recorded
};
inline constexpr int kRecordedDeviceStatuses = 5;  ///< all except kEndOfData

// The provenance of a recording: the program's version, digests of scene, asset and device
// description, the options on which torques depend, and the session's duration if it is not the
// scene's. In the CSV, the first row has the provenance as text in the column `origin`:
// "program=0.2.0;scene=DIGEST;...", without commas, quotes or blanks.

/// The key of the program's version; all other keys are inputs of the session.
inline constexpr const char* kOriginProgram = "program";
/// Keys whose value is a digest: BLAKE2b-256, hexadecimal, as `b2sum -l 256` gives it.
inline constexpr const char* kOriginScene = "scene";
inline constexpr const char* kOriginAsset = "asset";
inline constexpr const char* kOriginDevice = "device";  ///< a digest, "built-in" or "built-in/NAME"
/// Key and value of the entry for the kind of device. Only recordings of a pose device have it.
inline constexpr const char* kOriginDeviceKind = "device-kind";
inline constexpr const char* kPoseDeviceKind = "pose";
/// Key of an entry that only recordings with the operator's X-ray have. The value "counted" means
/// that the rows have the column `xray`, from which pictures and screening time are counted.
inline constexpr const char* kOriginXray = "xray";
/// Bandwidth (1/s) and lead (s) of the estimator in translation, then in rotation, by slashes; and
/// the device's delay (s). Recordings of versions before 0.4.0 have neither.
inline constexpr const char* kOriginEstimator = "estimator";
inline constexpr const char* kOriginDelay = "delay";

struct RecordingOrigin {
  std::vector<std::pair<std::string, std::string>> entries;  ///< key, value; no entries if unknown

  /// The value of a key, or null.
  const std::string* find(std::string_view key) const;
  /// The value of a key as a number; std::nullopt if the key is missing or has no number as value.
  std::optional<double> number(std::string_view key) const;
  friend bool operator==(const RecordingOrigin&, const RecordingOrigin&) = default;
};

/// The text of a number in an entry: the shortest text from which the same number is read again.
std::string origin_number(double x);

/// The text for the CSV. Precondition: keys and values consist of letters, digits, '.', '_',
/// '+', '-' and '/'.
std::string to_text(const RecordingOrigin& origin);

/// Reads what to_text() wrote; an empty text gives no entries. Errors: kRefused if the text has
/// another form or more than 4096 characters, or if a key is empty or repeated.
Result<RecordingOrigin> parse_origin(std::string_view text);

/// Describes the differences between the origin of a recording and that of a run, such as "the
/// scene (0123456789ab..., here cdef01234567...), passivity (on, here off)". Empty if there are no
/// differences. The program's version is not compared. If the run has a key that the recording does
/// not have, this is a difference only if recording and run name the same version of the program.
/// With different versions it is ignored, because an older program may not have known the key.
std::string differences(const RecordingOrigin& recorded, const RecordingOrigin& run);

// The recording of a session: a CSV file with one row for each tick and a header with every
// column's name and unit. Numbers are written in shortest round-trip form, so that reading gives
// the written values bit for bit. Reading is strict: a file with unknown columns or with a missing
// or incomplete field is refused.

/// The tool's contact state at the active slice (RecordingRow::active_slice). The comments give the
/// names in recordings, in quotes.
enum class ContactPhase : std::uint8_t {
  kFree,       ///< "free": the tip is above every slice
  kContact,    ///< "contact": a slice bears the force
  kPunctured,  ///< "punctured": the tip is below the slice that was last punctured
  kMissed,     ///< "beside": the tip passed a slice beside its material or through an old hole
  kFault,      ///< "fault": a fault is latched; torques ramp to zero
};

/// The reason why the loop entered its safe state. to_string() gives the name in recordings and
/// summaries; faults.h has the meaning and the advice.
enum class Fault : std::uint8_t {
  kNone,
  kNoData,            ///< no data came from the device for too long
  kLinkLost,          ///< the device's link is lost
  kWriteFailed,       ///< the device did not accept the torques
  kEncoderNotFinite,  ///< an encoder angle is nan or infinite
  kEncoderJump,       ///< an encoder moved faster than the mechanism can
  kJointLimit,        ///< a measured joint angle is outside its limits
  kPoseResidual,      ///< the encoders contradict each other, or give no pose
  kSingularity,       ///< the inverse condition number of the Jacobian, or a leg's distance to the
                      ///< edge of its workspace, is too small
  kTorqueNotFinite,   ///< the computed wrench or torques are not finite
  kDeadlineMissed,    ///< two ticks were too far apart, or too many in a row were late
  kRemeshBacklog,     ///< more holes wait for a new mesh than the queue can hold
  kToolTilt,          ///< the tool's axis is too far from upright
  kEmergencyStop,     ///< the emergency stop of the device or of the operator is pressed
  kMotorFault,        ///< the device reports a motor that does not produce its torque
  kWorkspace,         ///< the plate is outside its box, or tilted too far
  kSpeed,             ///< the plate moves or rotates too fast
  kTorqueLimit,       ///< a motor's wanted torque exceeds the session's limit
  kTorqueRate,        ///< the wanted torques rise faster than they may, for too long
  kMotorOverload,     ///< a motor exceeded its i2t limit, or too little of the wanted wrench
                      ///< was rendered for too long
  kEnergyLimit,       ///< the hand received more energy than the energy limit allows
  kPaused,            ///< the operator has paused the session
  kForcesOff,         ///< the operator has turned the forces off
  kRecordingFailed,   ///< the recording cannot be written; the session ends after the ramp
  kRefusedState,      ///< the device's states arrive, but are refused because of their contents
};
inline constexpr int kFaults = 25;

/// State of the safety layer (runtime/haptics/loop/safety.h).
enum class SafetyState : std::uint8_t {
  kIdle,        ///< "idle": nothing read from the device yet
  kReady,       ///< "ready": no fault, torques are zero
  kRunning,     ///< "running": forces are rendered
  kFault,       ///< "fault": a fault is latched; torques ramp to zero and stay zero
  kRecovering,  ///< "recovering": recovery was requested; torques are zero until the cause is gone
};
inline constexpr int kSafetyStates = 5;

const char* to_string(ContactPhase phase);
const char* to_string(Fault fault);
const char* to_string(SafetyState state);
/// Precondition: `status` is not kEndOfData, which is never recorded.
const char* to_string(DeviceStatus status);

/// Bits of RecordingRow::xray. kXrayPicture: a single picture was taken. kXrayBeam: X-ray
/// screening was on.
inline constexpr std::uint8_t kXrayPicture = 1, kXrayBeam = 2;

inline constexpr std::int32_t kBreakThroughLayer = -2;

/// One tick. Positions and vectors are in the frame {B}. A wrench acts at the plate's origin; its
/// components are those of the force, then those of the torque.
struct RecordingRow {
  double t_s = 0;                       ///< number of the tick, divided by the loop rate
  std::array<double, 3> p_m{};          ///< position of the plate's origin
  std::array<double, 4> q{1, 0, 0, 0};  ///< orientation of the plate, w x y z
  /// Position of the tip of the tool on which the tissue acts. With a coupling, this tool is the
  /// proxy, which springs connect to the plate, so its tip can lie away from the tip of a tool that
  /// is fixed to the plate.
  std::array<double, 3> tool_m{};
  std::array<double, 6> wrench_wanted{};     ///< wrench before motor limits, N, N*m
  std::array<double, 6> wrench_delivered{};  ///< wrench that the torques tau_Nm produce
  std::array<double, 8> tau_Nm{};            ///< motor torques: th1, th4 of leg 1, of leg 2, ...
  std::array<double, 16> encoder_rad{};      ///< leg by leg: th1, th2, th3, th4 of leg 1, ...
  ContactPhase phase = ContactPhase::kFree;
  std::int32_t active_slice = -1;  ///< index of the slice in the asset; -1: none
  /// Depth of the tip below the active slice. With the force law `cutting`: how far the tip of a
  /// tool fixed to the plate (not the proxy's tip) is below the cutting front. In the tick of a
  /// puncture: the depth at the puncture.
  double penetration_m = 0;
  double wrench_scale = 1;          ///< delivered wrench / wanted wrench; < 1 if a motor saturates
  double pose_residual_m = 0;       ///< residual of the pose fitted to the encoders
  std::int64_t cuts_published = 0;  ///< number of holes whose new mesh is in use, over all slices
  /// The latest prefetched stiffness (force law `network`): the stiffness of a sheet at one
  /// position of the tool. The prefetch worker computes it outside the haptic thread, so it is an
  /// input of this tick, like the encoder angles.
  std::int32_t response_sheet = -1;  ///< index of the sheet, 0 for the topmost; -1: none
  double response_stiffness_N_per_m = 0;
  /// Point of the sheet where its force acts, relative to the tool's axis.
  std::array<double, 2> response_offset_m{};
  Fault fault = Fault::kNone;
  // The members from here to `xray` are further inputs of the tick. From the recorded inputs, a
  // replay reproduces the torques to the last bit.
  DeviceStatus device_read = DeviceStatus::kOk, device_write = DeviceStatus::kOk;
  double state_t_s = 0;  ///< time at which the device was read, on the device's clock
  /// Fault that was detected outside the tick, for example because ticks were late.
  Fault outside_fault = Fault::kNone;
  std::uint8_t recovery_asked = 0;  ///< 1: recovery was requested in this tick, perhaps in vain
  /// The operator's X-ray in this tick: kXrayPicture, kXrayBeam, both or 0.
  std::uint8_t xray = 0;
  // Results of the tick.
  SafetyState safety = SafetyState::kIdle;
  double authority = 1;    ///< factor on the force law's wrench; rises from 0 to 1 after a recovery
  double passivity_J = 0;  ///< energy balance of the passivity observer; < 0: the hand received
                           ///< more energy than it gave
  double guard = 1;  ///< the guard's factor on the law's wrench (runtime/haptics/loop/guard.h)
  double passivity_N_s_per_m = 0;  ///< 0: of a controller that versions before 0.4.0 had
  double motor_heat_max = 0;       ///< largest i2t thermal state of a motor; 1 is its limit
  /// Force of the tissue on the tip (bone, sheets and soft layers), before the scene's force scale:
  /// along the shaft, with the laws `hooke` and `network` along z.
  double tip_N = 0;
  /// A break-through that was found in this tick (runtime/haptics/loop/break_through.h): the resistance
  /// before it, as a force on the tip like tip_N; 0: none was found.
  double break_through_N = 0;
  /// Where: the slice that was punctured last, or is in contact; kBreakThroughLayer - i: the soft
  /// layer i; -1: nothing is known, or no break-through.
  std::int32_t break_through_at = -1;
  /// Results of the force law `cutting`, before they are multiplied by the scene's force scale.
  struct Cutting {
    std::array<double, 6> wrench_tissue{};  ///< wrench on the plate, N, N*m
    /// Height of the cutting front: down to this height bone has been cut. If the tip is above the
    /// bone, the height of the next bone below the tip; 0 if there is no bone below.
    double front_z_m = 0;
    /// Mean HU of the uncut bone under the tool, in the slice of the cutting front. -1000 if there
    /// is nothing under the tool, 0 if the asset has no HU.
    double front_HU = 0;
    double embedded_m = 0;   ///< length of the shaft inside the bone volume
    double cut_J = 0;        ///< work of cutting since the session began
    double absorbed_J = 0;   ///< work of the hand on the tissue since the session began
    double stored_J = 0;     ///< elastic energy that tissue and coupling store
    std::int32_t steps = 0;  ///< Newton steps with which the law solved this tick
  } cutting;
  /// Measured pose and commanded wrench of a device that measures its own pose, in the device's
  /// frame. In recordings they take the place of torques and encoder angles.
  struct PoseDevice {
    std::array<double, 3> p_m{};          ///< the point of the handle on which the wrench acts
    std::array<double, 4> q{1, 0, 0, 0};  ///< orientation, w x y z
    std::uint32_t buttons = 0;            ///< bit i: button i is pressed
    std::array<double, 6> wrench{};       ///< commanded force and moment, N, N*m
  } pose_device;
};

/// A line about a break-through: RecordingRow::break_through_at, t_s and break_through_N.
std::string describe_break_through(std::int32_t at, double t_s, double resistance_N);

/// The columns in which recordings differ.
struct RecordingKind {
  bool has_cutting = false;      ///< columns of the force law `cutting`
  bool has_pose_device = false;  ///< columns of a pose device instead of torques and encoder angles
  bool has_xray = false;         ///< the column of the operator's X-ray
  bool has_guard = false;        ///< the column of the guard; false: of a version before 0.4.0
};
/// Derives the kind from the origin: has_cutting from `force-law=cutting`, has_pose_device from
/// `device-kind=pose`, has_xray from any entry `xray`, and has_guard from any entry `estimator`.
RecordingKind recording_kind(const RecordingOrigin& origin);

/// The header line without its line feed: t_s,x_m,y_m,z_m,qw,qx,qy,qz,tool_x_m,...,
/// fx_wanted_N,...,tz_wanted_Nm,fx_delivered_N,...,tau_1_1_Nm,tau_1_4_Nm,... (leg, joint),
/// th_1_1_rad,th_1_2_rad,... (leg, joint),state,active_slice,penetration_m,wrench_scale,
/// pose_residual_m,cuts_published,response_sheet,response_stiffness_N_per_m,response_x_m,
/// response_y_m,fault,device_read,state_t_s,device_write,outside_fault,recovery_asked,safety,
/// authority,passivity_J,passivity_N_s_per_m,motor_heat_max,tip_N,break_through_N,
/// break_through_at,origin. The column origin holds to_text() of the RecordingOrigin in the first
/// row and is empty in all other rows. With has_guard, the column guard follows passivity_N_s_per_m.
/// With has_cutting, these columns take the place of tip_N: fx_tissue_N,...,tz_tissue_Nm,front_z_m,
/// front_HU,tip_N,embedded_m,cut_J,absorbed_J,tissue_stored_J,steps. With has_xray, the column xray
/// follows motor_heat_max. With has_pose_device, the columns device_x_m,device_y_m,device_z_m,
/// device_qw,...,device_qz,buttons,fx_device_N,...,tz_device_Nm take the place of tau_* and th_*.
std::string recording_header(const RecordingKind& kind = {});

/// Size in bytes of the largest recording that read_recording() reads.
inline constexpr std::uint64_t kMaxRecordingBytes = std::uint64_t{1} << 32;

/// Suffix of a recording's name while it is being written.
inline constexpr const char* kPartialSuffix = ".partial";

/// Returns true if the name is that of a partial file: NAME.partial, or NAME.partial.1 and so on.
bool is_partial_name(std::string_view name);
/// Returns true if a program is writing this partial file.
bool is_being_recorded(const std::filesystem::path& partial);

/// Writes a recording. The rows are written to a partial file, whose name is the target's name with
/// kPartialSuffix. commit() renames the partial file to the target. Without commit(), or if it fails,
/// the partial file stays, with all rows that were written completely. A partial file without rows
/// is removed. If the program is killed, the rows since the last write are missing (kFlushWithin), and
/// the last line may be incomplete. Only the owner may read the files, because recordings name
/// trainees; a target that is replaced passes its permissions on.
class RecordingWriter {
 public:
  /// append() writes what it holds if this time has passed since the last write. Call it at least
  /// this often, also without rows.
  static constexpr std::chrono::milliseconds kFlushWithin{100};

  /// Creates the partial file. A partial file that an interrupted recording left is first renamed
  /// to NAME.partial.1, .2 and so on. Errors: kUnwritable if the target cannot be created, is not a
  /// regular file, or is being written by another program, or if the disk is full.
  static Result<RecordingWriter> open(const std::filesystem::path& file,
                                      const RecordingOrigin& origin = {});
  RecordingWriter(RecordingWriter&& other) = default;
  ~RecordingWriter();

  /// Takes rows. Errors: kUnwritable, "FILE: REASON". The rows that could not be written are kept in
  /// memory, and the next call tries again. The file then ends with a whole row.
  Result<void> append(std::span<const RecordingRow> rows);
  /// Ends the recording. If no row was appended, writes no recording, because readers refuse a
  /// recording without rows; an earlier recording at the target then stays. Errors: like append();
  /// after one, only kept() and the destructor may be called.
  Result<void> commit();
  /// "the first N rows are in FILE" or "no row was kept".
  std::string kept() const;
  const std::filesystem::path& file() const { return file_; }

  /// Mean size of a row so far, without the origin; 0 before the first row.
  double bytes_per_row() const;
  /// Number of bytes that still fit on the disk, if that is known.
  std::optional<std::uint64_t> free_bytes() const;

 private:
  RecordingWriter(std::filesystem::path file, std::string partial, FileDescriptor fd,
                  const RecordingKind& kind);
  Result<void> flush();
  void end();
  Error failure(int error) const;

  std::filesystem::path file_;
  std::string partial_;
  FileDescriptor fd_;  ///< of the partial file, until it is renamed or removed
  std::string buffer_;
  RecordingKind kind_;
  std::string origin_;                  ///< text for the first row; empty once it is written
  std::uint64_t lines_ = 0;             ///< number of complete lines written, including the header
  std::uint64_t rows_ = 0, bytes_ = 0;  ///< taken so far, without header and origin
  std::filesystem::path rows_in_;       ///< file that has the rows
  std::chrono::steady_clock::time_point flushed_at_;
};

/// Reads a complete recording. If `origin` is not null, sets `*origin` to the recording's origin, or to an origin without entries if the
/// recording has none. Errors: kRefused for an unknown header, a missing or surplus field, text
/// that is not a number, t_s that does not ascend, an unknown name, or no rows. An infinite or nan
/// number is also refused, except in encoder angles, measured poses and prefetched stiffness, where
/// it is a fault of the session that the recording must show. Messages have the line and, if there
/// is one, the column. A killed program may leave an incomplete last line. If `is_cut` is null, such
/// a recording is refused; otherwise the line is left out, and `*is_cut` says whether there was one.
Result<std::vector<RecordingRow>> parse_recording(std::string_view csv, const std::string& name,
                                                  RecordingOrigin* origin = nullptr,
                                                  bool* is_cut = nullptr);
/// Like parse_recording() of the file's contents. Also refuses a file of more than
/// kMaxRecordingBytes.
Result<std::vector<RecordingRow>> read_recording(const std::filesystem::path& file,
                                                 RecordingOrigin* origin = nullptr,
                                                 bool* is_cut = nullptr);

}  // namespace trocar
