// SPDX-License-Identifier: Apache-2.0
// Faults: which stops are held, where faults begin, what a check measured, and their words.
#pragma once

#include <cstdint>
#include <string>

#include "formats/session/recording.h"

namespace trocar {

/// True for the faults that stops raise. A failed check raises the others.
constexpr bool is_stop(Fault fault) noexcept {
  return fault == Fault::kEmergencyStop || fault == Fault::kPaused || fault == Fault::kForcesOff;
}

/// Which stops are held, from the rows of a session in order. There are four: the device's own
/// emergency stop, and the operator's commands emergency stop, pause and zero forces. The loop and
/// the readers of recordings share this rule, so they count the same presses.
class HeldStops {
 public:
  /// Takes a tick's inputs: the status of its read, and RecordingRow::outside_fault. A read without
  /// data, or of a lost link, says nothing about the device's stop: it stays as it was. Returns true
  /// if an emergency stop, the device's or the operator's, is newly pressed.
  bool take(DeviceStatus read, Fault outside) noexcept {
    const bool device_was = device_, operator_was = outside_ == Fault::kEmergencyStop;
    if (read != DeviceStatus::kNoData && read != DeviceStatus::kLinkLost)
      device_ = read == DeviceStatus::kEmergencyStop || is_told_by_write_;
    is_released_now_ = device_was && !device_;
    outside_ = outside;
    return (device_ && !device_was) || (outside == Fault::kEmergencyStop && !operator_was);
  }
  /// Takes the status of the tick's write, after take(). Returns true as take() does.
  bool take_write(DeviceStatus written) noexcept {
    is_told_by_write_ = written == DeviceStatus::kEmergencyStop;
    const bool was = device_;
    device_ |= is_told_by_write_;
    return device_ && !was;
  }
  /// take() and take_write() of a recorded row.
  bool take(const RecordingRow& row) noexcept {
    const bool is_pressed = take(row.device_read, row.outside_fault);
    return take_write(row.device_write) || is_pressed;
  }

  bool is_device_held() const noexcept { return device_; }
  bool any() const noexcept { return device_ || is_stop(outside_); }
  /// A request for recovery seen in this tick is not newer than the release of every stop.
  bool refuse_recovery() const noexcept { return any() || is_released_now_; }

 private:
  bool device_ = false, is_told_by_write_ = false, is_released_now_ = false;
  Fault outside_ = Fault::kNone;
};

/// Finds the rows in which a fault begins, from the rows of a session in order.
class FaultStarts {
 public:
  /// Returns true if a fault was latched in this row. A stop that is pressed again while an
  /// emergency stop is latched is a new fault, although RecordingRow::fault does not change.
  bool take(const RecordingRow& row) noexcept {
    const bool is_pressed = stops_.take(row);
    const bool is_back = safety_ == SafetyState::kRecovering && row.safety == SafetyState::kFault;
    const bool is_new = row.fault != Fault::kNone && (row.fault != fault_ || is_back || is_pressed);
    safety_ = row.safety;
    fault_ = row.fault;
    return is_new;
  }

