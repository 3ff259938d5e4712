// SPDX-License-Identifier: Apache-2.0
#include "runtime/console/igtl_session.h"

#include <array>
#include <boost/asio/post.hpp>
#include <cmath>
#include <exception>
#include <string>

#include "formats/session/recording.h"
#include "runtime/console/igtl.h"
#include "runtime/device/device.h"

namespace trocar::runtime {
namespace {

constexpr const char *kTime = "TrocarTime", *kState = "TrocarState", *kBone = "TrocarBone";
// Bytes that a surface takes in its message at most; viewers have no use for a larger one.
constexpr std::size_t kMaxSurfaceBytes = std::size_t{256} << 20;

template <typename AnyClock>
double seconds_of(const std::chrono::time_point<AnyClock>& time) {
  return std::chrono::duration<double>(time.time_since_epoch()).count();
}
double unix_s() {
  return seconds_of(std::chrono::system_clock::now());
}

IgtlBytes shared(std::string bytes) {
  return std::make_shared<const std::string>(std::move(bytes));
}

IgtlStatus code_of(RunState state, Fault fault) {
  switch (state) {
    case RunState::kIdle:
    case RunState::kLost:
      return IgtlStatus::kNotPresent;
    case RunState::kStarting:
      return IgtlStatus::kNotReady;
    case RunState::kSilent:
      return IgtlStatus::kTimeOut;
    case RunState::kEnded:
      return IgtlStatus::kShutDown;
    case RunState::kRunning:
    case RunState::kPaused:
      break;
  }
  if (fault == Fault::kNone) return IgtlStatus::kOk;
  return fault == Fault::kEmergencyStop ? IgtlStatus::kEmergency : IgtlStatus::kUnknownError;
}

Eigen::Vector3d vector(const SessionTelemetry& telemetry, const char* column) {
  return {telemetry.value(column, 0), telemetry.value(column, 1), telemetry.value(column, 2)};
}

/// The tool's pose in {B}, in mm: the origin at its tip, z up its shaft, x and y as those of the plate,
/// tilted with the tool.
Eigen::Affine3d tool_pose(const SessionTelemetry& telemetry) {
  const Eigen::Quaterniond q(telemetry.value("q", 0), telemetry.value("q", 1),
                             telemetry.value("q", 2), telemetry.value("q", 3));
  const Eigen::Vector3d shaft_plate = q.conjugate() * -vector(telemetry, "axis");
  Eigen::Affine3d T = Eigen::Affine3d::Identity();
  T.linear() = (q * rotation_from_z(shaft_plate)).toRotationMatrix();
  T.translation() = vector(telemetry, "tool_m") * 1e3;
  return T;
}

}  // namespace

void IgtlSession::poll(Clock::time_point now) {
  const SessionTelemetry& telemetry = console_.supervisor.telemetry();
  const double offset_s = unix_s() - seconds_of(Clock::now());
  if (state_.session != telemetry.sessions()) {
    state_ = {telemetry.sessions(), state_.status_number, nullptr, 0, nullptr, nullptr};
    position_.reset();
    asked_.reset();
    shown_ticks_ = 0;
  }
  update_status(seconds_of(now) + offset_s);
  if (server_->has_clients()) {
    if (!asked_ && telemetry.snapshot()) load_position();
    // Before the device has been read, its pose means nothing. A snapshot may show the same tick as the
    // one before, as in a pause.
    if (position_ && telemetry.value("ticks") != shown_ticks_ && telemetry.value("safety") != 0)
      update_tick(telemetry.value("taken_at_s") + offset_s);
  }
  server_->pump(state_, now);
}

void IgtlSession::load_position() {
  asked_ = state_.session;
  const auto scene = console_.supervisor.scene_file(), asset = console_.supervisor.asset_file();
  boost::asio::post(console_.worker, [this, scene, asset, session = state_.session] {
    Position made;
    try {
      const Result<PatientBone> bone = patient_bone_of(scene, asset);
      if (bone) made.T_patient_device = bone->T_patient_device;
      if (bone && !bone->triangles.empty() &&
          bone->triangles.size() * 6 + bone->vertices_mm.size() * 4 <= kMaxSurfaceBytes)
        made.surface =
            shared(polydata_message({kBone, unix_s()}, bone->vertices_mm, bone->triangles));
    } catch (const std::exception&) {  // a hostile file must not end the console
      made = {};
    }
    boost::asio::post(console_.context, [this, made = std::move(made), session] {
      if (session != state_.session) return;
      state_.surface = made.surface;
      position_ = made;
    });
  });
}

void IgtlSession::update_status(double now_unix_s) {
  const SessionTelemetry& telemetry = console_.supervisor.telemetry();
  const RunState state = console_.supervisor.state();
  const double number = telemetry.value("fault");
  const int fault = number >= 0 && number < kFaults ? static_cast<int>(number) : 0;
  if (state_.status && shown_status_ == std::pair(state, fault)) return;
  shown_status_ = {state, fault};
  const auto what = static_cast<Fault>(fault);
  ++state_.status_number;
  state_.status =
      shared(status_message({kState, now_unix_s}, code_of(state, what),
                            what == Fault::kNone ? "" : to_string(what), to_string(state)));
}

void IgtlSession::update_tick(double taken_unix_s) {
  const SessionTelemetry& telemetry = console_.supervisor.telemetry();
  shown_ticks_ = telemetry.value("ticks");
  ++state_.tick_number;
  Eigen::Affine3d T_tool = tool_pose(telemetry);
  Eigen::Vector3d force_N = vector(telemetry, "wrench_delivered");
  const std::optional<Eigen::Affine3d>& T_patient_device = position_->T_patient_device;
  if (T_patient_device) {
    T_tool = *T_patient_device * T_tool;
    force_N = T_patient_device->linear() * force_N;
  }
  // A name says in which frame its values are: that of the patient, or that of the device.
  const char* const tool_name = T_patient_device ? "TrocarTool" : "TrocarToolInB";
  const char* const force_name = T_patient_device ? "TrocarForce" : "TrocarForceInB";
  const double t_s = telemetry.value("t_s");
  state_.tick =
      shared(transform_message({tool_name, taken_unix_s}, T_tool) +
             sensor_message({force_name, taken_unix_s}, {force_N.data(), 3}, IgtlUnit::kNewton) +
             sensor_message({kTime, taken_unix_s}, {&t_s, 1}, IgtlUnit::kSecond));
}

}  // namespace trocar::runtime
