// SPDX-License-Identifier: Apache-2.0
#include "runtime/device/pose/pose_hand.h"

#include "formats/base/text.h"

namespace trocar::runtime {
namespace {

Eigen::Vector3d vector(const std::array<double, 3>& values) noexcept {
  return {values[0], values[1], values[2]};
}

constexpr double kBoxRounding_m = 1e-9;

/// A side of the box that a description states as the workspace, and a position beyond this side.
struct BoxSide {
  int axis = 0;                  ///< index of the axis in the device's frame
  double at_m = 0, limit_m = 0;  ///< coordinates of the position and of the side along the axis
};
/// Finds a side of the box beyond which the position `p_m` lies. `p_m` is in the device's frame. A
/// nanometre is allowed for rounding. Returns nullopt if the position is in the box.
std::optional<BoxSide> side_beyond(const PoseDeviceDescription& description,
                                   const std::array<double, 3>& p_m) noexcept {
  for (std::size_t i = 0; i < 3; ++i) {
    const double at_m = p_m[i], min_m = description.workspace_min_m[i],
                 max_m = description.workspace_max_m[i];
    // Written so that nan is beyond a side.
    if (at_m >= min_m - kBoxRounding_m && at_m <= max_m + kBoxRounding_m) continue;
    return BoxSide{static_cast<int>(i), at_m, at_m < min_m ? min_m : max_m};
  }
  return std::nullopt;
}

constexpr double kAnyFinite = std::numeric_limits<double>::quiet_NaN();
/// Largest speed and rotation rate of a hand. If two successive readings show a faster motion,
/// find_pose() returns kEncoderJump, the fault for measurements that jump.
constexpr double kMaxHandSpeed_m_per_s = 5, kMaxHandRate_rad_per_s = 60;
/// Two readings at rest differ by at most this many steps of the resolution and deviations of the
/// noise.
constexpr double kMostCounts = 2, kMostSigmas = 10;
/// Largest deviation of a measured quaternion's length from 1.
constexpr double kQuaternionTolerance = 1e-3;

double length(const std::array<double, 4>& q) noexcept {
  return std::sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
}

/// Returns the angle of the rotation from one unit quaternion to another.
double angle_between(const std::array<double, 4>& a, const std::array<double, 4>& b) noexcept {
  const Eigen::Quaterniond from(a[0], a[1], a[2], a[3]), to(b[0], b[1], b[2], b[3]);
  return rotation_vector((to * from.conjugate()).normalized()).norm();
}

}  // namespace

PoseFrame::PoseFrame(const PoseDeviceDescription& description, const Pose& T_device_plate_middle)
    : description_(description),
      centre_(T_device_plate_middle),
      middle_m_((vector(description.workspace_min_m) + vector(description.workspace_max_m)) / 2),
      q_B_device_(from_rotation_vector(vector(description.turn_rad))) {}

Pose PoseFrame::plate(const PoseReading& reading) const noexcept {
  Pose T;
  T.p_m = centre_.p_m + q_B_device_ * (vector(reading.p_m) - middle_m_);
  T.q = centre_.q;
  if (!description_.senses_rotation) return T;
  const Eigen::Quaterniond q_device_handle(reading.q[0], reading.q[1], reading.q[2], reading.q[3]);
  T.q = (q_B_device_ * q_device_handle * q_B_device_.conjugate() * centre_.q).normalized();
  return T;
}

PoseReading PoseFrame::reading(const Pose& T_device_plate) const noexcept {
  PoseReading reading;
  const Eigen::Vector3d p_m =
      middle_m_ + q_B_device_.conjugate() * (T_device_plate.p_m - centre_.p_m);
  reading.p_m = {p_m.x(), p_m.y(), p_m.z()};
  if (!description_.senses_rotation) return reading;
  const Eigen::Quaterniond q =
      (q_B_device_.conjugate() * T_device_plate.q * centre_.q.conjugate() * q_B_device_)
          .normalized();
  reading.q = {q.w(), q.x(), q.y(), q.z()};
  return reading;
}

HandleWrench PoseFrame::to_device(const Wrench& wrench) const noexcept {
  const Eigen::Vector3d f = q_B_device_.conjugate() * Eigen::Vector3d(wrench.head<3>());
  const Eigen::Vector3d n = q_B_device_.conjugate() * Eigen::Vector3d(wrench.tail<3>());
  return {f.x(), f.y(), f.z(), n.x(), n.y(), n.z()};
}

Wrench PoseFrame::from_device(const HandleWrench& wrench) const noexcept {
  Wrench out;
  out << q_B_device_ * Eigen::Vector3d(wrench[0], wrench[1], wrench[2]),
      q_B_device_ * Eigen::Vector3d(wrench[3], wrench[4], wrench[5]);
  return out;
}

PoseFrame::Box PoseFrame::workspace() const noexcept {
  const Eigen::Vector3d half_m =
      (vector(description_.workspace_max_m) - vector(description_.workspace_min_m)) / 2;
  const Eigen::Vector3d reach_m = q_B_device_.toRotationMatrix().cwiseAbs() * half_m;
  return {centre_.p_m - reach_m, centre_.p_m + reach_m};
}

double renderable_fraction(const PoseDeviceDescription& description,
                           const Wrench& wrench) noexcept {
  const double force_N = wrench.head<3>().norm(), moment_Nm = wrench.tail<3>().norm();
  double share = 1;
  if (force_N > description.force_max_N) share = description.force_max_N / force_N;
  if (description.moment_max_Nm > 0 && moment_Nm > description.moment_max_Nm)
    share = std::min(share, description.moment_max_Nm / moment_Nm);
  return share;
}

std::string PoseSpecification::describe_strength() const {
  return renders_moment()
             ? text_line("%.3g N and %.3g Nm", description_.force_max_N, description_.moment_max_Nm)
             : text_line("%.3g N, no moment", description_.force_max_N);
}

std::optional<WorkspaceBox> PoseSpecification::workspace() const noexcept {
  const PoseFrame::Box box = frame_.workspace();
  return WorkspaceBox{{box.min_m.x(), box.min_m.y(), box.min_m.z()},
                      {box.max_m.x(), box.max_m.y(), box.max_m.z()}};
}

DeviceMargins PoseSpecification::margins(const Pose& T_device_plate) const noexcept {
  DeviceMargins out;
  const PoseReading at = frame_.reading(T_device_plate);
  for (std::size_t i = 0; i < 3; ++i) {
    out.box_m = std::min({out.box_m, at.p_m[i] - description_.workspace_min_m[i],
                          description_.workspace_max_m[i] - at.p_m[i]});
  }
  out.box_m += kBoxRounding_m;
  return out;
}

std::string PoseSpecification::describe_fault(Fault fault, const Pose& T_device_plate) const {
  const std::optional<BoxSide> side = side_beyond(description_, frame_.reading(T_device_plate).p_m);
  if (fault != Fault::kWorkspace || !side) return {};
  const auto axis = static_cast<std::size_t>(side->axis);
  return text_line("the handle is at %c %s m in the device's frame; its box is %.4f to %.4f m",
                   "xyz"[axis], apart_from(side->at_m, side->limit_m, 4).c_str(),
                   description_.workspace_min_m[axis], description_.workspace_max_m[axis]);
}

std::optional<Pose> PoseSpecification::pose_of(const RecordingRow& row) const {
  const auto& stated = row.pose_device;
  const Pose T = frame_.plate({row.state_t_s, stated.p_m, stated.q, stated.buttons});
  return is_finite(T) ? std::optional(T) : std::nullopt;
}

DeviceReadings PoseSpecification::readings() const noexcept {
  const bool turns = description_.senses_rotation;
  return {.noise_m = description_.position_noise_m,
          .resolution_m = description_.position_resolution_m.value_or(kAssumedResolution_m),
          .noise_rad = turns ? description_.rotation_noise_rad : 0,
          .resolution_rad =
              turns ? description_.rotation_resolution_rad.value_or(kAssumedResolution_rad) : 0,
          .delay_s = description_.delay_s.value_or(0),
          .is_assumed = !description_.position_resolution_m};
}

std::optional<Eigen::Matrix<double, 6, 6>> PoseSpecification::damping(const Pose&) const {
  // If no moment is rendered, a rotation releases no energy, whatever its damping is.
  constexpr double kAmple_Nm_s_per_rad = 1e6;
  Eigen::Matrix<double, 6, 1> diagonal;
  diagonal << Eigen::Vector3d::Constant(description_.damping_N_s_per_m),
      Eigen::Vector3d::Constant(renders_moment() ? description_.rotation_damping_Nm_s_per_rad
                                                 : kAmple_Nm_s_per_rad);
  return Eigen::Matrix<double, 6, 6>(diagonal.asDiagonal());
}

double PoseSpecification::renderable_fraction(const Pose&, const Wrench& wrench_device) const {
  return runtime::renderable_fraction(description_, wrench_device);
}

std::string PoseSpecification::describe_demand(std::string_view what, const Pose&,
                                               const Wrench& wrench_device) const {
  const double share = runtime::renderable_fraction(description_, wrench_device);
  return text_line("%.*s needs %.2f of %.2f N%s", static_cast<int>(what.size()), what.data(),
                   wrench_device.head<3>().norm(), description_.force_max_N,
                   share < 1 ? ", and is then not given in full" : "");
}

PoseHand::PoseHand(const PoseDeviceDescription& description, const PoseFrame& frame,
                   PoseDevice& device)
    : device_(device), specification_(description, frame) {}

DeviceStatus PoseHand::read(double& t_s) noexcept {
  reading_ = last_;
  const DeviceStatus status = device_.read(reading_);
  if (status == DeviceStatus::kOk) t_s = reading_.t_s;
  return status;
}

bool PoseHand::is_finite() const noexcept {
  const auto good = [](double x) { return std::isfinite(x); };
  return std::all_of(reading_.p_m.begin(), reading_.p_m.end(), good) &&
         (!description().senses_rotation ||
          std::all_of(reading_.q.begin(), reading_.q.end(), good));
}

bool PoseHand::keep_reading() noexcept {
  const bool keeps = is_finite();
  if (keeps) last_ = reading_;
  return keeps;
}

FaultDetail PoseHand::check(const ReadingInterval& interval) const noexcept {
  double farthest_m = kFarthest_m;
  for (std::size_t i = 0; i < 3; ++i)
    farthest_m = std::max(
        {farthest_m, -2 * description().workspace_min_m[i], 2 * description().workspace_max_m[i]});
  for (int i = 0; i < 3; ++i) {
    const double at_m = reading_.p_m[static_cast<std::size_t>(i)];
    if (!(std::abs(at_m) <= farthest_m))
      return {Fault::kRefusedState, FaultQuantity::kMeasuredPosition, i, at_m,
              std::copysign(farthest_m, at_m)};
  }
  const bool turns = description().senses_rotation;
  const double size = turns ? length(reading_.q) : 1;
  // Written so that nan is a fault.
  if (!(std::abs(size - 1) <= kQuaternionTolerance))
    return {Fault::kRefusedState, FaultQuantity::kMeasuredRotation, -1, size, 1};
  if (!interval.has_last) return {};
  const DeviceReadings stated = specification_.readings();
  const double step_m = std::hypot(reading_.p_m[0] - last_.p_m[0], reading_.p_m[1] - last_.p_m[1],
                                   reading_.p_m[2] - last_.p_m[2]);
  const double step_max_m = kMaxHandSpeed_m_per_s * interval.step_s +
                            kMostCounts * stated.resolution_m + kMostSigmas * stated.noise_m;
  if (!(step_m <= step_max_m))
    return {Fault::kEncoderJump, FaultQuantity::kPositionStep, -1, step_m, step_max_m};
  const double turn_rad = turns ? angle_between(last_.q, reading_.q) : 0;
  const double turn_max_rad = kMaxHandRate_rad_per_s * interval.step_s +
                              kMostCounts * stated.resolution_rad + kMostSigmas * stated.noise_rad;
  if (!(turn_rad <= turn_max_rad))
    return {Fault::kEncoderJump, FaultQuantity::kRotationStep, -1, turn_rad, turn_max_rad};
  return {};
}

FaultDetail PoseHand::find_pose(const ReadingInterval& interval, PlatePose& pose) noexcept {
  measured_.t_s = reading_.t_s;
  measured_.count = description().senses_rotation ? 7 : 3;
  for (std::size_t i = 0; i < 3; ++i)
    measured_.value[i] = reading_.p_m[i];
  if (description().senses_rotation) {
    double product = 0;
    for (std::size_t i = 0; i < 4; ++i)
      product += reading_.q[i] * measured_.value[3 + i];
    const double sign = product < 0 ? -1 : 1;
    for (std::size_t i = 0; i < 4; ++i)
      measured_.value[3 + i] = sign * reading_.q[i];
  }
  if (const FaultDetail f = check(interval); f != Fault::kNone) return f;
  pose = {frame().plate(reading_), 0};
  return {};
}

FaultDetail PoseHand::check_own_workspace() const noexcept {
  const std::optional<BoxSide> side = side_beyond(description(), reading_.p_m);
  if (!side) return {};
  return {Fault::kWorkspace, FaultQuantity::kMeasuredPosition, side->axis, side->at_m,
          side->limit_m};
}

FaultDetail PoseHand::fault_of(DeviceStatus status) const noexcept {
  const int byte = status == DeviceStatus::kMotorFault ? device_.fault_byte() : 0;
  if (byte != 0)
    return {Fault::kMotorFault, FaultQuantity::kFaultByte, -1, static_cast<double>(byte),
            kAnyFinite};
  return HandDevice::fault_of(status);
}

FaultDetail PoseHand::render(const RenderInput& input, double& scale) noexcept {
  for (int i = 0; i < 6; ++i) {
    if (!std::isfinite(input.wanted[i]))
      return {Fault::kTorqueNotFinite, FaultQuantity::kWantedWrench, i, input.wanted[i],
              kAnyFinite};
  }
  scale = renderable_fraction(description(), input.wanted);
  Wrench rendered = scale * input.wanted;
  if (description().moment_max_Nm == 0) rendered.tail<3>().setZero();
  next_ = frame().to_device(rendered);
  return {};
}

void PoseHand::fade(double share) noexcept {
  for (std::size_t i = 0; i < next_.size(); ++i)
    next_[i] = share * at_stop_[i];
}

DeviceStatus PoseHand::write() noexcept {
  written_ = next_;
  return device_.write(written_);
}

void PoseHand::describe(RecordingRow& row, DeviceReadout& readout) const noexcept {
  row.pose_device = {reading_.p_m, reading_.q, reading_.buttons, written_};
  row.state_t_s = reading_.t_s;
  readout.margin = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < 3; ++i) {
    readout.margin = std::min({readout.margin, reading_.p_m[i] - description().workspace_min_m[i],
                               description().workspace_max_m[i] - reading_.p_m[i]});
  }
}

}  // namespace trocar::runtime
