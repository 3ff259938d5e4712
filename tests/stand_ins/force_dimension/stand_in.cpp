// SPDX-License-Identifier: Apache-2.0
// A library with the functions of Force Dimension's SDK that Trocar calls, written from the public list of
// functions. Behind them is a simulated device that a simulated hand holds, in real time, with faults on demand.
// README.md says how to use it.
#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <limits>
#include <memory>
#include <mutex>
#include <optional>
#include <stdexcept>
#include <string>
#include <string_view>
#include <thread>
#include <utility>
#include <vector>

#include "tests/stand_ins/faults.h"
#include "tests/stand_ins/simulated_arm.h"

#define DHD_FUNCTION extern "C" __attribute__((visibility("default")))

namespace stand_in {
namespace {

constexpr double kLate_s = 0.03;
constexpr double kJump_m = 0.05;
constexpr double kSkew = 0.01;
constexpr int kSameMeasurement = 1;  // the SDK's result if it gives its last measurement again

// Error numbers of the SDK.
constexpr int kErrorCom = 2;
constexpr int kErrorNoDevice = 5;
constexpr int kErrorConfiguration = 14;
constexpr int kErrorInvalidIndex = 15;
constexpr int kErrorNull = 17;
constexpr int kErrorInUse = 20;
constexpr std::array kErrorTexts{
    "no error",
    "undocumented error",
    "communication error",
    "the device controller is busy",
    "no driver found",
    "no device found",
    "the command is not available for this device",
    "the command timed out",
    "the device geometry does not allow it",
    "the command needs expert mode",
    "the command is not implemented",
    "out of memory",
    "the device is not ready",
    "a file is missing",
    "the configuration cannot be read",
    "invalid device index",
    "the command is deprecated",
    "the function was called with a null pointer",
    "the redundant encoders disagree",
    "the feature is not enabled",
    "the device is in use",
    "invalid parameter",
    "regulation is not running",
};

constexpr std::array<std::string_view, 13> kFaultKinds{
    "silence", "late", "error",      "read_error", "nan",        "skew",        "jump",
    "frozen",  "same", "disconnect", "no_device",  "open_fails", "uncalibrated"};

struct Settings {
  std::string model = "omega.3";
  bool has_wrist = false;
  bool has_active_wrist = false;
  std::vector<int> serials;  ///< serial numbers of the devices that are connected
  std::vector<Keyframe> path;
  std::string log;
  std::vector<Fault> faults;
  Readings readings;
  std::string error;  ///< names the setting that cannot be read; empty if there is none
};

std::string variable(const char* name) {
  const char* const value = std::getenv(name);  // NOLINT(concurrency-mt-unsafe)
  return value == nullptr ? "" : value;
}

/// The values of all variables in one text, to find out whether they have changed.
std::string environment() {
  std::string all;
  for (const char* const name : {"TROCAR_DHD_MODEL", "TROCAR_DHD_PATH", "TROCAR_DHD_LOG",
                                 "TROCAR_DHD_FAULT", "TROCAR_DHD_SERIALS", "TROCAR_DHD_READINGS"}) {
    all += variable(name) + "\n";
  }
  return all;
}

Settings read_settings() {
  Settings settings;
  if (const std::string model = variable("TROCAR_DHD_MODEL"); !model.empty())
    settings.model = model;
  settings.has_active_wrist = settings.model == "sigma.7";
  settings.has_wrist = settings.has_active_wrist || settings.model == "omega.6";
  settings.log = variable("TROCAR_DHD_LOG");
  try {
    if (!settings.has_wrist && settings.model != "omega.3")
      throw std::runtime_error(settings.model + " is not omega.3, omega.6 or sigma.7");
    if (const std::string path = variable("TROCAR_DHD_PATH"); !path.empty())
      settings.path = read_path(path);
    std::string serials = variable("TROCAR_DHD_SERIALS");
    if (serials.empty()) serials = "1";
    for (std::string_view text = serials; !text.empty();) {
      const auto [one, rest] = split(text, ',');
      const std::optional<int> serial = number_of<int>(one);
      if (!serial) throw std::runtime_error(std::string(one) + " is no number");
      settings.serials.push_back(*serial);
      text = rest;
    }
    if (const std::string readings = variable("TROCAR_DHD_READINGS"); !readings.empty())
      settings.readings = Readings(readings);
    settings.faults = parse_faults(variable("TROCAR_DHD_FAULT"), kFaultKinds);
  } catch (const std::exception& error) {
    settings.error = error.what();
  }
  return settings;
}

thread_local int last_error = 0;

int fail(int error) {
  last_error = error;
  return -1;
}

/// The device and its state since the settings have changed last.
struct Device {
  std::string environment;
  Settings settings;
  SimulatedArm arm{{}};
  std::chrono::steady_clock::time_point start;
  char id =
      0;  ///< differs for each change of the settings, so that a call that hung before finds no device
  bool open = false;
  std::size_t index = 0;  ///< index of the open device in Settings::serials
  bool enabled = false;
  Eigen::Vector3d force = Eigen::Vector3d::Zero();
  Eigen::Vector3d moment = Eigen::Vector3d::Zero();
  Eigen::Vector3d last_position = Eigen::Vector3d::Zero();
  Eigen::Quaterniond last_orientation = Eigen::Quaterniond::Identity();
  std::unique_ptr<std::FILE, int (*)(std::FILE*)> log{nullptr, std::fclose};