 private:
  HeldStops stops_;
  SafetyState safety_ = SafetyState::kIdle;
  Fault fault_ = Fault::kNone;
};

// The result of a safety check, and words that describe it. One table has the name, meaning and
// advice of every fault. Another table has every quantity that a check can measure. A fault or
// quantity that is missing in its table is a compile error.

/// The quantity that a check measured; faults.cpp has its words and unit.
/// The comments give the unit and, if FaultDetail::index is used, the thing that it numbers.
enum class FaultQuantity : std::uint8_t {
  kNone,                 ///< nothing was measured: a device reported the fault, or a solver failed
  kTimeWithoutData,      ///< time without data from the device, s
  kEncoderAngle,         ///< angle of an encoder, rad; index: encoder
  kEncoderStep,          ///< change of angle since the last data, rad; index: encoder
  kEncoderResidual,      ///< difference between a measured angle and its value at the pose that is
                         ///< fitted to the encoders, rad; index: encoder
  kPoseResidual,         ///< root mean square error of the pose fitted to the encoders, m
  kInverseCondition,     ///< inverse condition number of the Jacobian
  kBranchDistance,       ///< distance of a leg from the edge of its workspace, m; index: leg
  kTickGap,              ///< time between the starts of two ticks, s
  kMissedDeadlines,      ///< number of consecutive missed deadlines
  kWaitingHoles,         ///< number of requested holes that have no mesh yet
  kToolTilt,             ///< angle between the tool's axis and upright, rad
  kPlatePosition,        ///< coordinate of the plate's origin, m; index: axis
  kPlateTilt,            ///< angle between the plate's axis and upright, rad
  kPlateSpeed,           ///< speed of the plate, m/s
  kPlateRotation,        ///< rotation rate of the plate, rad/s
  kPrefetchedStiffness,  ///< prefetched stiffness of the spring network, N/m
  kWantedWrench,         ///< component of the wanted wrench, N or N m; index: 0..5
  kMotorTorque,          ///< wanted torque of a motor, N m; index: motor
  kCompensationTorque,   ///< torque against friction and weight, N m; index: motor
  kTorqueRiseTime,       ///< time for which torques rose at the largest allowed rate, s
  kMotorHeat,            ///< i2t state as a fraction of its limit; index: motor
  kWeakForceTime,        ///< time for which too little of the wanted force was rendered, s
  kMotor,                ///< no value; index: motor
  kReleasedEnergy,       ///< energy that the hand received within at most 0.1 s, beyond what tissue
                         ///< and coupling had stored at the beginning of this time, J
  kMeasuredPosition,     ///< position that a pose device measured, m; index: axis
  kMeasuredRotation,     ///< length of the quaternion that a pose device measured
  kPositionStep,         ///< change of the measured position since the last data, m
  kRotationStep,         ///< change of the measured orientation since the last data, rad
  kFaultByte,            ///< byte with which a pose device reports its fault; its maker chooses the
                         ///< meaning
  kRefusedContents,      ///< no value: a message of the device that cannot be read
  kStateMode,            ///< mode that a drive states, as a number
  kStateZeros,           ///< no value: a drive states another byte than zero where zero is required
};
inline constexpr int kFaultQuantities = 33;

/// The result of a check: a fault or none, and the value that was above or below its limit. The
/// structure has no text, because the haptic thread fills it. Another thread composes the text.
struct FaultDetail {
  FaultDetail() = default;
  FaultDetail(Fault what) : fault(what) {}  // NOLINT(google-explicit-constructor): nothing measured
  FaultDetail(Fault what, FaultQuantity measured, int at, double found, double allowed)
      : fault(what),
        quantity(measured),
        index(static_cast<std::int8_t>(at)),
        value(found),
        limit(allowed) {}
  // This conversion allows the comparison of a result with a fault.
  operator Fault() const { return fault; }  // NOLINT(google-explicit-constructor)

  Fault fault = Fault::kNone;
  FaultQuantity quantity = FaultQuantity::kNone;
  /// Number of the encoder (0..15), motor (0..7), leg (0..3), axis (0..2) or component
  /// (0..5); -1: none.
  std::int8_t index = -1;
  double value = 0;  ///< in the quantity's unit
  double limit = 0;  ///< largest or smallest value allowed; nan: any finite value is allowed
};

struct FaultWords {
  const char* name = nullptr;     ///< name in recordings and summaries
  const char* meaning = nullptr;  ///< such as "the plate is outside its box, or tilted too far"
  /// The meaning if the fault still exists when recovery is requested.
  const char* meaning_in_recovery = nullptr;
  const char* advice = nullptr;  ///< instruction for the operator
  const char* cause = nullptr;   ///< usual causes, which docs/operating.md lists
};
/// The words for a fault. No pointer in them is null.
const FaultWords& words_of(Fault fault);

/// Returns true if the fault and the quantity are enumerators and the index is valid for the
/// quantity. The functions below have this as a precondition. Call is_known() for each detail that
/// comes from outside the program.
bool is_known(const FaultDetail& detail);

/// Name of the quantity with its index and, at the end, its unit, such as "th_2_3_step_rad";
/// empty for kNone.
std::string quantity_name(const FaultDetail& detail);

/// Quantity, value and limit in one phrase, such as "plate z 241.3 mm, limit 240 mm"; empty for
/// kNone.
std::string measured(const FaultDetail& detail);

/// Says why a request for recovery was refused, and what to do. `found`: kLinkLost if the device
/// cannot tell that its stop was released, otherwise another fault.
const char* refusal_words(Fault found);

/// Returns the meaning of a fault (FaultWords::meaning or meaning_in_recovery) with what was measured
/// and the advice.
std::string with_advice(const char* meaning, const FaultDetail& detail);

/// "NAME at T s: MEANING (MEASURED); ADVICE"
std::string describe(const FaultDetail& detail, double t_s);

}  // namespace trocar
