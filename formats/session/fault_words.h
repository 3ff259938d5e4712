// SPDX-License-Identifier: Apache-2.0
// What a check found, and the words for it: every fault's name, meaning and advice in one table,
// and every quantity that a check can measure. A fault or quantity without words does not compile.
#pragma once

#include <cstdint>
#include <string>

#include "formats/session/recording.h"

namespace trocar {

/// What a check measured. A row of kQuantities in fault_words.cpp has its words and unit.
enum class FaultQuantity : std::uint8_t {
  kNone,                ///< nothing was measured: the device reports it, or a solver gave up
  kTimeWithoutData,     ///< s
  kEncoderAngle,        ///< index: encoder; rad
  kEncoderStep,         ///< index: encoder; rad, since the last data
  kEncoderResidual,     ///< index: encoder; rad, against the fitted pose
  kPoseResidual,        ///< m
  kInverseCondition,    ///< of the Jacobian
  kBranchDistance,      ///< index: leg; m, to the end of its reach
  kTickGap,             ///< s, between the starts of two ticks
  kMissedDeadlines,     ///< in a row
  kWaitingHoles,        ///< requested, without a mesh
  kToolTilt,            ///< rad
  kPlatePosition,       ///< index: axis; m
  kPlateTilt,           ///< rad
  kPlateSpeed,          ///< m/s
  kPlateRotation,       ///< rad/s
  kResponse,            ///< stiffness of the spring network's response, N/m
  kWantedWrench,        ///< index: 0..5; N or N m
  kMotorTorque,         ///< index: motor; N m
  kCompensationTorque,  ///< index: motor; N m
  kTorqueRiseTime,      ///< s, for which torques rose as fast as they may
  kMotorHeat,           ///< index: motor; i2t state as a share of its limit
  kWeakForceTime,       ///< s, with too little of the wanted force
  kMotor,               ///< index: motor; no value
  kGivenEnergy,         ///< J, to the hand within 0.1 s beyond what was stored
};
inline constexpr int kFaultQuantities = 25;

/// What a check found: a fault, or none, and the value that was beyond its limit. Of fixed size:
/// the haptic thread fills it, another thread finds the words.
struct FaultDetail {
  FaultDetail() = default;
  FaultDetail(Fault what) : fault(what) {}  // NOLINT(google-explicit-constructor): nothing measured
  FaultDetail(Fault what, FaultQuantity measured, int at, double found, double allowed)
      : fault(what),
        quantity(measured),
        index(static_cast<std::int8_t>(at)),
        value(found),
        limit(allowed) {}
  // A check is compared with a fault.
  operator Fault() const { return fault; }  // NOLINT(google-explicit-constructor)

  Fault fault = Fault::kNone;
  FaultQuantity quantity = FaultQuantity::kNone;
  std::int8_t index = -1;  ///< which encoder (0..15), motor (0..7), leg (0..3), axis; -1: none
  double value = 0;        ///< in the quantity's unit
  double limit = 0;        ///< the largest allowed, or the smallest; nan: any finite value
};

struct FaultWords {
  const char* name = nullptr;     ///< in recordings and summaries
  const char* meaning = nullptr;  ///< "the plate is outside its box, or tilted too far"
  const char* still = nullptr;    ///< the same while it prevents a recovery
  const char* advice = nullptr;   ///< what to do, as an order
};
/// Every pointer is set.
const FaultWords& words_of(Fault fault);

/// Whether fault and quantity exist, and the index is one of those that the quantity counts. The
/// functions below need that; for details from outside the program.
bool is_known(const FaultDetail& detail);

/// The quantity with its index, ending with its unit, such as "th_2_3_step_rad"; empty: kNone.
std::string quantity_name(const FaultDetail& detail);

/// Quantity, value and limit in one phrase, such as "plate z 241.3 mm, limit 240 mm"; empty: kNone.
std::string measured(const FaultDetail& detail);

/// "NAME at T s: MEANING (MEASURED); ADVICE"
std::string describe(const FaultDetail& detail, double t_s);

}  // namespace trocar
