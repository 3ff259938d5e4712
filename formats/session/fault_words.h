// SPDX-License-Identifier: Apache-2.0
// The result of a safety check, and words that describe it. One table has the name, meaning and
// advice of every fault. Another table has every quantity that a check can measure. A fault or
// quantity that is missing in its table is a compile error.
#pragma once

#include <cstdint>
#include <string>

#include "formats/session/recording.h"

namespace trocar {

/// The quantity that a check measured; fault_words.cpp has its words and unit.
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

/// "NAME at T s: MEANING (MEASURED); ADVICE"
std::string describe(const FaultDetail& detail, double t_s);

}  // namespace trocar
