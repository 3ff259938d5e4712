// SPDX-License-Identifier: Apache-2.0
// The result of a safety check and the words for it: one table has the name, meaning and advice of
// every fault, another one every quantity that a check can measure. A fault or quantity without
// words does not compile.
#pragma once

#include <cstdint>
#include <string>

#include "formats/session/recording.h"

namespace trocar {

/// The quantity that a check measured; make_quantity() in fault_words.cpp has its words and unit.
enum class FaultQuantity : std::uint8_t {
  kNone,                 ///< nothing was measured: the device reported it, or a solver gave up
  kTimeWithoutData,      ///< s
  kEncoderAngle,         ///< index: encoder; rad
  kEncoderStep,          ///< index: encoder; rad, since the last data
  kEncoderResidual,      ///< index: encoder; rad, against the fitted pose
  kPoseResidual,         ///< m
  kInverseCondition,     ///< inverse condition number of the Jacobian
  kBranchDistance,       ///< index: leg; m, to the edge of its workspace
  kTickGap,              ///< s, between the starts of two ticks
  kMissedDeadlines,      ///< consecutive missed deadlines
  kWaitingHoles,         ///< holes that were requested and have no mesh yet
  kToolTilt,             ///< rad
  kPlatePosition,        ///< index: axis; m
  kPlateTilt,            ///< rad
  kPlateSpeed,           ///< m/s
  kPlateRotation,        ///< rad/s
  kPrefetchedStiffness,  ///< stiffness of the spring network's response, N/m
  kWantedWrench,         ///< index: 0..5; N or N m
  kMotorTorque,          ///< index: motor; N m
  kCompensationTorque,   ///< index: motor; N m
  kTorqueRiseTime,       ///< s, time for which torques rose at their limit
  kMotorHeat,            ///< index: motor; i2t state as a fraction of its limit
  kWeakForceTime,        ///< s, time with too little of the wanted force
  kMotor,                ///< index: motor; no value
  kReleasedEnergy,       ///< J, energy released to the hand within 0.1 s beyond the stored energy
};
inline constexpr int kFaultQuantities = 25;

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
  const char* meaning = nullptr;  ///< "the plate is outside its box, or tilted too far"
  const char* meaning_in_recovery =
      nullptr;                   ///< the meaning while the fault still prevents recovery
  const char* advice = nullptr;  ///< instruction for the operator
};
/// Every pointer is set.
const FaultWords& words_of(Fault fault);

/// Do fault and quantity exist, and is the index valid for the quantity? The functions below
/// require this; check it for details that come from outside the program.
bool is_known(const FaultDetail& detail);

/// The quantity with its index, ending with its unit, such as "th_2_3_step_rad"; empty: kNone.
std::string quantity_name(const FaultDetail& detail);

/// Quantity, value and limit in one phrase, such as "plate z 241.3 mm, limit 240 mm"; empty: kNone.
std::string measured(const FaultDetail& detail);

/// "NAME at T s: MEANING (MEASURED); ADVICE"
std::string describe(const FaultDetail& detail, double t_s);

}  // namespace trocar
