// SPDX-License-Identifier: Apache-2.0
#include "formats/session/faults.h"

#include <cmath>

#include "formats/base/text.h"

namespace trocar {
namespace {

struct FaultRow {
  Fault fault = Fault::kNone;
  FaultWords words;
};

constexpr std::array<FaultRow, kFaults> kFaultRows{{
    {Fault::kNone,
     {"none", "there is no fault", "there is no fault", "go on", "nothing went wrong"}},
    {Fault::kNoData,
     {"no_data", "no data came from the device for too long", "no data comes from the device",
      "check the drive's power and its cable",
      "the drive is off, a cable is loose, or another program holds up the drive"}},
    {Fault::kLinkLost,
     {"link_lost", "the link to the device is lost", "the link to the device is still lost",
      "check that the drive runs, its network cable, and that no other program holds this "
      "computer up",
      "the drive has ended, its network failed, or its watchdog tripped because this "
      "computer was late"}},
    {Fault::kWriteFailed,
     {"write_failed", "the device did not take the torques",
      "the device still does not take torques", "check the drive and the link to it",
      "the drive refuses commands, or the connection to it has just broken"}},
    {Fault::kEncoderNotFinite,
     {"encoder_not_finite", "an encoder gives no number", "an encoder still gives no number",
      "check that encoder and its cable",
      "an encoder or its cable is broken, or the device stated a value without a reading"}},
    {Fault::kEncoderJump,
     {"encoder_jump", "an encoder moved faster than the mechanism can", "an encoder still jumps",
      "check that encoder, its plug and its cable",
      "a plug is loose, counts were lost, or data came from another device"}},
    {Fault::kJointLimit,
     {"joint_limit", "a joint is outside its limits", "a joint is still outside its limits",
      "move the tool back towards the middle",
      "the tool was moved to the edge of what the mechanism can reach"}},
    {Fault::kPoseResidual,
     {"pose_residual", "the encoders contradict each other, or give no pose",
      "the encoders still contradict each other",
      "check for a stuck or slipped encoder and the zeros of all encoders",
      "an encoder slipped or sticks, or its zero is wrong"}},
    {Fault::kSingularity,
     {"singularity", "the mechanism is too close to a singular pose",
      "the mechanism is still too close to a singular pose",
      "move the tool back towards the middle",
      "the tool is at the edge of the workspace, where a leg is stretched"}},
    {Fault::kTorqueNotFinite,
     {"torque_not_finite", "a computed force or torque is not a number",
      "a computed force or torque is still not a number",
      "report this to the developers with the black box and the scene", "a defect of the program"}},
    {Fault::kDeadlineMissed,
     {"deadline_missed", "the loop was too late", "the loop is still too late",
      "end other programs, give realtime rights, or allow more late ticks "
      "(--late-ticks-in-row)",
      "other programs hold this computer up, or the loop has no realtime priority"}},
    {Fault::kRemeshBacklog,
     {"remesh_backlog", "holes are made faster than their meshes",
      "holes still wait for their meshes", "lift the tool, and puncture more slowly",
      "punctures follow each other very fast"}},
    {Fault::kToolTilt,
     {"tool_tilt", "the tool's axis is too far from upright",
      "the tool's axis is still too far from upright", "hold the tool upright",
      "the tool was tilted"}},
    {Fault::kEmergencyStop,
     {"emergency_stop", "the emergency stop is pressed, the device's or the operator's",
      "the emergency stop is still pressed", "release it when that is safe",
      "somebody pressed it"}},
    {Fault::kMotorFault,
     {"motor_fault", "a motor does not give its torque, or the device has another fault",
      "a motor still does not give its torque, or the device still has another fault",
      "check that motor, its cable and its drive, or what the device's maker says of its "
      "fault",
      "the drive reports a motor that is broken, too hot or disconnected, or another fault "
      "of the device"}},
    {Fault::kWorkspace,
     {"workspace", "the plate is outside its box, or tilted too far",
      "the plate is still outside its box, or tilted too far",
      "move the tool back towards the middle",
      "the tool was moved to where the device cannot be held safely"}},
    {Fault::kSpeed,
     {"speed", "the plate moves or rotates too fast", "the plate still moves too fast",
      "move the tool more slowly", "the tool was let go or pulled fast, or a measurement jumped"}},
    {Fault::kTorqueLimit,
     {"torque_limit", "a motor's wanted torque exceeds the session's limit",
      "a motor's wanted torque still exceeds the session's limit",
      "press with less force, or use a softer tissue",
      "the tissue needs more torque than the motors may give"}},
    {Fault::kTorqueRate,
     {"torque_rate", "the wanted torques rise faster than they may, for too long",
      "the wanted torques still rise faster than they may",
      "move the tool more slowly, or use a tissue with less stiffness and damping",
      "the tool hit stiff tissue fast"}},
    {Fault::kMotorOverload,
     {"motor_overload", "the motors are overloaded", "the motors are still hot",
      "lift the tool, let the motors cool, and press with less force",
      "large forces were held for long"}},
    {Fault::kEnergyLimit,
     {"energy_limit", "the loop drives the hand: it gave more energy than tissue and limit allow",
      "the loop still drives the hand",
      "use a tissue with less stiffness and friction, or a higher --rate",
      "the tissue is too stiff for the rate or for the delay of the device"}},
    {Fault::kPaused,
     {"paused", "the operator pauses the session", "the operator still pauses the session",
      "resume it at the console", "the operator pressed Pause"}},
    {Fault::kForcesOff,
     {"forces_off", "the operator has turned the forces off",
      "the operator still has the forces off",
      "press Recover when the device may push the tool again", "the operator pressed Zero forces"}},
    {Fault::kRecordingFailed,
     {"recording_failed", "the recording cannot be written, so the session ends",
      "the recording still cannot be written", "free some space on the disk, and start again",
      "the disk is full, slow or broken, or another program has filled it"}},
    {Fault::kRefusedState,
     {"refused_state", "the device's states arrive, but are refused because of their contents",
      "the device's states are still refused because of their contents",
      "correct what the device's program states: metres, radians, finite numbers, a unit "
      "quaternion",
      "the device's program states millimetres instead of metres, a number that is not "
      "finite, or a quaternion that is not a unit"}},
}};

/// The things that an index counts, each with their number. '#' in a row's texts stands for the
/// index.
enum class Counts : std::uint8_t {
  kNothing = 0,
  kAxes = 3,
  kLegs = 4,
  kWrench = 6,
  kMotors = 8,
  kEncoders = 16
};

struct QuantityRow {
  FaultQuantity quantity = FaultQuantity::kNone;
  const char* name = nullptr;  ///< result of quantity_name()
  const char* words = nullptr;
  const char* unit = "";  ///< unit in measured(), which shows the value times `factor`
  double factor = 1;      ///< 0: there is no value
  Counts counts = Counts::kNothing;
};

constexpr double kDeg = 57.29577951308232;

constexpr std::array<QuantityRow, kFaultQuantities> kQuantityRows = [] {
  using enum Counts;
  return std::array<QuantityRow, kFaultQuantities>{{
      {FaultQuantity::kNone, "", "", "", 0},
      {FaultQuantity::kTimeWithoutData, "time_without_data_s", "time without data", " ms", 1e3},
      {FaultQuantity::kEncoderAngle, "th_#_rad", "angle theta #", " deg", kDeg, kEncoders},
      {FaultQuantity::kEncoderStep, "th_#_step_rad", "step of encoder theta #", " deg", kDeg,
       kEncoders},
      {FaultQuantity::kEncoderResidual, "th_#_residual_rad",
       "difference of encoder theta # from the pose", " deg", kDeg, kEncoders},
      {FaultQuantity::kPoseResidual, "pose_residual_m", "misfit of the legs", " mm", 1e3},
      {FaultQuantity::kInverseCondition, "inverse_condition", "inverse condition number"},
      {FaultQuantity::kBranchDistance, "branch_distance_#_m",
       "distance of leg # from the edge of its workspace", " mm", 1e3, kLegs},
      {FaultQuantity::kTickGap, "tick_gap_s", "time between two ticks", " ms", 1e3},
      {FaultQuantity::kMissedDeadlines, "missed_deadlines_in_row", "deadlines missed in a row:"},
      {FaultQuantity::kWaitingHoles, "waiting_holes", "holes that wait:"},
      {FaultQuantity::kToolTilt, "tool_tilt_rad", "tool tilt", " deg", kDeg},
      {FaultQuantity::kPlatePosition, "#_m", "plate #", " mm", 1e3, kAxes},
      {FaultQuantity::kPlateTilt, "plate_tilt_rad", "plate tilt", " deg", kDeg},
      {FaultQuantity::kPlateSpeed, "plate_speed_m_per_s", "plate speed", " m/s"},
      {FaultQuantity::kPlateRotation, "plate_rotation_rad_per_s", "plate rotation", " rad/s"},
      {FaultQuantity::kPrefetchedStiffness, "response_stiffness_N_per_m",
       "stiffness of the spring network", " N/m"},
      {FaultQuantity::kWantedWrench, "#", "wanted #", "", 1, kWrench},
      {FaultQuantity::kMotorTorque, "tau_#_Nm", "torque of motor theta #", " N m", 1, kMotors},
      {FaultQuantity::kCompensationTorque, "compensation_#_Nm",
       "compensation torque of motor theta #", " N m", 1, kMotors},
      {FaultQuantity::kTorqueRiseTime, "torque_rise_time_s", "time of rising at the limit", " ms",
       1e3},
      {FaultQuantity::kMotorHeat, "motor_heat_#", "thermal state of motor theta #", " %", 100,
       kMotors},
      {FaultQuantity::kWeakForceTime, "weak_force_time_s",
       "time with too little of the wanted force", " s"},
      {FaultQuantity::kMotor, "motor_#", "motor theta #", "", 0, kMotors},
      {FaultQuantity::kReleasedEnergy, "energy_released_J", "energy released to the hand", " mJ",
       1e3},
      {FaultQuantity::kMeasuredPosition, "device_#_m", "measured position #", " mm", 1e3, kAxes},
      {FaultQuantity::kMeasuredRotation, "device_quaternion", "length of the measured quaternion"},
      {FaultQuantity::kPositionStep, "device_step_m", "step of the measured position", " mm", 1e3},
      {FaultQuantity::kRotationStep, "device_step_rad", "step of the measured orientation", " deg",
       kDeg},
      {FaultQuantity::kFaultByte, "device_fault", "fault byte of the device:"},
      {FaultQuantity::kRefusedContents, "unreadable_message", "a message that cannot be read", "",
       0},
      {FaultQuantity::kStateMode, "state_mode", "mode"},
      {FaultQuantity::kStateZeros, "state_zeros", "a byte that must be zero is not", "", 0},
  }};
}();

/// Each row stands at the place of its enumerator, and has all words.
constexpr bool are_whole() {
  for (std::size_t i = 0; i < kFaultRows.size(); ++i) {
    const auto& [fault, words] = kFaultRows[i];
    if (static_cast<std::size_t>(fault) != i) return false;
    for (const char* text :
         {words.name, words.meaning, words.meaning_in_recovery, words.advice, words.cause})
      if (text == nullptr || *text == '\0') return false;
  }
  for (std::size_t i = 0; i < kQuantityRows.size(); ++i) {
    const QuantityRow& row = kQuantityRows[i];
    if (static_cast<std::size_t>(row.quantity) != i || row.words == nullptr) return false;
  }
  return true;
}
static_assert(are_whole(), "a fault or a quantity has no words, or stands at another's place");

const QuantityRow& row_of(FaultQuantity quantity) {
  return kQuantityRows.at(static_cast<std::size_t>(quantity));
}

/// Writes an index as in a column's name ("2_3": leg, joint) or in words ("3 of leg 2").
std::string index_text(Counts counts, int index, bool in_words) {
  constexpr std::array<const char*, 3> kAxisNames = {"x", "y", "z"};
  constexpr std::array<const char*, 6> kWrenchNames = {"fx", "fy", "fz", "tx", "ty", "tz"};
  const auto joint_of_leg = [&](int leg, int joint) {
    return in_words ? std::to_string(joint) + " of leg " + std::to_string(leg)
                    : std::to_string(leg) + "_" + std::to_string(joint);
  };
  switch (counts) {
    case Counts::kNothing:
      break;
    case Counts::kEncoders:
      return joint_of_leg(index / 4 + 1, index % 4 + 1);
    case Counts::kMotors:
      return joint_of_leg(index / 2 + 1, index % 2 == 0 ? 1 : 4);
    case Counts::kLegs:
      return std::to_string(index + 1);
    case Counts::kAxes:
      return kAxisNames.at(static_cast<std::size_t>(index));
    case Counts::kWrench:
      return std::string(kWrenchNames.at(static_cast<std::size_t>(index))) + (in_words ? ""
                                                                              : index < 3
                                                                                  ? "_wanted_N"
                                                                                  : "_wanted_Nm");
  }
  return {};
}

/// The text with `with` in place of its '#', if it has one.
std::string filled(std::string text, const std::string& with) {
  if (const std::size_t at = text.find('#'); at != std::string::npos) text.replace(at, 1, with);
  return text;
}

std::string with_digits(double x, int digits) {
  return text_line("%.*g", digits, x);
}

}  // namespace

const FaultWords& words_of(Fault fault) {
  return kFaultRows.at(static_cast<std::size_t>(fault)).words;
}

const char* refusal_words(Fault found) {
  return found == Fault::kLinkLost
             ? "the device's emergency stop was pressed when its link was lost, and the link is "
               "being restored; release the stop, then ask again"
             : "the device's emergency stop is pressed, or was until now; release it when that is "
               "safe, then ask again";
}

bool is_known(const FaultDetail& detail) {
  const auto fault = static_cast<int>(detail.fault), quantity = static_cast<int>(detail.quantity);
  if (fault < 0 || fault >= kFaults || quantity < 0 || quantity >= kFaultQuantities) return false;
  const int count = static_cast<int>(row_of(detail.quantity).counts);
  return detail.index >= (count == 0 ? -1 : 0) && (count == 0 || detail.index < count);
}

std::string quantity_name(const FaultDetail& detail) {
  const QuantityRow& row = row_of(detail.quantity);
  return filled(row.name, index_text(row.counts, detail.index, false));
}

std::string measured(const FaultDetail& detail) {
  if (detail.quantity == FaultQuantity::kNone) return {};
  const QuantityRow& row = row_of(detail.quantity);
  std::string text = filled(row.words, index_text(row.counts, detail.index, true));
  if (row.factor == 0) return text;
  const double value = detail.value * row.factor, limit = detail.limit * row.factor;
  int digits = 4;  // more if they are needed to distinguish the value from its limit
  while (digits < 17 && value != limit && with_digits(value, digits) == with_digits(limit, digits))
    ++digits;
  text.append(" ").append(with_digits(value, digits)).append(row.unit);
  if (!std::isnan(detail.limit)) {
    text.append(value < limit ? ", at least " : ", limit ");
    text.append(with_digits(limit, digits)).append(row.unit);
  }
  return text;
}

std::string with_advice(const char* meaning, const FaultDetail& detail) {
  const std::string found = measured(detail);
  return meaning + (found.empty() ? "" : " (" + found + ")") + "; " + words_of(detail.fault).advice;
}

std::string describe(const FaultDetail& detail, double t_s) {
  const FaultWords& words = words_of(detail.fault);
  return std::string(words.name) + " at " + text_line("%.4f", t_s) +
         " s: " + with_advice(words.meaning, detail);
}

}  // namespace trocar