  double now_s() const {
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  }
  const Fault* fault(std::string_view kind) const;
  void move();
  void write(const char* call, const Eigen::Vector3d& f, const Eigen::Vector3d& t);
};

std::mutex mutex;              // guards `device`
Device& device = *new Device;  // never destroyed: a call that hangs may outlive the end of main()

const Fault* Device::fault(std::string_view kind) const {
  const double t_s = now_s();
  for (const Fault& each : settings.faults) {
    const double left_s = each.duration_s.value_or(t_s + 1) - (t_s - each.start_s);
    if (each.kind == kind && t_s >= each.start_s && left_s > 0) return &each;
  }
  return nullptr;
}

void Device::move() {
  const Eigen::Vector3d none = Eigen::Vector3d::Zero();
  arm.advance(now_s(), enabled ? force : none,
              enabled && settings.has_active_wrist ? moment : none);
}

void Device::write(const char* call, const Eigen::Vector3d& f, const Eigen::Vector3d& t) {
  if (log == nullptr) return;
  std::fprintf(log.get(), "%.6f,%s,%.17g,%.17g,%.17g,%.17g,%.17g,%.17g\n", now_s(), call, f.x(),
               f.y(), f.z(), t.x(), t.y(), t.z());
}

/// Holds the log until the device is closed: a disk can block for longer than a session waits for its device.
std::array<char, std::size_t{64} << 20> log_buffer;

/// Reads the settings if they have changed, and then begins anew: time 0, the hand at its first keyframe, an empty log.
void renew() {
  std::string now = environment();
  if (now == device.environment) return;
  const char id = static_cast<char>((device.id + 1) % 16);
  device = {};
  device.id = id;
  device.environment = std::move(now);
  device.settings = read_settings();
  device.arm = SimulatedArm(device.settings.path);
  device.start = std::chrono::steady_clock::now();
  if (!device.settings.log.empty()) {
    device.log.reset(std::fopen(device.settings.log.c_str(), "we"));
    if (device.log == nullptr) device.settings.error = "TROCAR_DHD_LOG cannot be written";
  }
  if (device.log != nullptr) {
    std::setvbuf(device.log.get(), log_buffer.data(), _IOFBF, log_buffer.size());
    std::fprintf(device.log.get(), "t_s,call,fx_N,fy_N,fz_N,tx_Nm,ty_Nm,tz_Nm\n");
  }
  if (!device.settings.error.empty()) {
    std::fprintf(stderr, "libdhd_stand_in: %s\n", device.settings.error.c_str());
  }
}

/// Waits while the device is silent, and for the delay if `may_be_late`.
void wait(bool may_be_late) {
  for (;;) {
    {
      const std::lock_guard lock(mutex);
      if (device.fault("silence") == nullptr) {
        if (!may_be_late || device.fault("late") == nullptr) return;
        break;
      }
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  std::this_thread::sleep_for(std::chrono::duration<double>(kLate_s));
}

/// The error of a call for device `id`: 0 if there is none.
int error_of(char id) {
  if (id == device.id && device.fault("disconnect") != nullptr) {
    device.open = false;  // it has to be opened again when it is back
    device.enabled = false;
    return kErrorCom;
  }
  if (!device.open || id != device.id) return kErrorInvalidIndex;
  const Fault* const error = device.fault("error");
  return error == nullptr ? 0 : error->code;
}

int open(std::size_t index) {
  renew();
  if (!device.settings.error.empty()) return fail(kErrorConfiguration);
  if (index >= device.settings.serials.size()) return fail(kErrorInvalidIndex);
  if (device.fault("disconnect") != nullptr) return fail(kErrorCom);
  if (device.fault("no_device") != nullptr) return fail(kErrorNoDevice);
  if (device.fault("open_fails") != nullptr) return fail(kErrorInUse);
  device.open = true;
  device.index = index;
  device.write("open", Eigen::Vector3d::Zero(), Eigen::Vector3d::Zero());
  return device.id;
}

int set(const char* call, char id, const Eigen::Vector3d& force, const Eigen::Vector3d& moment) {
  wait(true);
  const std::lock_guard lock(mutex);
  if (const int error = error_of(id)) return fail(error);
  device.move();
  device.force = force;
  device.moment = moment;
  device.write(call, force, moment);
  return 0;
}

/// The pose as it is measured, with the faults that change it.
struct Pose {
  Eigen::Vector3d position;
  Eigen::Matrix3d frame;
};

Pose measure(bool is_same) {
  device.move();
  if (!is_same && device.fault("frozen") == nullptr) {
    device.last_position = device.settings.readings.of(device.arm.position_m());
    device.last_orientation = device.arm.orientation();
  }
  Pose pose{device.last_position, Eigen::Matrix3d::Identity()};
  if (device.settings.has_wrist) pose.frame = device.last_orientation.toRotationMatrix();
  if (device.fault("jump") != nullptr) pose.position.x() += kJump_m;
  if (device.fault("skew") != nullptr) pose.frame(0, 1) += kSkew;
  if (device.fault("nan") != nullptr) {
    pose.position.y() = std::numeric_limits<double>::quiet_NaN();
  }
  return pose;
}

bool flag_of(char id, bool Settings::*flag) {
  const std::lock_guard lock(mutex);
  return error_of(id) == 0 && device.settings.*flag;
}

int get(char id, double* x, double* y, double* z, double (*frame)[3]) {
  wait(false);
  if (x == nullptr || y == nullptr || z == nullptr) return fail(kErrorNull);
  std::unique_lock lock(mutex);
  if (const int error = error_of(id)) return fail(error);
  if (device.fault("read_error") != nullptr) return fail(kErrorCom);
  const bool is_same = device.fault("same") != nullptr;
  const Pose pose = measure(is_same);
  *x = pose.position.x();
  *y = pose.position.y();
  *z = pose.position.z();
  for (int row = 0; frame != nullptr && row < 3; ++row) {
    for (int column = 0; column < 3; ++column)
      frame[row][column] = pose.frame(row, column);
  }
  const double late_s = device.settings.readings.late_s();
  lock.unlock();
  if (late_s > 0) std::this_thread::sleep_for(std::chrono::duration<double>(late_s));
  return is_same ? kSameMeasurement : 0;
}

}  // namespace
}  // namespace stand_in

using stand_in::device;

DHD_FUNCTION int dhdErrorGetLast() {
  return stand_in::last_error;
}

DHD_FUNCTION const char* dhdErrorGetStr(int error) {
  const bool known = error >= 0 && error < static_cast<int>(stand_in::kErrorTexts.size());
  return known ? stand_in::kErrorTexts.at(static_cast<std::size_t>(error)) : "unknown error";
}

DHD_FUNCTION const char* dhdErrorGetLastStr() {
  return dhdErrorGetStr(stand_in::last_error);
}

DHD_FUNCTION int dhdGetDeviceCount() {
  const std::lock_guard lock(stand_in::mutex);
  stand_in::renew();
  return device.fault("no_device") == nullptr && device.fault("disconnect") == nullptr
             ? static_cast<int>(device.settings.serials.size())
             : 0;
}

DHD_FUNCTION int dhdOpenID(char index) {
  const std::lock_guard lock(stand_in::mutex);
  return stand_in::open(static_cast<std::size_t>(index));
}

DHD_FUNCTION int dhdOpen() {
  return dhdOpenID(0);
}

DHD_FUNCTION int dhdClose(char id) {
  stand_in::wait(false);
  const std::lock_guard lock(stand_in::mutex);
  if (!device.open || id != device.id) return stand_in::fail(stand_in::kErrorInvalidIndex);
  device.move();
  device.write("close", Eigen::Vector3d::Zero(), Eigen::Vector3d::Zero());
  if (device.log != nullptr) std::fflush(device.log.get());
  device.open = false;
  device.enabled = false;
  device.force.setZero();
  device.moment.setZero();
  return 0;
}

DHD_FUNCTION const char* dhdGetSystemName(char id) {
  const std::lock_guard lock(stand_in::mutex);
  return stand_in::error_of(id) == 0 ? device.settings.model.c_str() : nullptr;
}

DHD_FUNCTION int dhdGetSerialNumber(std::uint16_t* number, char id) {
  const std::lock_guard lock(stand_in::mutex);
  if (const int error = stand_in::error_of(id)) return stand_in::fail(error);
  *number = static_cast<std::uint16_t>(device.settings.serials[device.index]);
  return 0;
}

DHD_FUNCTION int dhdGetStatus(int* status, char id) {
  const std::lock_guard lock(stand_in::mutex);
  if (const int error = stand_in::error_of(id)) return stand_in::fail(error);
  // power, connected, started, reset, idle, force, brake, torque, wrist, error, gravity, time guard, wrist initialised
  const int wrist = device.settings.has_wrist ? 1 : 0;
  const int on = device.enabled ? 1 : 0;
  const int reset = device.fault("uncalibrated") == nullptr ? 0 : 1;
  const std::array<int, 17> values{1, 1, 1, reset, 0, on, 1 - on, on, wrist, 0, 1, 1, wrist};
  std::copy(values.begin(), values.end(), status);
  return 0;
}

DHD_FUNCTION bool dhdHasWrist(char id) {
  return stand_in::flag_of(id, &stand_in::Settings::has_wrist);
}

DHD_FUNCTION bool dhdHasActiveWrist(char id) {
  return stand_in::flag_of(id, &stand_in::Settings::has_active_wrist);
}

DHD_FUNCTION int dhdEnableForce(unsigned char enable, char id) {
  const std::lock_guard lock(stand_in::mutex);
  if (const int error = stand_in::error_of(id)) return stand_in::fail(error);
  device.move();
  device.enabled = enable != 0;
  device.write(device.enabled ? "enable_force" : "disable_force", device.force, device.moment);
  return 0;
}

#ifndef TROCAR_DHD_INCOMPLETE
DHD_FUNCTION int dhdGetPosition(double* x, double* y, double* z, char id) {
  return stand_in::get(id, x, y, z, nullptr);
}
#endif

DHD_FUNCTION int dhdGetPositionAndOrientationFrame(double* x, double* y, double* z,
                                                   double (*frame)[3], char id) {
  return stand_in::get(id, x, y, z, frame);
}

DHD_FUNCTION unsigned dhdGetButtonMask(char id) {
  const std::lock_guard lock(stand_in::mutex);
  return stand_in::error_of(id) == 0 ? device.arm.buttons() : 0;
}

DHD_FUNCTION int dhdSetForce(double x, double y, double z, char id) {
  return stand_in::set("set_force", id, {x, y, z}, Eigen::Vector3d::Zero());
}

DHD_FUNCTION int dhdSetForceAndTorque(double x, double y, double z, double tx, double ty, double tz,
                                      char id) {
  return stand_in::set("set_force_and_torque", id, {x, y, z}, {tx, ty, tz});
}
