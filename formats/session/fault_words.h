// SPDX-License-Identifier: Apache-2.0
// The result of a safety check and the words for it. One table has the name, meaning and advice of
// every fault, another one has every quantity that a check can measure. A fault or quantity that is
// missing in its table is a compile error.
#pragma once

#include <cstdint>
#include <string>

#include "formats/session/recording.h"

namespace trocar {

/// The quantity that a check measured; make_quantity() in fault_words.cpp has its words and unit.
/// The comments give the unit and the meaning of FaultDetail::index, if it has one.
enum class FaultQuantity : std::uint8_t {
  kNone,                 ///< nothing was measured: the device reported it, or a solver gave up
  kTimeWithoutData,      ///< time without data from the device, s
  kEncoderAngle,         ///< angle, rad; index: encoder
  kEncoderStep,          ///< change of angle since the last data, rad; index: encoder
  kEncoderResidual,      ///< deviation from the fitted pose, rad; index: encoder
  kPoseResidual,         ///< residual of the fitted pose, m
  kInverseCondition,     ///< inverse condition number of the Jacobian
  kBranchDistance,       ///< distance of a leg from the edge of its workspace, m; index: leg
  kTickGap,              ///< time between the starts of two ticks, s
  kMissedDeadlines,      ///< consecutive missed deadlines
  kWaitingHoles,         ///< holes that were requested and have no mesh yet
  kToolTilt,             ///< angle, rad
  kPlatePosition,        ///< position, m; index: axis
  kPlateTilt,            ///< angle, rad
  kPlateSpeed,           ///< speed, m/s
  kPlateRotation,        ///< rotation rate, rad/s
  kPrefetchedStiffness,  ///< prefetched stiffness of the spring network, N/m
  kWantedWrench,         ///< component of the wrench, N or N m; index: 0..5
  kMotorTorque,          ///< torque, N m; index: motor
  kCompensationTorque,   ///< torque, N m; index: motor
  kTorqueRiseTime,       ///< time for which torques rose at their limit, s
  kMotorHeat,            ///< i2t state as a fraction of its limit; index: motor
  kWeakForceTime,        ///< time for which too little of the wanted force was rendered, s
  kMotor,                ///< no value; index: motor
  kReleasedEnergy,       ///< energy released to the hand within 0.1 s beyond the stored energy, J
  kMeasuredPosition,     ///< position that a pose device measured, m; index: axis
  kMeasuredRotation,     ///< length of the quaternion that a pose device measured
  kPositionStep,         ///< change of the measured position since the last data, m
  kRotationStep,         ///< change of the measured orientation since the last data, rad
};
inline constexpr int kFaultQuantities = 29;

/// The result of a check: a fault or none, and the value that exceeded its limit. It has a fixed
/// size because the haptic thread fills it; another thread composes the words.
struct FaultDetail {
  FaultDetail() = default;
  FaultDetail(Fault what) : fault(what) {}  // NOLINT(google-explicit-constructor): nothing measured
  FaultDetail(Fault what, FaultQuantity measured, int at, double found, double allowed)
      : fault(what),
        quantity(measured),
        index(static_cast<std::int8_t>(at)),
        value(found),
        limit(allowed) {}
  // A result can be compared with a fault.
  operator Fault() const { return fault; }  // NOLINT(google-explicit-constructor)

  Fault fault = Fault::kNone;
  FaultQuantity quantity = FaultQuantity::kNone;
  std::int8_t index =
      -1;            ///< number of the encoder (0..15), motor (0..7), leg (0..3) or axis; -1: none
  double value = 0;  ///< in the quantity's unit
  double limit = 0;  ///< largest or smallest value allowed; nan: any finite value
};

struct FaultWords {
  const char* name = nullptr;     ///< in recordings and summaries
  const char* meaning = nullptr;  ///< such as "the plate is outside its box, or tilted too far"
  const char* meaning_in_recovery =
      nullptr;                   ///< the meaning while the fault still prevents recovery
  const char* advice = nullptr;  ///< instruction for the operator
  const char* cause = nullptr;   ///< usual causes; docs/operating.md has them
};
/// The words for a fault. No pointer in them is null.
const FaultWords& words_of(Fault fault);

/// Do fault and quantity exist, and is the index valid for the quantity? The functions below
/// require this. Call it for details that come from outside the program.
bool is_known(const FaultDetail& detail);

/// Name of the quantity with its index, ending with its unit, such as "th_2_3_step_rad"; empty for
/// kNone.
std::string quantity_name(const FaultDetail& detail);

/// Quantity, value and limit in one phrase, such as "plate z 241.3 mm, limit 240 mm"; empty for
/// kNone.
std::string measured(const FaultDetail& detail);

/// "NAME at T s: MEANING (MEASURED); ADVICE"
std::string describe(const FaultDetail& detail, double t_s);

}  // namespace trocar
